"""Tests of gi_core.display."""
