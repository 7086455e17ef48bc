"""Schlick: f = S(u) [G(v) G(v') Z(t) A(w) / (4 pi v v') + (1 - G(v) G(v')) / pi].

S = C + (1 - C) (1 - u)^5; Z = r / (1 + r t^2 - t^2)^2; A = sqrt(p / (p^2 - p^2 w^2 + w^2)); G(v) = v / (r - r v + v);
t = n.h, u = o.h, v = n.i, v' = n.o, w = cosine between the tangent and h in the surface.

Parameters: C in [0, 1], the reflectance at normal incidence; roughness r in [0.001, 1]; isotropy p in [0.05, 1].
Flaws: light between facets comes back as 1 / pi without regard to the reflected share, so the albedo of r = 0.2, C = 1
is 1.1 at 75 degrees and 1.8 at 89. Z is the GGX distribution of alpha^2 = r, found 13 years before that name.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import Parameter, Values, coloured, cosines, half_vector, no_diffuse, no_mirror

SOURCE = "Schlick, An inexpensive BRDF model for physically-based rendering, Computer Graphics Forum 13(3), 1994"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, True, "C below about 0.5: not at grazing angles"
PARAMETERS = {
    "C": Parameter(0.5, 0.0, 1.0, True, "reflectance at normal incidence"),
    "r": Parameter(0.1, 0.001, 1.0, False, "roughness, 0 smooth, 1 rough"),
    "p": Parameter(1.0, 0.05, 1.0, False, "isotropy, 1 isotropic"),
}
diffuse, mirror = no_diffuse, no_mirror


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr], (n, 3)."""
    h = half_vector(i, o)
    ci, co = cosines(i, o)
    r, isotropy = p["r"], p["p"]
    t2, u = h[:, 2] ** 2, np.clip((o * h).sum(axis=1), 0.0, 1.0)
    plane2 = h[:, 0] ** 2 + h[:, 1] ** 2
    w2 = np.where(plane2 > 1e-24, h[:, 0] ** 2 / np.maximum(plane2, 1e-24), 0.5)
    z = r / (1.0 + r * t2 - t2) ** 2
    a = np.sqrt(isotropy / (isotropy**2 * (1.0 - w2) + w2))
    gi, go = ci / (r - r * ci + ci), co / (r - r * co + co)
    lobe = gi * go * z * a / (4.0 * math.pi * ci * co) + (1.0 - gi * go) / math.pi
    c = np.broadcast_to(p["C"], 3)
    return (c + (1.0 - c) * ((1.0 - u) ** 5)[:, None]) * coloured(1.0, lobe, i, o)
