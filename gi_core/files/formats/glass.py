"""Panes of the formats: transmission, blending and dissolving become thin glass, in one way for all formats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gi_core.scene.pose import three
from gi_core.scene.rules import MOST_IOR
from gi_core.scene.types import Material, Pane

MOST_COVER = 0.9  # opacity from which a blended surface is taken as opaque ...
LEAST_TRANSMISSION = 0.5  # ... and transmission below which one is: its diffuse part is the larger one


def transmitting(material: Material, colour: Sequence[float], ior: float = Pane().ior) -> Material:
    """Return a material as a pane of internal transmittance `colour` (3,) in [0, 1]; ior < 1: the usual one."""
    passes = three(np.clip(np.asarray(colour, np.float64), 0.0, 1.0))
    return material.as_pane(Pane(passes, min(ior, MOST_IOR) if ior >= 1 else Pane().ior))


def behind_cover(cover: float, colour: Sequence[float]) -> np.ndarray:
    """Return the transmittance (3,) of a surface of some opacity: what it covers is filtered by its colour (3,)."""
    return 1 - cover * (1 - np.asarray(colour, np.float64))
