"""The window: viewport, drags, keys, overlays."""
