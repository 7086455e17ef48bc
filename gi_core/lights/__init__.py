"""Lights: how each one emits photons, and how shadow rays sample it."""
