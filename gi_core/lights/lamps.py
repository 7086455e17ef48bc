"""Lamps: the lights of a scene in groups by name. Light is linear in their levels: E = sum over lamps of c_g E_g.

A lamp is a light of the scene file, or all faces of the static part with one emissive material. Lights that share a
name are one lamp. All sky lights are one lamp, since a path that leaves the scene meets them together. A scene of more
than MOST_LAMPS lamps keeps those of the largest flux; the others form one more.

Arrays of light per lamp have 3 G columns: red, green and blue of each lamp in turn. So an array of one lamp has the
shape of plain light.

Lights for path tracing are area lights, delta lights and the sky. Delta lights have no size, so no ray hits them. All
are built from the scene and not from `emission.py`: the reference shares neither sampling nor flux with photons.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import CHEAP, run_ranges
from gi_core.base.vectors import unit
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights import kinds
from gi_core.lights.area import AreaLights, area_at_levels, area_lights
from gi_core.lights.kinds import IS_DISTANT, KIND_OF, KINDS
from gi_core.lights.photometric import tables_of
from gi_core.lights.sky import Sky, sky_of
from gi_core.scene.errors import SceneError, nearest, shown
from gi_core.scene.types import Scene, SkyLight

MOST_LAMPS = 16
OTHERS = "other lamps"
BRIGHTEST = 1000.0  # times the flux of the scene file


class Lamps(NamedTuple):
    """Lamps of a scene."""

    names: tuple[str, ...]  # (G,), at least one
    sources: Mapping[str, int]  # lamp by name of light or emissive material
    dark: frozenset[str] = frozenset()  # names of lights without flux, whose levels change nothing

    @property
    def count(self) -> int:
        """Number of lamps, G."""
        return len(self.names)

    @property
    def channels(self) -> int:
        """Columns of light per lamp, 3 G."""
        return 3 * len(self.names)

    def full(self) -> np.ndarray:
        """Return the levels (G, 3) of the scene file: 1 everywhere."""
        return np.ones((len(self.names), 3))

    def changed(self, levels: np.ndarray, changes: Mapping[str, float | Sequence[float]], where: str) -> np.ndarray:
        """Return levels (G, 3) with some lamps changed: name -> a factor >= 0, or three for RGB.

        Raises SceneError, with `where` in front, for a name that no lamp has, and for a bad factor.
        """
        out = levels.copy()
        for name, level in changes.items():
            if name in self.dark:
                continue
            if name not in self.names:
                raise SceneError(f"{where}: no lamp is called {shown(name)}; {nearest(name, self.names)}")
            out[self.names.index(name)] = _checked(level, f"{where}: lamp {shown(name)}")
        return out


def _checked(level, where: str) -> np.ndarray:
    try:
        values = np.asarray(level, np.float64)
    except (TypeError, ValueError, OverflowError):  # 10**400
        values = np.empty(0)
    good = values.shape in ((), (3,)) and np.isfinite(values).all() and (values >= 0).all()
    if not (good and (values <= BRIGHTEST).all()):
        rule = f"a level is a number from 0 to {BRIGHTEST:g}, or three of them for red, green and blue"
        raise SceneError(f"{where}: {rule}, got {shown(level)}")
    return values


def sky_name(scene: Scene) -> str:
    """Return the name that all sky lights share: that of the first."""
    return next((light.name for light in scene.lights if isinstance(light, SkyLight)), "sky")


def lamps_of(names: Sequence[str], flux: np.ndarray) -> Lamps:
    """Return the lamps of emitters with these names and fluxes (E, 3) [W], in order of appearance."""
    total: dict[str, float] = {}
    for name, emitted in zip(names, flux, strict=True):
        total[name] = total.get(name, 0.0) + float(emitted.max())
    kept = sorted(total, key=lambda name: (name == OTHERS, -total[name]))[
        :MOST_LAMPS
    ]  # a lamp so called joins the others
    if len(total) == MOST_LAMPS + 1:
        kept = list(total)  # one more lamp either way
    order = [name for name in total if name in kept]
    sources = {name: order.index(name) if name in kept else len(order) for name in total}
    pooled = (OTHERS,) if len(order) < len(total) else ()
    return Lamps((*order, *pooled) or ("no lamp",), sources)


@inlined
def mixed(light, row, levels):
    """Return red, green and blue of a row of light per lamp (n, 3 G), at levels (G, 3)."""
    x = y = z = 0.0
    for g in range(len(levels)):
        x += levels[g, 0] * light[row, 3 * g]
        y += levels[g, 1] * light[row, 3 * g + 1]
        z += levels[g, 2] * light[row, 3 * g + 2]
    return x, y, z


def sum_of_lamps(light: np.ndarray) -> np.ndarray:
    """Return light (n, 3) of light per lamp (n, 3 G), at the levels of the scene file."""
    return light if light.shape[1] == 3 else mix(light, np.ones((light.shape[1] // 3, 3)))


def mix(light: np.ndarray, levels: np.ndarray, threads: int = 1) -> np.ndarray:
    """Return light (n, 3) float64 of light per lamp (n, 3 G), at levels (G, 3)."""
    out = np.empty((len(light), 3))
    run_ranges(lambda _, first, last: _mix(light, levels, first, last, out), len(out), threads, CHEAP)
    return out


def irradiance_at(
    sums: np.ndarray, levels: np.ndarray, flux_unit: float, area: np.ndarray, threads: int = 1
) -> np.ndarray:
    """Return E (R, 3) [W/m2] at levels (G, 3), of sums (R, 3 G) of flux units [W] over areas (R,) [m2]."""
    out = np.empty((len(area), 3))
    run_ranges(lambda _, *rows: read_out(sums, levels, flux_unit, area, *rows, out), len(out), threads, CHEAP)
    return out


@kernel
def _mix(light, levels, first, last, out):
    for r in range(first, last):
        out[r, 0], out[r, 1], out[r, 2] = mixed(light, r, levels)


@kernel
def read_out(sums, levels, flux_unit, area, first, last, out):
    """Write irradiance of receivers first .. last - 1, as irradiance_at()."""
    for r in range(first, last):
        # Area 0: no light can reach the receiver, or it has no face.
        factor = flux_unit / area[r] if area[r] > 0.0 else 0.0
        x, y, z = mixed(sums, r, levels)
        out[r, 0], out[r, 1], out[r, 2] = x * factor, y * factor, z * factor


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
