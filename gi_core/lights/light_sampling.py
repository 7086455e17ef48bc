"""Lights for path tracing: area lights, delta lights, the sky.

Delta lights have no size, so no ray hits them. All are built from the scene and not from `emission.py`: the reference
shares neither sampling nor flux with photons.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import unit
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights import kinds
from gi_core.lights.area import AreaLights, area_at_levels, area_lights
from gi_core.lights.kinds import IS_DISTANT, KIND_OF, KINDS
from gi_core.lights.lamps import Lamps, sky_name
from gi_core.lights.photometric import tables_of
from gi_core.lights.sky import Sky, sky_of
from gi_core.scene.types import Scene


class DeltaLights(NamedTuple):
    """Delta lights: point, spot, directional, and luminaires without a size."""

    kind: np.ndarray  # (D,) int64
    parameters: np.ndarray  # (D, 12) float64, see `kinds.py`
    value: np.ndarray  # (D, 3) float64: intensity [W/sr], irradiance on a facing plane [W/m2], flux of a luminaire [W]
    lamp: np.ndarray  # (D,) int64
    tables: np.ndarray  # (n,) float64, see `photometric.py`

    @property
    def distant(self) -> np.ndarray:
        """Whether the light comes from a direction, (D,) bool."""
        return IS_DISTANT[self.kind]

    def none(self) -> DeltaLights:
        """Return no lights."""
        return DeltaLights(*(a[:0] for a in self[:4]), self.tables)

    @property
    def suns(self) -> int:
        """Directional lights."""
        return int(np.count_nonzero(self.kind == kinds.SUN))

    @property
    def place(self) -> np.ndarray:
        """Position [m], or the unit direction towards a distant light, (D, 3) float64."""
        return np.where(self.distant[:, None], -self.parameters[:, 3:6], self.parameters[:, :3])


class Lights(NamedTuple):
    """All lights of a scene, by sampling method. Estimates have 3 channels per lamp."""

    area: AreaLights
    delta: DeltaLights
    sky: Sky
    lamps: int

    @property
    def channels(self) -> int:
        """Columns of estimates."""
        return 3 * self.lamps


def lights_of(scene: Scene, surfaces: Surfaces, lamps: Lamps) -> Lights:
    """Collect the lights of a scene, apart by lamp."""
    of_material = np.array([lamps.sources.get(m.name, 0) for m in scene.materials], np.int64)
    of_light = np.array([lamps.sources.get(light.name, 0) for light in scene.lights], np.int64)
    area = area_lights(surfaces, of_material[scene.static.face_material], scene, of_light)
    sky = sky_of(scene, lamps.sources.get(sky_name(scene), 0))
    return Lights(area, delta_lights(scene, of_light), sky, lamps.count)


def lamps_at(lights: Lights, levels: np.ndarray) -> Lights:
    """Return the lights of each lamp at levels (G, 3) of the lamps; faces are chosen in proportion to flux again."""
    delta, sky = lights.delta, lights.sky
    delta = delta._replace(value=delta.value * levels[delta.lamp])
    sky = sky._replace(radiance=sky.radiance * levels[sky.lamp])
    return lights._replace(area=area_at_levels(lights.area, levels), delta=delta, sky=sky)


def at_levels(lights: Lights, levels: np.ndarray) -> Lights:
    """Return all lights as one lamp, at levels (G, 3) of the lamps; faces are chosen in proportion to flux again."""
    if lights.lamps == 1 and (levels == 1).all():
        return lights
    of = lamps_at(lights, levels)
    area = of.area._replace(lamp=np.zeros_like(of.area.lamp))
    return Lights(area, of.delta._replace(lamp=np.zeros_like(of.delta.lamp)), of.sky._replace(lamp=0), 1)


def delta_lights(scene: Scene, lamp: np.ndarray | None = None) -> DeltaLights:
    """Collect the delta lights of a scene; lamp: of each of its lights."""
    rows = []
    tables, starts = tables_of(scene.lights)
    for i, light in enumerate(scene.lights):
        number = KIND_OF[type(light)]
        if (value := KINDS[number].value(light)) is not None:
            at = kinds.parameters(light, kinds.Surroundings(np.zeros(3), 0.0, unit(scene.up)), starts[i])
            rows.append((number, at, value, 0 if lamp is None else lamp[i]))
    kind, parameters, values, lamps = zip(*rows, strict=True) if rows else ((),) * 4
    return DeltaLights(
        np.array(kind, np.int64),
        np.array(parameters, np.float64).reshape(-1, kinds.WIDTH),
        np.array(values, np.float64).reshape(-1, 3),
        np.array(lamps, np.int64),
        tables,
    )
