"""Oren-Nayar, the qualitative model: f = rho / pi (A + B max(0, cos dphi) sin(alpha) tan(beta)).

A = 1 - 0.5 s^2 / (s^2 + 0.33); B = 0.45 s^2 / (s^2 + 0.09); alpha is the larger, beta the smaller of theta_i, theta_o.

Parameters: rho in [0, 1]; sigma in [0, 1.6] radians, the standard deviation of the facets' slope angle.
Flaws: loses light between facets (albedo 0.78 at normal incidence for sigma 0.5, rho 1), and has a crease where
theta_i = theta_o. `eon` mends both.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import Parameter, Values, coloured, cosines, no_diffuse, no_mirror

SOURCE = "Oren, Nayar, Generalization of Lambert's reflectance model, SIGGRAPH 94"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, True
PARAMETERS = {
    "rho": Parameter(0.5, 0.0, 1.0, True, "albedo of a facet"),
    "sigma": Parameter(0.5, 0.0, 1.6, False, "standard deviation of slope angles [radians]"),
}
diffuse, mirror = no_diffuse, no_mirror


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr], (n, 3)."""
    s2 = p["sigma"] ** 2
    a, b = 1.0 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09)
    ci, co = cosines(i, o)
    across = i[:, 0] * o[:, 0] + i[:, 1] * o[:, 1]  # cos dphi sin theta_i sin theta_o = cos dphi sin alpha sin beta
    return coloured(p["rho"], (a + b * np.maximum(0.0, across) / np.maximum(ci, co)) / math.pi, i, o)
