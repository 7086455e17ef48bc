"""Camera projection: picture coordinates of points, and rays through the picture."""

from __future__ import annotations

import numpy as np

from gi_core.base.vectors import cross, dot, length
from gi_core.scene.types import Camera

ASPECT = 1.6  # width over height of the window as it opens


def unit(a: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) with length 1; zero stays zero."""
    return a / np.maximum(length(a), 1e-12)[..., None]


def axes(position, target, up) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors forward, right and upwards in the picture, (..., 3) each, of cameras (..., 3)."""
    forward = unit(np.subtract(target, position))
    right = cross(forward, np.asarray(up, np.float64))
    # Straight up or down: any direction may be right.
    other = cross(forward, np.eye(3)[np.argmin(np.abs(forward), axis=-1)])
    right = unit(np.where((length(right) < 1e-6)[..., None], other, right))
    return forward, right, cross(right, forward)


def in_frame(camera: Camera, up, points) -> np.ndarray:
    """Return picture coordinates (n, 2) of points, -1 .. 1 inside the frame; inf behind the camera."""
    return in_frames([camera], up, points)[0]


def in_frames(cameras: list[Camera], up, points) -> np.ndarray:
    """Return the same for several cameras, (cameras, n, 2)."""
    position, (forward, right, above), half = _several(cameras, up)
    off = np.asarray(points, np.float64) - position
    depth = dot(off, forward)
    ahead = depth > 1e-9
    d = np.where(ahead, depth * half, 1.0)
    at = np.stack([dot(off, right) / (d * ASPECT), dot(off, above) / d], axis=-1)
    return np.where(ahead[..., None], at, np.inf)


def picture_rays(cameras: list[Camera], up, columns: int, rows: int) -> np.ndarray:
    """Return unit directions (cameras, columns * rows, 3) through the middles of a grid over each picture."""
    _, (forward, right, above), half = _several(cameras, up)
    x, y = np.meshgrid((2 * np.arange(columns) + 1) / columns - 1, (2 * np.arange(rows) + 1) / rows - 1)
    x, y = x.reshape(-1) * half * ASPECT, y.reshape(-1) * half
    return unit(forward + x[..., None] * right + y[..., None] * above)


def _several(cameras: list[Camera], up):
    """Return positions, axes, (cameras, 1, 3) each, and the tangents of half their vertical angles (cameras, 1)."""
    position = np.array([c.position for c in cameras], np.float64)[:, None]
    target = np.array([c.target for c in cameras], np.float64)[:, None]
    half = np.tan(np.radians([c.vertical_fov_degrees for c in cameras]) / 2)[:, None]
    return position, axes(position, target, up), half
