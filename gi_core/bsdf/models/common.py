"""Parameters of reflection models, and the geometry and Fresnel terms that several models share.

Directions are float64 arrays (n, 3) of unit vectors in the local frame: z along the normal, x along the tangent. Both
point away from the surface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Values = dict[str, "float | np.ndarray"]  # of one model's parameters: a float, or (3,) float64 for a colour


class Parameter(NamedTuple):
    """One parameter of a model: its default, its range per channel, whether it is a colour, and its meaning."""

    default: float | tuple[float, float, float]
    low: float
    high: float
    colour: bool
    meaning: str


KD = Parameter(0.0, 0.0, 1.0, True, "Lambertian albedo beside the lobe")
KS = Parameter(0.5, 0.0, 1.0, True, "strength of the lobe")
IOR = Parameter(1.5, 0.0, 10.0, True, "refractive index n, the real part")
EXTINCTION = Parameter(0.0, 0.0, 20.0, True, "extinction coefficient k, 0 for a dielectric")


def above(i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return which of n pairs of directions lie above the surface, (n,) bool."""
    return (i[:, 2] > 0) & (o[:, 2] > 0)


def coloured(colour: float | np.ndarray, lobe: np.ndarray, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return colour times lobe (n,), (n, 3) float64; 0 where a direction lies below the surface."""
    return np.broadcast_to(colour, 3) * np.where(above(i, o), lobe, 0.0)[:, None]


def cosines(i: np.ndarray, o: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cos theta of i and of o, (n,) each, at least 1e-9, so that a lobe can divide by them."""
    return np.maximum(i[:, 2], 1e-9), np.maximum(o[:, 2], 1e-9)


def half_vector(i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return the unit vectors between i and o, (n, 3); the normal where they are opposite."""
    h = i + o
    length = np.sqrt((h * h).sum(axis=1, keepdims=True))
    return np.where(length > 1e-12, h / np.maximum(length, 1e-12), (0.0, 0.0, 1.0))


def mirror_cosine(i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return max(0, cos) of the angle between o and the mirror direction of i, (n,)."""
    return np.maximum(0.0, i[:, 2] * o[:, 2] - i[:, 0] * o[:, 0] - i[:, 1] * o[:, 1])


def fresnel(cos: np.ndarray, n: float | np.ndarray, k: float | np.ndarray) -> np.ndarray:
    """Return the unpolarised reflectance of index n - ik at angles of incidence cos (m,), (m, 3).

    The exact equations for a conductor in air (Born and Wolf, Principles of Optics, 14.2); k = 0 is a dielectric.
    n = 0 with k >= 1 reflects everything.
    """
    c = np.clip(cos, 0.0, 1.0)[:, None]
    n, k = np.broadcast_to(n, 3), np.broadcast_to(k, 3)
    sine2 = 1.0 - c * c
    inner = n * n - k * k - sine2
    root = np.sqrt(inner * inner + 4.0 * n * n * k * k)
    a = np.sqrt(np.maximum(0.0, 0.5 * (root + inner)))
    perpendicular = (root + c * c - 2.0 * a * c) / np.maximum(root + c * c + 2.0 * a * c, 1e-300)
    scaled, mixed = c * c * root + sine2 * sine2, 2.0 * a * c * sine2
    parallel = perpendicular * (scaled - mixed) / np.maximum(scaled + mixed, 1e-300)
    return np.maximum(0.0, 0.5 * (perpendicular + parallel))  # rounding makes it negative at n = 1


def no_diffuse(p: Values) -> np.ndarray:
    """Return the Lambertian albedo (3,) of a model that has none."""
    return np.zeros(3)


def diffuse_kd(p: Values) -> np.ndarray:
    """Return the Lambertian albedo (3,) of a model with a parameter kd."""
    return np.array(np.broadcast_to(p["kd"], 3), float)


def no_mirror(p: Values, cos_i: np.ndarray) -> np.ndarray:
    """Return the albedo (n, 3) of a perfect mirror in a model that has none."""
    return np.zeros((len(cos_i), 3))
