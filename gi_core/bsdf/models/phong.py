"""Phong: f = ks (n + 1) / (2 pi) cos^n(a) / cos i, a between o and the mirror direction of i.

Parameters: kd, ks in [0, 1]; exponent n in [1, 1000]. Phong's formula gives radiance, without the cosine of incidence;
as a BRDF it is divided by it.
Flaws: not reciprocal, f(i, o) / f(o, i) = cos o / cos i. The albedo grows as 1 / cos i without bound, for n = 20 to 1.5
at 85 degrees and 5.3 at 89. `lewis` is the plausible twin.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import (
    KD,
    KS,
    Parameter,
    Values,
    coloured,
    cosines,
    diffuse_kd,
    mirror_cosine,
    no_mirror,
)

SOURCE = "Phong, Illumination for computer generated pictures, Communications of the ACM 18(6), 1975"
RECIPROCAL, ANISOTROPIC, CONSERVES = False, False, "not at grazing angles: strong lobes need scale = true"
PARAMETERS = {"kd": KD, "ks": KS, "n": Parameter(20.0, 1.0, 1000.0, False, "exponent")}
diffuse, mirror = diffuse_kd, no_mirror


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    lobe = (p["n"] + 1.0) / (2.0 * math.pi) * mirror_cosine(i, o) ** p["n"] / cosines(i, o)[0]
    return coloured(p["ks"], lobe, i, o)
