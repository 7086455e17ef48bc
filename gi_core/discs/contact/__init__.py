"""Dynamic occluders: regions of discs that other objects shorten at a pose."""
