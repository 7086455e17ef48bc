"""Instruments around the solver: search timing, compilation ahead of use."""
