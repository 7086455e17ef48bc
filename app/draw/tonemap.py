"""Linear radiance to display values: exposure, white balance, tone map, sRGB; colours of pixels without light.

The gains of white balance turn the light of a scene's lamps neutral, as a camera's white balance does. They keep the
luminance of white surfaces, so exposure does not depend on them. False colours, errors and numbers have no gains.

The fragment shader does the same arithmetic in the same order (exposure, tone map, sRGB encode, once each);
`tests/unit/draw/test_tonemap.py` compares both.
"""

from __future__ import annotations

import numpy as np

from app.settings import DEFAULT_TONE_MAP
from gi_core.geometry.error import luminance

BACKGROUND = (0.145, 0.15, 0.16)  # lighter than a black patch
UNLIT = (0.24, 0.245, 0.255)  # the back of a one-sided face, without culling
Gains = tuple[float, float, float]
NEUTRAL: Gains = (1.0, 1.0, 1.0)


def clip(c: np.ndarray) -> np.ndarray:
    """Return c clipped to [0, 1] per channel."""
    return np.clip(c, 0.0, 1.0)


def reinhard(c: np.ndarray) -> np.ndarray:
    """Return c / (1 + luminance): keeps hue; clipped at 1 (Reinhard et al. 2002, Eq. 3)."""
    return np.clip(c / (1.0 + luminance(c)[..., None]), 0.0, 1.0)


def aces(c: np.ndarray) -> np.ndarray:
    """Return the filmic curve of the ACES reference rendering as fitted by Narkowicz 2015, per channel.

    The fit applies to 0.6 of the exposure; without the factor mid-grey comes out twice as bright.
    """
    c = 0.6 * c
    return np.clip(c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14), 0.0, 1.0)


AGX_IN = np.array([[0.842479062253094, 0.0784335999999992, 0.0792237451477643],
                   [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
                   [0.0423756549057051, 0.0784336, 0.879142973793104]])  # fmt: skip
AGX_OUT = np.array([[1.19687900512017, -0.0980208811401368, -0.0990297440797205],
                    [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
                    [-0.0529716355144438, -0.0980434501171241, 1.15107367264116]])  # fmt: skip


def agx(c: np.ndarray) -> np.ndarray:
    """Return AgX (Sobotka 2022) by the polynomial of Wrensch 2023: a curve over stops, bright colours turn white."""
    low, high = -12.47393, 4.026069  # log2 of the darkest and the brightest value
    stops = np.clip(np.log2(np.maximum(c @ AGX_IN.T, 2.0**low)), low, high)
    curve = 15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232  # a polynomial, highest power first
    encoded = np.polyval(curve, (stops - low) / (high - low)) @ AGX_OUT.T
    return np.clip(encoded, 0.0, 1.0) ** 2.2


def neutral(c: np.ndarray) -> np.ndarray:
    """Return Khronos PBR Neutral (2024): colours as they are, less 4 % of reflected white; highlights compressed."""
    neutral_start = 0.8 - 0.04
    low = c.min(axis=-1, keepdims=True)
    c = c - np.where(low < 0.08, low - 6.25 * low * low, 0.04)
    peak = np.maximum(c.max(axis=-1, keepdims=True), 1e-12)
    d = 1.0 - neutral_start
    new = 1.0 - d * d / np.maximum(peak + d - neutral_start, d)
    white = 1.0 - 1.0 / (0.15 * (peak - new) + 1.0)
    return np.clip(np.where(peak < neutral_start, c, (1.0 - white) * c * (new / peak) + white * new), 0.0, 1.0)


TONE_MAPS = {"agx": agx, "neutral": neutral, "aces": aces, "reinhard": reinhard, "clip": clip}


def srgb_encode(c: np.ndarray) -> np.ndarray:
    """Return sRGB values in [0, 1] of linear values in [0, 1] (IEC 61966-2-1)."""
    return np.where(c <= 0.0031308, 12.92 * c, 1.055 * np.maximum(c, 0.0031308) ** (1 / 2.4) - 0.055)


def srgb_decode(c: np.ndarray) -> np.ndarray:
    """Return linear values in [0, 1] of sRGB values in [0, 1]."""
    return np.where(c <= 0.04045, c / 12.92, ((np.maximum(c, 0.04045) + 0.055) / 1.055) ** 2.4)


def to_display(
    radiance: np.ndarray, exposure: float, tone_map: str = DEFAULT_TONE_MAP, gains: Gains = NEUTRAL
) -> np.ndarray:
    """Return sRGB bytes (..., 3) uint8 of linear radiance (..., 3) at an exposure [EV]: a stop doubles.

    gains: of the white balance, per channel.
    """
    c = TONE_MAPS[tone_map](np.maximum(radiance, 0.0) * (2.0**exposure * np.array(gains)))
    return np.round(srgb_encode(c) * 255).astype(np.uint8)


def meter(radiance: np.ndarray, weights: np.ndarray | None = None) -> float:
    """Return the exposure [EV] that puts the weighted median of lit luminance at mid-grey.

    `radiance` (n, 3) linear, `weights` (n,) >= 0 (area or solid angle). Lamps may saturate: they are a small share of
    the weight. Without light: 0.
    """
    L = luminance(radiance)
    w = np.ones(len(L)) if weights is None else np.asarray(weights, np.float64)
    total = w.sum()
    if not total > 0 or not (L * w).sum() > 0:
        return 0.0
    lit = (L > 1e-4 * (L * w).sum() / total) & (w > 0)  # points darker than 1e-4 of the mean luminance do not count
    order = np.argsort(L[lit])
    L, share = L[lit][order], np.cumsum(w[lit][order])
    median, high = (L[np.searchsorted(share, q * share[-1])] for q in (0.5, 0.95))
    # A 95th percentile of at most 2, linear, keeps a spot-lit stage from saturating.
    # The median becomes middle grey, linear, before the tone map.
    return float(min(np.log2(0.18 / median), np.log2(2.0 / high)))


def view_weights(
    positions: np.ndarray, normals: np.ndarray, areas: np.ndarray, eye, target, vertical_fov_degrees: float
) -> np.ndarray:
    """Return the solid angle (n,) [sr] of each receiver in a camera's view, without occlusion.

    A receiver counts inside the cone around the view axis through the picture's corners, if it faces the eye.
    """
    to_eye = np.asarray(eye, np.float64) - positions
    distance2 = np.maximum((to_eye * to_eye).sum(axis=1), 1e-12)
    axis = np.asarray(target, np.float64) - np.asarray(eye, np.float64)
    axis = axis / np.linalg.norm(axis)
    along = -(to_eye * axis).sum(axis=1) / np.sqrt(distance2)
    facing = np.maximum((to_eye * normals).sum(axis=1), 0) / np.sqrt(distance2)
    corner = 1.6 * np.tan(np.radians(vertical_fov_degrees) / 2)  # half diagonal of a picture a little wider than high
    inside = along > 1 / np.sqrt(1 + corner * corner)
    # Lower limit of a tenth of the mean distance: else one near receiver would dominate.
    floor = 0.01 * float(distance2.mean())
    return np.where(inside, areas * facing / np.maximum(distance2, floor), 0.0)


def gains_for(flux: np.ndarray) -> Gains:
    """Return gains for lamps of a total flux (3,) [W]; NEUTRAL without light."""
    if not (total := float(luminance(flux))) > 0:
        return NEUTRAL
    gains = total / np.maximum(flux, total / 4.0)  # largest gain: stage light of one colour keeps its colour
    red, green, blue = (gains * total / float(luminance(gains * flux))).tolist()
    return red, green, blue
