"""Tests of app.draw."""
