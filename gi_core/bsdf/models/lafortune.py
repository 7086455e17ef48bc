"""Lafortune: f = ks (n + 2) / (2 pi) max(0, cx ix ox + cy iy oy + cz iz oz)^n; one cosine lobe.

Parameters: kd, ks in [0, 1]; cx, cy in [-2, 2]; cz in [-2, 2]; n in [1, 1000]. cx = cy = -1, cz = 1 is `lewis`;
cx = cy > 0 reflects back towards the light; |cx| > cz is off-specular. A sum of lobes is a linear combination.
Flaws: parameters fitted to measurements carry no bound: cz = 1.1, n = 20 has an albedo of 6.7, so it is checked.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import KD, KS, Parameter, Values, coloured, diffuse_kd, no_mirror

SOURCE = "Lafortune, Foo, Torrance, Greenberg, Non-linear approximation of reflectance functions, SIGGRAPH 97"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, True, "depends on cx, cy, cz: checked by quadrature"
PARAMETERS = {
    "kd": KD,
    "ks": KS,
    "cx": Parameter(-1.0, -2.0, 2.0, False, "factor of ix ox"),
    "cy": Parameter(-1.0, -2.0, 2.0, False, "factor of iy oy"),
    "cz": Parameter(1.0, -2.0, 2.0, False, "factor of iz oz"),
    "n": Parameter(20.0, 1.0, 1000.0, False, "exponent"),
}
diffuse, mirror = diffuse_kd, no_mirror


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    dot = p["cx"] * i[:, 0] * o[:, 0] + p["cy"] * i[:, 1] * o[:, 1] + p["cz"] * i[:, 2] * o[:, 2]
    with np.errstate(over="ignore"):  # 2^1000 times a small factor is inf, which the check of the albedo refuses
        lobe = (p["n"] + 2.0) / (2.0 * math.pi) * np.maximum(0.0, dot) ** p["n"]
    return coloured(p["ks"], lobe, i, o)
