"""Twins, scenes, statistics and drivers that tests and studies share."""
