"""Instruments around the solver: lower bounds, search timing, compilation ahead of use."""
