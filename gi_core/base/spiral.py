"""Directions over a hemisphere on a spiral (Vogel 1979), the same around every normal."""

from __future__ import annotations

import numpy as np

from gi_core.base.vectors import cross, length

DIRECTIONS = 16


def directions(normals: np.ndarray) -> np.ndarray:
    """Return cosine-distributed directions (n, DIRECTIONS, 3) float32 about normals (n, 3), from steep to flat."""
    k = np.arange(DIRECTIONS)
    r, angle = np.sqrt((k + 0.5) / DIRECTIONS), k * np.pi * (3 - np.sqrt(5))
    local = np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - r * r)], axis=1)
    across = cross(normals, np.where(np.abs(normals[:, :1]) > 0.5, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    across /= np.maximum(length(across), 1e-30)[:, None]  # no normal: no faces with area
    frames = np.stack([across, cross(normals, across), normals], axis=1)
    return (local @ frames).astype(np.float32)
