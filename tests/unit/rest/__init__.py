"""Tests of app.rest."""
