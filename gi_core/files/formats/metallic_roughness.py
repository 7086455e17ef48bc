"""Gloss by base colour, metallic and roughness, as glTF 2.0 (appendix B) defines them; alpha is roughness squared.

glTF mixes a metal and a plastic: metallic m of the light meets the metal, the rest a coat over the base colour. One
lobe has the F of the mixture. Its base is the one with which the mixture reflects the sum of both parts
(docs/decisions/metal-and-plastic.md).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.bsdf.ggx import base_albedo, further_albedo, under_gloss
from gi_core.geometry.texture_filter import MOST_REFLECTANCE
from gi_core.scene.pose import three
from gi_core.scene.types import Gloss, Material

COAT = 0.04  # reflected share of light along the normal of the part that is no metal, in glTF
MATTE = 0.5  # roughness from which gloss that is no metal's is left out: exporters write 0.5 where nothing was chosen
MOST_COAT = 0.2  # of a grey coat of another index of refraction; more is metal's


def metallic_roughness(
    material: Material,
    metallic: float,
    roughness: float,
    f0: float | np.ndarray = COAT,
    f90: float = 1.0,
    colour: np.ndarray | None = None,
) -> Material:
    """Return a glossy material from its base colour, the given reflectance.

    f0, f90: of the part that is no metal; colour (3,): of metal, None: the base colour.
    """
    base = np.asarray(material.reflectance)
    metal = metallic * np.clip(base if colour is None else colour, 0, 1)
    coat = np.broadcast_to(np.minimum(f0, 1.0), 3)
    alpha, mixed = roughness * roughness, metal + (1 - metallic) * coat
    gloss = Gloss(three(mixed), alpha, metallic + (1 - metallic) * f90)
    if metallic > 0:
        parts = metallic * _base(base, metal / metallic, 1.0, alpha, 0.0) + (1 - metallic) * _base(
            base, coat, f90, alpha
        )
        further, through = _further(mixed, gloss.f90, alpha), _passed(mixed, gloss.f90, alpha)
        base = np.clip((parts - further) / np.maximum(through - further, 1e-9), 0, MOST_REFLECTANCE)
    return material._replace(reflectance=three(base), gloss=gloss, varied=None)


def _base(reflectance: np.ndarray, f0: np.ndarray, f90: float, alpha: float, share: float = 1.0) -> np.ndarray:
    """Return base_albedo() (3,) of one lobe over a share of a reflectance (3,)."""
    return base_albedo(np.array([[*f0, f90, alpha]]), share * reflectance[None])[0]


def _further(f0: np.ndarray, f90: float, alpha: float) -> np.ndarray:
    return further_albedo(np.array([[*f0, f90, alpha]]))[0]


def _passed(f0: np.ndarray, f90: float, alpha: float) -> float:
    """Return the share of light that a lobe lets through to its base."""
    return max(float(under_gloss(np.array([[*f0, f90, alpha]]))[0]), 1e-9)


def is_diffuse(metallic: float, roughness: float, f90: float, matte: float = MATTE) -> bool:
    """Return whether the gloss of a material is left out."""
    return metallic < 0.02 and (roughness >= matte or f90 == 0)  # less metal than 0.02 is taken as none


class MetalRough(NamedTuple):
    """A glossy surface as glTF describes it; `ior` is that of the part that is no metal."""

    base: np.ndarray  # (3,) float64, base colour
    metallic: float
    roughness: float
    ior: float


def as_metal_rough(reflectance: np.ndarray, gloss: Gloss) -> MetalRough:
    """Return base colour, metallic and roughness of a surface: metallic_roughness() inverted.

    reflectance (3,): of the diffuse base. A grey gloss up to MOST_COAT is a coat. Any other is a mixture of metal and a
    coat of COAT, exact for surfaces that were described so.
    """
    rho, f0, roughness = np.array(reflectance, np.float64), np.array(gloss.f0), math.sqrt(gloss.alpha)
    f = float(f0.mean())
    if np.ptp(f0) < 1e-6 and f <= MOST_COAT:
        return MetalRough(rho, 0.0, roughness, (1 + math.sqrt(f)) / (1 - math.sqrt(f)))
    # f = m b + (1 - m) COAT for the base colour b, and the coat alone would have to cover (1 - m) b.
    coat, further = np.full(3, COAT), _further(f0, gloss.f90, gloss.alpha)
    whole = further + (_passed(f0, gloss.f90, gloss.alpha) - further) * rho
    share, metallic, base = _passed(coat, 1.0, gloss.alpha) - _further(coat, 1.0, gloss.alpha), 1.0, f0
    for _ in range(40):  # 40 rounds part a surface into metal and coat to 1e-9
        parts = metallic * _further(base, 1.0, gloss.alpha) + (1 - metallic) * _further(coat, 1.0, gloss.alpha)
        rho = np.maximum(whole - parts, 0) / share
        both = float(rho.mean()) + f
        rest = (both - math.sqrt(max(both * both - 4 * COAT * float(rho.mean()), 0.0))) / (2 * COAT)
        metallic = 1 - min(max(rest, 0.0), 1.0)
        base = np.clip((f0 - (1 - metallic) * COAT) / max(metallic, 1e-9), 0, 1)
    return MetalRough(base if metallic > 0.5 else np.clip(rho / (1 - metallic), 0, 1), metallic, roughness, 1.5)
