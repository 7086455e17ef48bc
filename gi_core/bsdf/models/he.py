"""He-Torrance-Sillion-Greenberg: a perfect mirror of albedo F exp(-g) S and a lobe f = F G S D / (pi cos i cos o).

For a surface of Gaussian heights and Gaussian autocorrelation, per channel at wavelength l, with v = i + o:
D = pi^2 tau^2 / (4 l^2) sum_m exp(-g) g^m / (m! m) exp(-(pi tau / l)^2 v_xy^2 / m), G = (v.v / v_z)^2,
g = (2 pi s / l (cos i + cos o))^2, s = sigma / sqrt(1 + x^2), x exp(x^2 / 2) = (K(i) + K(o)) / sqrt(8 pi),
K = tan erfc(u), u = tau cot / (2 sigma); S = S1(i) S1(o), S1 = (1 - erfc(u) / 2) / (1 + L),
L = exp(-u^2) / (2 sqrt(pi) u) - erfc(u) / 2; F is Fresnel's reflectance at the half vector.

Parameters: kd in [0, 1], the paper's a(l); height sigma (root mean square) in [0.005, 5] um; correlation length tau in
[0.5, 50] um; index n in [0, 10], extinction k in [0, 20]. Wavelengths: 0.61, 0.55, 0.465 um. The light is unpolarised.
Traps: Eq. 25 of the paper lacks exp(-u^2) (authors' erratum). v in Eq. 78 is a wave vector, so v_xy carries 2 pi / l;
without it the lobe has the wrong width. The polarisation products of G (Eq. 76) cancel exactly for unpolarised light.
The sum needs about g + 8 sqrt(g) terms; above g = 40 it is its expansion in 1 / g, within 0.1 %.
Flaws: no light between facets. For sigma 0.05, tau 2 the albedo of lobe and mirror is 1.02 at 85 degrees where F = 1.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.bsdf.models.common import (
    EXTINCTION,
    IOR,
    KD,
    Parameter,
    Values,
    above,
    cosines,
    diffuse_kd,
    fresnel,
    half_vector,
)

SOURCE = (
    "He, Torrance, Sillion, Greenberg, A comprehensive physical model for light reflection, SIGGRAPH 91; "
    "Holzschuch, Pacanowski, Demystifying the He et al. BRDF model, with the authors' erratum"
)
RECIPROCAL, ANISOTROPIC, CONSERVES = True, False, "checked by quadrature"
PARAMETERS = {
    "kd": KD,
    "sigma": Parameter(0.18, 0.005, 5.0, False, "root mean square height [um]"),
    "tau": Parameter(3.0, 0.5, 50.0, False, "correlation length [um]"),
    "n": IOR,
    "k": EXTINCTION,
}
diffuse = diffuse_kd
WAVELENGTHS = np.array([0.61, 0.55, 0.465])
_erfc = np.vectorize(math.erfc, otypes=[float])


def _cotangent(p: Values, cos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return u = tau cot / (2 sigma) and tan at cosines (n,)."""
    sine = np.sqrt(np.maximum(1e-18, 1.0 - cos * cos))
    return p["tau"] * cos / (2.0 * p["sigma"] * sine), sine / cos


def _shadowing(p: Values, cos: np.ndarray) -> np.ndarray:
    """Return S1: the share of the surface that is seen from directions of cosines (n,)."""
    u, _ = _cotangent(p, cos)
    half = 0.5 * _erfc(np.minimum(u, 26.0))
    hidden = np.exp(-np.minimum(u * u, 700.0)) / (2.0 * math.sqrt(math.pi) * u) - half
    return (1.0 - half) / (1.0 + np.maximum(0.0, hidden))


def _phase(p: Values, ci: np.ndarray, co: np.ndarray) -> np.ndarray:
    """Return g (n, 3): the squared phase difference of the heights that are seen and lit."""
    k = 0.0
    for cos in (ci, co):
        u, tangent = _cotangent(p, cos)
        k = k + tangent * _erfc(np.minimum(u, 26.0))
    target = k / math.sqrt(8.0 * math.pi)
    x = np.where(target <= 1.0, target, np.sqrt(2.0 * np.log(np.maximum(target, 1.0))))
    for _ in range(12):
        x = x - (x - target * np.exp(-0.5 * x * x)) / (1.0 + x * x)
    seen = p["sigma"] / np.sqrt(1.0 + x * x)
    return (2.0 * math.pi * (seen * (ci + co))[:, None] / WAVELENGTHS) ** 2


def _interference(g: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return sum_m exp(-g) g^m / (m! m) exp(-b / m), m = 1, 2, ..., for arrays g, b."""
    ratio = b / np.maximum(g, 1e-300)
    result = np.exp(-np.minimum(ratio, 700.0)) / np.maximum(g, 1e-300)
    result = result * (1.0 + (0.5 * ratio * ratio - 2.0 * ratio + 1.0) / np.maximum(g, 1.0))
    short = g < 40.0  # beyond, the sum is expanded in 1 / g
    gs, bs = g[short], b[short]
    total, log_term = np.zeros_like(gs), -gs
    logs = np.log(np.maximum(gs, 1e-300))
    for m in range(1, 2 + int(gs.max(initial=0.0) + 8.0 * math.sqrt(gs.max(initial=0.0)) + 8.0)):
        log_term = log_term + logs - math.log(m)
        total += np.exp(np.maximum(log_term - bs / m, -700.0)) / m
    result[short] = total
    return result


def evaluate(p: Values, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return f [1/sr] of the lobe, (n, 3)."""
    valid = above(i, o)
    result = np.zeros((len(i), 3))
    i, o = i[valid], o[valid]
    ci, co = cosines(i, o)
    v = i + o
    plane2 = v[:, 0] ** 2 + v[:, 1] ** 2
    reduced = (math.pi * p["tau"] / WAVELENGTHS) ** 2
    lobe = 0.25 * reduced * _interference(_phase(p, ci, co), plane2[:, None] * reduced)
    geometry = ((plane2 + v[:, 2] ** 2) / v[:, 2]) ** 2 * _shadowing(p, ci) * _shadowing(p, co) / (math.pi * ci * co)
    reflectance = fresnel((o * half_vector(i, o)).sum(axis=1), p["n"], p["k"])
    result[valid] = reflectance * geometry[:, None] * lobe
    return result


def mirror(p: Values, cos_i: np.ndarray) -> np.ndarray:
    """Return the albedo of the mirror, (n, 3), at cosines of incidence (n,)."""
    c = np.clip(cos_i, 1e-9, 1.0)
    coherent = np.exp(-np.minimum(_phase(p, c, c), 700.0))
    return fresnel(c, p["n"], p["k"]) * coherent * (_shadowing(p, c) ** 2)[:, None]
