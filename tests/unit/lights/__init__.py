"""Tests of gi_core.lights."""
