"""Tests of gi_core.scene."""
