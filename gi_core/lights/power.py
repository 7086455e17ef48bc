"""Electric power of lamps: watts of photometric files or as stated, at the levels of the lamps; and maintenance.

Power is proportional to the level. EN 12464-1 asks for maintained illuminance: the light of electric lamps times a
maintenance factor, for ageing and dirt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gi_core.geometry.error import luminance
from gi_core.lights.emission import Emitters
from gi_core.lights.kinds import IS_DISTANT
from gi_core.scene.types import Light, PhotometricLight


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

    def per_100_lux(self, mean: float) -> float:
        """Power per area and 100 lx of a mean illuminance [lx]; inf in the dark."""
        return self.per_area / (mean / 100) if mean > 0 else np.inf


def is_electric(emitters: Emitters) -> np.ndarray:
    """Return whether lamps are neither sun nor sky, (G,) bool."""
    out = np.ones(emitters.lamps.count, bool)
    out[emitters.lamp[IS_DISTANT[emitters.kind]]] = False
    return out


def maintained(emitters: Emitters, levels: np.ndarray, factor: float) -> np.ndarray:
    """Return levels (G, 3) of lamps of which the electric ones have a maintenance factor."""
    return np.where(is_electric(emitters)[:, None], factor * levels, levels)


def full_watts(lights: Sequence[Light], stated: Mapping[str, float]) -> dict[str, float]:
    """Return the watts at level 1 by lamp, as stated or of photometric files."""
    full = dict[str, float]()
    for light in lights:
        if isinstance(light, PhotometricLight) and light.watts > 0:
            full[light.name] = full.get(light.name, 0.0) + light.watts
    return full | dict(stated)


def power_of(
    emitters: Emitters, lights: Sequence[Light], levels: np.ndarray, stated: Mapping[str, float], area: float
) -> Power:
    """Return the power of lamps at levels (G, 3); stated: watts by name, before those of photometric files."""
    lamps, flux, full = emitters.lamps, emitters.flux_of_lamps, full_watts(lights, stated)
    share = luminance(flux * levels) / np.maximum(luminance(flux), 1e-300)
    electric = is_electric(emitters)
    of_lamp = {name: full[name] * float(share[g]) for name, g in lamps.sources.items() if name in full}
    unknown = [name for name, g in lamps.sources.items() if name not in full and electric[g] and share[g] > 0]
    return Power(of_lamp, tuple(unknown), area)
