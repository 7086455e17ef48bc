"""Tests of gi_core.gloss."""
