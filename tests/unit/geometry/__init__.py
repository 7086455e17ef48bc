"""Tests of gi_core.geometry."""
