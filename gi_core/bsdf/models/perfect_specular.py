"""Perfect specular: a mirror, f = ks delta(o - mirror of i) / cos i.

Parameters: ks in [0, 1]. Flaws: ks does not rise towards grazing angles, as Fresnel's equations require.
"""

from __future__ import annotations

import numpy as np

from gi_core.bsdf.models.common import KD, KS, Values, diffuse_kd

SOURCE = "law of reflection"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, "kd + ks <= 1"
PARAMETERS = {"kd": KD, "ks": KS._replace(default=0.9)}
diffuse = diffuse_kd


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] without the mirror, (n, 3): nothing is left."""
    return np.zeros((len(i), 3))


def mirror(p: Values, cos_i: np.ndarray) -> np.ndarray:
    """Return the albedo of the mirror, (n, 3), at cosines of incidence (n,)."""
    return np.tile(np.broadcast_to(p["ks"], 3), (len(cos_i), 1)).astype(float)
