"""Tests of gi_core.base."""
