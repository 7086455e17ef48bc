"""Tests of gi_core.tuning."""
