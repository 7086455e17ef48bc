"""Torrance-Sparrow: f = ks F D G / (4 cos i cos o) for V-shaped grooves of Beckmann's slopes.

D = exp(-tan^2(theta_h) / m^2) / (pi m^2 cos^4(theta_h)); G = min(1, 2 (n.h) (n.o) / (o.h), 2 (n.h) (n.i) / (o.h));
F is Fresnel's reflectance of index n and extinction k at o.h.

Parameters: kd, ks in [0, 1]; slope m (root mean square) in [0.02, 1]; n in [0, 10]; k in [0, 20]; n = 0, k = 1 gives
F = 1. Flaws: light between grooves is lost (albedo 0.80 at normal incidence for m = 0.6, F = 1); G has a kink, and
V-shaped grooves with one slope each contradict the distribution D (Heitz 2014).
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import (
    EXTINCTION,
    IOR,
    KD,
    KS,
    Parameter,
    Values,
    coloured,
    cosines,
    diffuse_kd,
    fresnel,
    half_vector,
    no_mirror,
)

SOURCE = "Torrance, Sparrow, JOSA 57(9), 1967; Cook, Torrance, ACM Transactions on Graphics 1(1), 1982"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, "kd + ks F <= 1"
PARAMETERS = {
    "kd": KD,
    "ks": KS._replace(default=1.0),
    "m": Parameter(0.3, 0.02, 1.0, False, "root mean square slope"),
    "n": IOR,
    "k": EXTINCTION,
}
diffuse, mirror = diffuse_kd, no_mirror


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    h = half_vector(i, o)
    ci, co = cosines(i, o)
    ch, oh = np.maximum(h[:, 2], 1e-9), np.maximum((o * h).sum(axis=1), 1e-9)
    m2 = p["m"] ** 2
    d = np.exp(-np.minimum((1.0 / ch**2 - 1.0) / m2, 700.0)) / (math.pi * m2 * ch**4)
    g = np.minimum(1.0, 2.0 * ch * np.minimum(ci, co) / oh)
    return fresnel(oh, p["n"], p["k"]) * coloured(p["ks"], d * g / (4.0 * ci * co), i, o)
