"""Tests of gi_core.defaults."""
