"""Tests of gi_core.rays."""
