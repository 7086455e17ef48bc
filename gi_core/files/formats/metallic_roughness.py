"""Gloss by base colour, metallic and roughness, as glTF 2.0 (appendix B) defines them; alpha is roughness squared.

glTF mixes a metal and a plastic: metallic m of the light meets the metal, the rest a coat over the base colour. One
lobe has the F of the mixture. It would let 1 - F of the mixture through to the base, less than the coat does alone.
The base's reflectance is therefore larger by the ratio of both (docs/decisions/038).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.bsdf.ggx import under_gloss
from gi_core.scene.pose import three
from gi_core.scene.types import Gloss, Material

COAT = 0.04  # reflected share of light along the normal of the part that is no metal, in glTF
DULL = 0.9  # roughness above which metal is diffuse too: facets that reflect several times return its colour
LEAST_METAL = 0.02  # less is taken as none
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
    share = (1 - metallic) * (_passed(coat, f90, alpha) / _passed(mixed, gloss.f90, alpha) if 0 < metallic < 1 else 1.0)
    return material._replace(reflectance=three(min(share, 1.0) * base), gloss=gloss, varied=None)


def _passed(f0: np.ndarray, f90: float, alpha: float) -> float:
    """Return the share of light that a lobe lets through to its base."""
    return max(float(under_gloss(np.array([[*f0, f90, alpha]]))[0]), 1e-9)


def is_diffuse(metallic: float, roughness: float, f90: float, matte: float = MATTE) -> bool:
    """Return whether the gloss of a material is left out."""
    return roughness > DULL or (metallic < LEAST_METAL and (roughness >= matte or f90 == 0))


class MetalRough(NamedTuple):
    """A glossy surface as glTF describes it; `ior` is that of the part that is no metal."""

    base: np.ndarray  # (3,) float64, base colour
    metallic: float
    roughness: float
    ior: float


def as_metal_rough(reflectance: np.ndarray, gloss: Gloss) -> MetalRough:
    """Return base colour, metallic and roughness of a surface: metallic_roughness() inverted.

    reflectance (3,): of the diffuse base. A grey gloss up to MOST_COAT is a coat, any other is a mixture of metal and a
    coat of COAT, exact for surfaces that were described so.
    """
    rho, f0, roughness = np.array(reflectance, np.float64), np.array(gloss.f0), math.sqrt(gloss.alpha)
    f = float(f0.mean())
    if np.ptp(f0) < 1e-6 and f <= MOST_COAT:
        return MetalRough(rho, 0.0, roughness, (1 + math.sqrt(f)) / (1 - math.sqrt(f)))
    # f = m / (1 - m) rho + (1 - m) COAT, for the share 1 - m and rho under the coat alone.
    rho *= _passed(f0, gloss.f90, gloss.alpha) / _passed(np.full(3, COAT), 1.0, gloss.alpha)
    both = float(rho.mean()) + f
    rest = (both - math.sqrt(max(both * both - 4 * COAT * float(rho.mean()), 0.0))) / (2 * COAT)
    metallic = 1 - min(max(rest, 0.0), 1.0)
    base = f0 if metallic == 1 else np.clip(rho / (1 - metallic), 0, 1)
    return MetalRough(base, metallic, roughness, 1.5)
