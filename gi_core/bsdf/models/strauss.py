"""Strauss: diffuse (1 - m s) (1 - s^3) (1 - t) C, and the specular lobe
f = [1 + m (1 - F(i)) (C - 1)] min(1, r + (r + 0.1) j) (h + 1) / (2 pi) cos^h(a) / cos i.

a is the angle between o and the mirror direction of i; h = 3 / (1 - s); r = 1 - t - (1 - s^3) (1 - t);
j = F(i) G(i) G(o) with angles x = 2 theta / pi: F(x) = (1 / (x - 1.12)^2 - 1 / 1.12^2) / (1 / 0.12^2 - 1 / 1.12^2),
G(x) = (1 / 0.01^2 - 1 / (x - 1.01)^2) / (1 / 0.01^2 - 1 / 1.01^2).

Parameters: C in [0, 1]; smoothness s in [0, 0.997]; metalness m and transparency t in [0, 1].
The paper gives intensities for a point light. Here the lobe is divided by cos i, and (h + 1) / (2 pi) makes r its
albedo at normal incidence, since r + t + the diffuse reflectance of s = 1 at m = 0. Transmitted light is lost.
Flaws: not reciprocal; the albedo grows as 1 / cos i without bound. F and G take angles: shaders that pass cosines have
F = 1 at normal incidence.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import Parameter, Values, coloured, cosines, mirror_cosine, no_mirror

SOURCE = (
    "Strauss, A realistic lighting model for computer animators, IEEE Computer Graphics and Applications 10(6), 1990"
)
RECIPROCAL, ANISOTROPIC, CONSERVES = False, False, "not at grazing angles: strong lobes need scale = true"
PARAMETERS = {
    "C": Parameter(0.5, 0.0, 1.0, True, "colour"),
    "s": Parameter(0.6, 0.0, 0.997, False, "smoothness"),
    "m": Parameter(0.5, 0.0, 1.0, False, "metalness"),
    "t": Parameter(0.0, 0.0, 1.0, False, "transparency: this share is lost"),
}
mirror = no_mirror


def _fresnel(x: np.ndarray) -> np.ndarray:
    return (1.0 / (x - 1.12) ** 2 - 1.0 / 1.12**2) / (1.0 / 0.12**2 - 1.0 / 1.12**2)


def _shadow(x: np.ndarray) -> np.ndarray:
    return (1.0 / 0.01**2 - 1.0 / (x - 1.01) ** 2) / (1.0 / 0.01**2 - 1.0 / 1.01**2)


def diffuse(p: Values) -> np.ndarray:
    """Return the Lambertian albedo, (3,)."""
    return (1.0 - p["m"] * p["s"]) * (1.0 - p["s"] ** 3) * (1.0 - p["t"]) * np.broadcast_to(p["C"], 3)


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    xi, xo = (2.0 / math.pi * np.arccos(np.clip(w[:, 2], 0.0, 1.0)) for w in (i, o))
    f = _fresnel(xi)
    r = 1.0 - p["t"] - (1.0 - p["s"] ** 3) * (1.0 - p["t"])
    share = np.minimum(1.0, r + (r + 0.1) * f * _shadow(xi) * _shadow(xo))
    h = 3.0 / (1.0 - p["s"])
    lobe = share * (h + 1.0) / (2.0 * math.pi) * mirror_cosine(i, o) ** h / cosines(i, o)[0]
    colour = 1.0 + p["m"] * (1.0 - f)[:, None] * (np.broadcast_to(p["C"], 3) - 1.0)
    return colour * coloured(1.0, lobe, i, o)
