"""Electric power of lamps: watts of photometric files or as stated, at the levels of the lamps; and maintenance.

Power is proportional to the level. EN 12464-1 asks for maintained illuminance: the light of electric lamps times a
maintenance factor, for ageing and dirt.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.geometry.error import luminance
from gi_core.lights.emission import Emitters
from gi_core.lights.kinds import IS_DISTANT
from gi_core.scene.types import PhotometricLight, Scene

Stated = tuple[tuple[str, float], ...]  # [W] by name of lamp


class Power(NamedTuple):
    """Power of the electric lamps of a scene."""

    of_lamp: dict[str, float]  # [W] at the present levels, of each lamp whose watts are known
    unknown: tuple[str, ...]  # names of electric lamps that shine without known watts
    area: float  # [m2] of the floor

    @property
    def total(self) -> float:
        return sum(self.of_lamp.values())

    @property
    def per_area(self) -> float:
        """Power per area of the floor [W/m2]."""
        return self.total / self.area

    def text(self) -> str:
        """Return the power of all lamps, and per area of the floor, in words."""
        text = f"{self.total:.4g} W, {self.per_area:.3g} W/m² of {self.area:.4g} m² floor"
        return f"{text}; without {', '.join(self.unknown)}, of unknown watts" if self.unknown else text


def is_electric(emitters: Emitters) -> np.ndarray:
    """Return whether lamps are neither sun nor sky, (G,) bool."""
    out = np.ones(emitters.lamps.count, bool)
    out[emitters.lamp[IS_DISTANT[emitters.kind]]] = False
    return out


def full_watts(scene: Scene, stated: Stated) -> dict[str, float]:
    """Return the watts at level 1 by lamp: as stated, or as the scene states them, or of photometric files."""
    full = dict[str, float]()
    for light in scene.lights:
        if isinstance(light, PhotometricLight) and light.watts > 0:
            full[light.name] = full.get(light.name, 0.0) + light.watts
    return full | dict(scene.watts) | dict(stated)


def power_of(emitters: Emitters, scene: Scene, levels: np.ndarray, stated: Stated, area: float) -> Power:
    """Return the power of lamps at levels (G, 3); stated: see full_watts(); area: [m2] of the floor."""
    lamps, flux, full = emitters.lamps, emitters.flux_of_lamps, full_watts(scene, stated)
    share = luminance(flux * levels) / np.maximum(luminance(flux), 1e-300)
    electric = is_electric(emitters)
    of_lamp = {name: full[name] * float(share[g]) for name, g in lamps.sources.items() if name in full}
    unknown = [name for name, g in lamps.sources.items() if name not in full and electric[g] and share[g] > 0]
    return Power(of_lamp, tuple(unknown), area)
