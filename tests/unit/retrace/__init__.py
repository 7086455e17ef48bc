"""Tests of gi_core.retrace."""
