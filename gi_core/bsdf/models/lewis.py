"""Lewis: f = ks (n + 2) / (2 pi) cos^n(a), a between o and the mirror direction of i; Phong made plausible.

Parameters: kd, ks in [0, 1]; exponent n in [1, 1000].
Flaws: the lobe is cut by the horizon and carries no 1 / cos, so the albedo falls from ks to 0.10 ks at 89 degrees (n =
20), where real gloss grows.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import KD, KS, Parameter, Values, coloured, diffuse_kd, mirror_cosine, no_mirror

SOURCE = "Lewis, Making shaders more physically plausible, Computer Graphics Forum 13(2), 1994"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, "kd + ks <= 1"
PARAMETERS = {"kd": KD, "ks": KS, "n": Parameter(20.0, 1.0, 1000.0, False, "exponent")}
diffuse, mirror = diffuse_kd, no_mirror


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    return coloured(p["ks"], (p["n"] + 2.0) / (2.0 * math.pi) * mirror_cosine(i, o) ** p["n"], i, o)
