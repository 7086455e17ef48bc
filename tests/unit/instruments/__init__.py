"""Tests of gi_core.instruments."""
