"""EON, the energy-preserving Oren-Nayar model: f = single scattering + multiple scattering between facets.

f_ss = rho / pi A (1 + r s / t), s = i.o - cos i cos o, t = max(cos i, cos o) if s > 0, else 1;
A = 1 / (1 + (1/2 - 2 / (3 pi)) r); f_ms = rho_ms / pi (1 - E(i)) (1 - E(o)) / (1 - E_avg),
rho_ms = rho^2 E_avg / (1 - rho (1 - E_avg)), E_avg = A (1 + (2/3 - 28 / (15 pi)) r), and
E(theta) = A (1 + r / pi (S (theta - S c) + 2/3 ((S / c) (1 - S^3) - S))), S = sin theta, c = cos theta.

Parameters: rho in [0, 1], the albedo of a facet; roughness r in [0, 1].
Flaws: reciprocal and passes the white furnace (albedo 1 for rho = 1); the form of f_ms is empirical.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import Parameter, Values, above, cosines, no_diffuse, no_mirror

SOURCE = "Portsmouth, Kutz, Hill, EON: a practical energy-preserving rough diffuse BRDF, JCGT 14(1), 2025"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, True
PARAMETERS = {
    "rho": Parameter(0.5, 0.0, 1.0, True, "albedo of a facet"),
    "r": Parameter(0.8, 0.0, 1.0, False, "roughness"),
}
diffuse, mirror = no_diffuse, no_mirror


def single_albedo(r: float, cos: np.ndarray) -> np.ndarray:
    """Return E(theta) for rho = 1 at cosines (n,): the albedo of single scattering."""
    s = np.sqrt(np.maximum(0.0, 1.0 - cos * cos))
    g = s * (np.arccos(np.minimum(cos, 1.0)) - s * cos) + (2.0 / 3.0) * (s / cos * (1.0 - s**3) - s)
    return (1.0 + r / math.pi * g) / (1.0 + (0.5 - 2.0 / (3.0 * math.pi)) * r)


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr], (n, 3)."""
    rho, r = np.broadcast_to(p["rho"], 3), p["r"]
    ci, co = cosines(i, o)
    s = i[:, 0] * o[:, 0] + i[:, 1] * o[:, 1]
    a = 1.0 / (1.0 + (0.5 - 2.0 / (3.0 * math.pi)) * r)
    mean = a * (1.0 + (2.0 / 3.0 - 28.0 / (15.0 * math.pi)) * r)
    single = a * (1.0 + r * np.where(s > 0, s / np.maximum(ci, co), s)) / math.pi
    lost = np.maximum(0.0, 1.0 - single_albedo(r, ci)) * np.maximum(0.0, 1.0 - single_albedo(r, co))
    multiple = lost / (math.pi * max(1.0 - mean, 1e-12))
    again = rho * rho * mean / (1.0 - rho * (1.0 - mean))
    return np.where(above(i, o)[:, None], rho * single[:, None] + again * multiple[:, None], 0.0)
