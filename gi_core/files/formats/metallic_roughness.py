"""Gloss by base colour, metallic and roughness, as glTF 2.0 (appendix B) defines them; alpha is roughness squared."""

from __future__ import annotations

import numpy as np

from gi_core.scene.pose import three
from gi_core.scene.types import Gloss, Material


def metallic_roughness(
    material: Material,
    metallic: float,
    roughness: float,
    f0: float | np.ndarray = 0.04,
    f90: float = 1.0,
    colour: np.ndarray | None = None,
) -> Material:
    """Return a glossy material from its base colour, the given reflectance.

    f0, f90: of the part that is no metal; colour (3,): of metal, None: the base colour.
    """
    base = np.asarray(material.reflectance)
    metal = metallic * np.clip(base if colour is None else colour, 0, 1)
    coat = (1 - metallic) * np.broadcast_to(np.minimum(f0, 1.0), 3)
    gloss = Gloss(three(metal + coat), roughness * roughness, metallic + (1 - metallic) * f90)
    return material._replace(reflectance=three((1 - metallic) * base), gloss=gloss)
