"""Sides of triangles: 2 face + (1 on the back), NONE in free space."""

from __future__ import annotations

NONE = -1  # no surface
