"""Tests of gi_core.photons."""
