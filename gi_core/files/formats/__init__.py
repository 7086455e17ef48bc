"""Readers, one per file format, each with the rules that its format leaves open."""
