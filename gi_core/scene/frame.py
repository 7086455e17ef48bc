"""What a camera sees: where points land in its picture, and the rays through it."""

from __future__ import annotations

import numpy as np

from gi_core.scene.types import Camera

ASPECT = 1.6  # width over height of the window as it opens


def axes(position, target, up) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors forward, right and upwards in the picture."""
    forward = np.subtract(target, position)
    forward = forward / np.sqrt((forward * forward).sum())
    right = np.cross(forward, up)
    length = np.sqrt((right * right).sum())
    if length < 1e-6:  # straight up or down: any direction may be right
        right = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
        length = np.sqrt((right * right).sum())
    right = right / length
    return forward, right, np.cross(right, forward)


def in_frame(camera: Camera, up, points) -> np.ndarray:
    """Return where points land in the picture, (n, 2) each within -1 .. 1; inf behind the camera."""
    forward, right, above = axes(camera.position, camera.target, up)
    off = np.asarray(points, np.float64) - camera.position
    depth = off @ forward
    half = np.tan(np.radians(camera.vertical_fov_degrees) / 2)
    ahead = depth > 1e-9
    d = np.where(ahead, depth * half, 1.0)
    at = np.stack([(off @ right) / (d * ASPECT), (off @ above) / d], axis=1)
    return np.where(ahead[:, None], at, np.inf)


def picture_rays(camera: Camera, up, columns: int, rows: int) -> np.ndarray:
    """Return unit directions (columns * rows, 3) through the middles of a grid over the picture."""
    forward, right, above = axes(camera.position, camera.target, up)
    half = np.tan(np.radians(camera.vertical_fov_degrees) / 2)
    x = (2 * (np.arange(columns) + 0.5) / columns - 1) * half * ASPECT
    y = (2 * (np.arange(rows) + 0.5) / rows - 1) * half
    x, y = (a.reshape(-1, 1) for a in np.meshgrid(x, y))
    d = forward + x * right + y * above
    return d / np.sqrt((d * d).sum(axis=1, keepdims=True))
