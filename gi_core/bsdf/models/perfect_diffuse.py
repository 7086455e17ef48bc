"""Perfect diffuse: f = kd / pi.

Parameters: kd in [0, 1]. The lobe is empty, because the Lambertian part is split off (`diffuse`).
Flaws: real matt surfaces scatter back towards the light (`oren_nayar`, `eon`) and shine at grazing angles.
"""

from __future__ import annotations

import numpy as np

from gi_core.bsdf.models.common import KD, Values, diffuse_kd, no_mirror

SOURCE = "Lambert, Photometria, 1760"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, True
PARAMETERS = {"kd": KD._replace(default=0.5)}
diffuse, mirror = diffuse_kd, no_mirror


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] without the Lambertian part, (n, 3): nothing is left."""
    return np.zeros((len(i), 3))
