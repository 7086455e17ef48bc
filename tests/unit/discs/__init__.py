"""Tests of gi_core.discs."""
