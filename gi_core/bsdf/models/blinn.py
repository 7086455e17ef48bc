"""Blinn: f = ks (n + 2) (n + 4) / (8 pi (2^(-n/2) + n)) cos^n(theta_h), h halfway between i and o.

Parameters: kd, ks in [0, 1]; exponent n in [1, 10000]. The factor makes the albedo ks at normal incidence. The same
highlight needs about four times Phong's exponent.
Flaws: without 1 / (cos i cos o) the lobe fades towards grazing angles (albedo 0.055 at 89 degrees for n = 20), where
real gloss grows.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import KD, KS, Parameter, Values, coloured, diffuse_kd, half_vector, no_mirror

SOURCE = "Blinn, Models of light reflection for computer synthesized pictures, SIGGRAPH 77; normalised"
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, "kd + ks <= 1"
PARAMETERS = {"kd": KD, "ks": KS, "n": Parameter(80.0, 1.0, 10000.0, False, "exponent")}
diffuse, mirror = diffuse_kd, no_mirror


def lobe(n: float, cos_h: np.ndarray) -> np.ndarray:
    """Return f (n,) [1/sr] for ks = 1 at cosines (n,) between half vector and normal."""
    return (n + 2.0) * (n + 4.0) / (8.0 * math.pi * (2.0 ** (-n / 2.0) + n)) * np.maximum(0.0, cos_h) ** n


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    return coloured(p["ks"], lobe(p["n"], half_vector(i, o)[:, 2]), i, o)
