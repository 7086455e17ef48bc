"""GGX: f = F D G2 / (4 cos i cos o), the modern kin of `torrance_sparrow`; numpy twin of the closed form in kernels.

D = a^2 / (pi (1 + (a^2 - 1) cos^2(theta_h))^2); G2 = 1 / (1 + L(i) + L(o)), Smith's height-correlated masking, with
L(v) = (sqrt(1 + a^2 tan^2(theta_v)) - 1) / 2; F = f0 + (1 - f0) (1 - o.h)^5.

Parameters: kd, f0 in [0, 1]; alpha in [0.02, 1], roughness squared.
Flaws: light between facets is lost (albedo 0.31 at normal incidence for alpha 1, f0 1). With kd the sum is not
coupled, so kd + albedo <= 1 is checked.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import KD, Parameter, Values, coloured, cosines, diffuse_kd, half_vector, no_mirror

SOURCE = (
    "Walter, Marschner, Li, Torrance, Microfacet models for refraction through rough surfaces, EGSR 2007; "
    "Heitz, Understanding the masking-shadowing function, JCGT 3(2), 2014"
)
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, "kd + albedo <= 1: checked by quadrature"
PARAMETERS = {
    "kd": KD,
    "f0": Parameter(0.5, 0.0, 1.0, True, "reflectance at normal incidence"),
    "alpha": Parameter(0.3, 0.02, 1.0, False, "roughness, the square of the artist's"),
}
diffuse, mirror = diffuse_kd, no_mirror


def smith(alpha: float, cos: np.ndarray) -> np.ndarray:
    """Return Smith's Lambda at cosines (n,); masking of one direction is 1 / (1 + Lambda)."""
    return 0.5 * (np.sqrt(1.0 + alpha**2 * np.maximum(0.0, 1.0 / cos**2 - 1.0)) - 1.0)


def distribution(alpha: float, cos_h: np.ndarray) -> np.ndarray:
    """Return D [1/sr] at cosines between half vector and normal (n,)."""
    return alpha**2 / (math.pi * (1.0 + (alpha**2 - 1.0) * cos_h**2) ** 2)


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    h = half_vector(i, o)
    ci, co = cosines(i, o)
    f0 = np.broadcast_to(p["f0"], 3)
    fresnel = f0 + (1.0 - f0) * ((1.0 - np.clip((o * h).sum(axis=1), 0.0, 1.0)) ** 5)[:, None]
    g2 = 1.0 / (1.0 + smith(p["alpha"], ci) + smith(p["alpha"], co))
    lobe = distribution(p["alpha"], h[:, 2]) * g2 / (4.0 * ci * co)
    return fresnel * coloured(1.0, lobe, i, o)
