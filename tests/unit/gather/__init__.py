"""Tests of gi_core.gather."""
