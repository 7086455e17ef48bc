"""Tests of gi_core.frames."""
