"""What every mesh-file reader returns: parts in world space, their materials, and lights if the format has any."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.scene.types import Camera, Light, Material


class Part(NamedTuple):
    """Triangles of one material (or several: `material` is per face)."""

    vertices: np.ndarray  # (V, 3) float64, world space of the file
    faces: np.ndarray  # (F, 3) int64 into vertices
    material: np.ndarray  # (F,) int64 into FileParts.materials
    corner_normals: np.ndarray | None = None  # (F, 3, 3) float64 any length, as in the file
    reflectance: np.ndarray | None = None  # (F, 3) float64 where textures or vertex colours say more than the material


class FileParts(NamedTuple):
    """A mesh file as read, before any cleaning."""

    parts: list[Part]
    materials: list[Material]
    lights: list[Light]
    camera: Camera | None
    up: str  # "y" or "z", the format's custom
    notes: list[str]


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    """Decode sRGB values in 0..1 to linear ones."""
    v = np.asarray(value, np.float64)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def average_over_triangles(image: np.ndarray, uv: np.ndarray, clamp: bool = False) -> np.ndarray:
    """Return the mean linear colour (F, 3) of an sRGB image (h, w, 3) uint8 under each triangle.

    uv: (F, 3, 2), v downwards. Sixteen points a triangle, the centroids of a fourfold subdivision:
    enough for the flat palettes and soft gradients that a diffuse face can make use of.
    """
    linear = srgb_to_linear(np.arange(256) / 255.0)[image[..., :3]]
    h, w = linear.shape[:2]
    total = np.zeros((len(uv), 3))
    weights = _subtriangle_centroids(4)
    for a, b, c in weights:
        at = a * uv[:, 0] + b * uv[:, 1] + c * uv[:, 2]
        at = np.clip(at, 0, 1) if clamp else at - np.floor(at)
        x = np.minimum((at[:, 0] * w).astype(np.int64), w - 1)
        y = np.minimum((at[:, 1] * h).astype(np.int64), h - 1)
        total += linear[y, x]
    return total / len(weights)


def open_image(data) -> np.ndarray | None:
    """Return the pixels (h, w, 3) uint8 of an encoded image (a path or a binary file), None if unreadable."""
    from PIL import Image

    try:
        with Image.open(data) as image:
            return np.asarray(image.convert("RGB"))
    except (OSError, ValueError, SyntaxError):  # Pillow raises any of these on damaged files
        return None


def _subtriangle_centroids(n: int) -> list[tuple[float, float, float]]:
    points = []
    for i in range(n):
        for j in range(n - i):
            a, b = (i + 1 / 3) / n, (j + 1 / 3) / n
            points.append((a, b, 1 - a - b))
            if i + j < n - 1:
                a, b = (i + 2 / 3) / n, (j + 2 / 3) / n
                points.append((a, b, 1 - a - b))
    return points
