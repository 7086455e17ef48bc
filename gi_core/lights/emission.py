"""Emission of photon i: light, origin, direction and flux (report Alg. 2.3.1).

The report distributes N photons over the lights in proportion to flux, so photon i depends on N. Here a coordinate of
the Sobol sequence picks the light, so photon i depends on (seed, i) alone.

Photons of the sun and the sky start mostly where their light meets receivers. A room that is lit by a window receives
1 % of the flux that such a light must emit. Its emission numbers, which are uniform in [0, 1)^4, are divided into
cells. Rays measure the share h of a cell's photons that hits a side with receivers. A cell is drawn with the density

    p = (1 - EVEN) sqrt(h + m) / mean + EVEN

where m is the mean h of the cells around, and a photon from it carries 1 / p of its flux: expectations are the same.
The root minimises the variance of the light that arrives, where a cell holds both fates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.fixed_point import UNITS
from gi_core.base.jit import kernel
from gi_core.base.random_numbers import picked
from gi_core.base.vectors import unit
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.kinds import AREA, IS_DISTANT, KIND_OF, KINDS, PHOTOMETRIC, SKY, SUN, WIDTH, Surroundings, emitted
from gi_core.lights.kinds import parameters as parameters_of
from gi_core.lights.lamps import Lamps, lamps_of, sky_name
from gi_core.lights.photometric import TABLE, tables_of
from gi_core.lights.sky import patches, table_of
from gi_core.scene.types import UNIFORM_SKY, Scene, SkyLight

EVEN = 0.1  # share of photons that starts evenly: 1e-4 of the light that arrives comes from cells without hits
CELL_RAYS = 4  # 16 win nothing
# Cells of numbers (s, t, u, v): of the direction, and of the place. 295,000 cells in place of 37,000: 0.21, not 0.16 of
# photons count in a room with one window, and the rays take 0.1 s.
CELLS = {SKY: (12, 24, 8, 16), SUN: (1, 1, 32, 128)}

Hits = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class Guide:
    """`arriving`, `landing`: shares of a light's flux that hit receivers, any face; `table` (n,): for guided()."""

    def __init__(self, kind: int, parameters: np.ndarray, tables: np.ndarray, hits: Hits):
        """hits(origin (n, 3) [m], direction (n, 3) unit): whether rays meet sides with receivers, any, (n,) bool."""
        self.shape = CELLS[kind]
        cells = int(np.prod(self.shape))
        low = np.stack(np.unravel_index(np.repeat(np.arange(cells), CELL_RAYS), self.shape), axis=1)
        numbers = (low + np.random.default_rng(0).random(low.shape)) / self.shape
        origin, direction = np.empty((2, len(numbers), 3), np.float32)
        _emit_all(kind, parameters, tables, numbers, origin, direction)
        meets, lands = hits(origin, direction)
        share = meets.reshape(cells, CELL_RAYS).mean(axis=1).reshape(self.shape)
        self.arriving, self.landing = float(meets.mean()), float(lands.mean())
        mean = (wanted := np.sqrt(share + _mean_around(share))).mean()
        self.table = _conditional((1 - EVEN) * wanted / mean + EVEN if mean > 0 else np.ones(self.shape))


@kernel
def _emit_all(kind, parameters, tables, numbers, origin, direction):
    for k in range(len(numbers)):
        s, t, u, v = numbers[k, 0], numbers[k, 1], numbers[k, 2], numbers[k, 3]
        start, way = emitted(kind, parameters, tables, u, v, s, t)
        for c in range(3):
            origin[k, c], direction[k, c] = start[c], way[c]


def _mean_around(share: np.ndarray) -> np.ndarray:
    """Return the mean of each cell and its neighbours: axes 1 and 3 are angles, the others end."""
    for axis in np.flatnonzero(np.array(share.shape) > 1):
        widths = [(1, 1) if a == axis else (0, 0) for a in range(share.ndim)]
        wide = np.pad(share, widths, "wrap" if axis in (1, 3) else "edge")
        n = share.shape[axis]
        share = sum(wide.take(range(k, k + n), axis) for k in range(3)) / 3
    return share


def _conditional(density: np.ndarray) -> np.ndarray:
    """Return the shape of the cells, and for each axis the running shares of its cells given those of earlier axes."""
    parts = [np.array(density.shape, np.float64)]
    for axis in range(density.ndim):
        mass = density.sum(axis=tuple(range(axis + 1, density.ndim))).reshape(-1, density.shape[axis])
        cdf = np.cumsum(mass, axis=1) / mass.sum(axis=1, keepdims=True)
        cdf[:, -1] = 1.0
        parts.append(cdf.reshape(-1))
    return np.concatenate(parts)


@kernel
def guided(table, s, t, u, v):
    """Return four numbers in [0, 1) drawn by a guide's table from uniform ones, and the flux 1 / p of their photon."""
    at, cell, flux = 4, 0, 1.0
    s, at, cell, flux = _drawn(table, 0, at, cell, flux, s)
    t, at, cell, flux = _drawn(table, 1, at, cell, flux, t)
    u, at, cell, flux = _drawn(table, 2, at, cell, flux, u)
    v, at, cell, flux = _drawn(table, 3, at, cell, flux, v)
    return s, t, u, v, min(flux, 1.0 / EVEN)


@kernel
def _drawn(table, axis, at, cell, flux, x):
    """Return number x drawn along an axis, where the next axis begins in the table, the cell and its flux."""
    n, rows = int(table[axis]), 1
    for a in range(axis):
        rows *= int(table[a])
    cdf = table[at + cell * n : at + (cell + 1) * n]
    k = picked(cdf, x)
    before = cdf[k - 1] if k > 0 else 0.0
    share = cdf[k] - before
    x = (k + min((x - before) / share, 1.0)) / n
    return x, at + rows * n, cell * n + k, flux / (n * share)


NO_FACE = -1  # start of a path in free space
SPARE = 0.1  # share of photons that stays shared by flux, so that lamps that are off keep some
FEW = 0.25  # share of photons by flux that count, below which a lamp's are guided, and lamps share them by levels


class Emitters(NamedTuple):
    """Emitters: one per emissive face, one per other light."""

    kind: np.ndarray  # (E,) int64, into KINDS
    parameters: np.ndarray  # (E, 12) float64, see `kinds.py`; of faces see `area.emit`
    face: np.ndarray  # (E,) int64, global face of an area emitter, else NO_FACE
    flux: np.ndarray  # (E, 3) float64 [W]
    cdf: np.ndarray  # (E,) float64, running share of the photons, ends at 1
    units: np.ndarray  # (E, 3) int64, flux of one photon of this emitter in fixed-point units
    unit_flux: float  # watts per fixed-point unit, times the number of photons, of a lamp of scale 1
    scale: np.ndarray  # (G,) float64, of the unit of each lamp's photons; 1 where photons are shared by flux
    lamp: np.ndarray  # (E,) int64, lamp of each emitter
    lamps: Lamps
    tables: np.ndarray  # (n,) float64, of luminaires and skies, see `photometric.py`, `sky.py`
    arriving: np.ndarray  # (G,) float64, share of each lamp's flux that meets receivers, in powers of 4; 1: not guided
    guides: np.ndarray  # (m,) float64, of guided emitters, see Guide
    guide: np.ndarray  # (E, 2) int64, first and last of an emitter's numbers among `guides`

    @property
    def total_flux(self) -> np.ndarray:
        return self.flux.sum(axis=0)

    @property
    def flux_of_lamps(self) -> np.ndarray:
        """Flux of each lamp, (G, 3) [W]."""
        out = np.zeros((self.lamps.count, 3))
        np.add.at(out, self.lamp, self.flux)
        return out

    @property
    def shares(self) -> np.ndarray:
        """Share of each lamp of the photons, (G,)."""
        return np.bincount(self.lamp, np.diff(self.cdf, prepend=0.0), self.lamps.count)

    @property
    def shares_of_flux(self) -> np.ndarray:
        """Share of each lamp of the flux, (G,), by its largest channel."""
        largest = self.flux.max(axis=1)
        return np.bincount(self.lamp, largest, self.lamps.count) / largest.sum()

    @property
    def shares_of_arriving(self) -> np.ndarray:
        """Share of each lamp of the flux that arrives, (G,)."""
        arriving = self.shares_of_flux * self.arriving
        return arriving / arriving.sum()

    def shares_at(self, levels: np.ndarray) -> np.ndarray:
        """Return the shares (G,) of the lamps by flux at levels (G, 3), not all 0, in powers of 4.

        SPARE of the photons stay shared as at full levels. A slider changes the shares only where it crosses a power.
        """
        flux = self.shares_of_arriving * levels.max(axis=1)
        power = np.frexp(flux)[1] // 2 * 2  # exact, so that the same levels give the same bits
        at = np.where(flux > 0, np.ldexp(1.0, power), 0.0)
        return (1 - SPARE) * at / at.sum() + SPARE * self.shares_of_arriving

    def shared(self, shares: np.ndarray) -> Emitters:
        """Return emitters whose lamps emit these shares (G,) > 0 of the photons; they sum to 1. Fluxes stay."""
        largest = self.flux.max(axis=1)
        of_lamp = np.bincount(self.lamp, largest, self.lamps.count)
        cdf = np.cumsum(shares[self.lamp] * (largest / of_lamp[self.lamp]))
        cdf[-1] = 1.0
        return self._replace(cdf=cdf, scale=self.shares_of_flux / shares / np.where(self.arriving < 1.0, EVEN, 1.0))

    def guided(self, guide_of: Callable[[int, np.ndarray, np.ndarray], Guide]) -> Emitters:
        """Return emitters whose distant lamps emit mostly light that meets receivers, where little does.

        guide_of: returns the guide of a kind of emitter, its parameters, and all tables. Fluxes stay.
        """
        distant = np.flatnonzero(IS_DISTANT[self.kind])
        guides = {e: guide_of(int(self.kind[e]), self.parameters[e], self.tables) for e in distant}
        if not guides:
            return self
        share, largest = np.ones((3, len(self.kind))), self.flux.max(axis=1)
        share[:2, list(guides)] = np.array([(g.arriving, g.landing) for g in guides.values()]).T
        met, landed, sent = (np.bincount(self.lamp, s * largest, self.lamps.count) for s in share)
        power = np.frexp(np.maximum(met / sent, 1e-3))[1] // 2 * 2  # an edit changes shares across a power only
        arriving = np.where(met < FEW * landed, np.ldexp(1.0, power), 1.0)
        if not (few := arriving < 1.0).any():
            return self
        tables = [guides[e].table if e in guides and few[g] else np.zeros(0) for e, g in enumerate(self.lamp)]
        ends = np.cumsum([0, *map(len, tables)])
        units = np.rint(self.units * np.where(few[self.lamp], EVEN, 1.0)[:, None]).astype(np.int64)
        other = self._replace(units=units, arriving=arriving, guides=np.concatenate(tables))
        return other._replace(guide=np.stack([ends[:-1], ends[1:]], axis=1)).shared(other.shares_of_arriving)

    def effective(self, levels: np.ndarray) -> float:
        """Return the share of photons that count at levels (G, 3): 1 where each carries the same flux (Kish 1965).

        Of guided lamps, the flux that arrives counts.
        """
        shares, carried = self.shares, self.scale * levels.max(axis=1)
        carried *= np.where(self.arriving < 1.0, EVEN * self.arriving, 1.0)
        squares = float((shares * carried**2).sum())
        return float((shares * carried).sum()) ** 2 / squares if squares > 0 else 1.0


class _Sources(NamedTuple):
    """What kernels read of `Emitters`: its fields of the same names."""

    kind: np.ndarray
    parameters: np.ndarray
    face: np.ndarray
    cdf: np.ndarray
    units: np.ndarray
    lamp: np.ndarray
    tables: np.ndarray
    guides: np.ndarray
    guide: np.ndarray


class EmittedPhotons(NamedTuple):
    """Photons as they leave their lamps."""

    origin: np.ndarray  # (n, 3) float32 [m]
    direction: np.ndarray  # (n, 3) float32 unit
    flux: np.ndarray  # (n, 3) int32, fixed-point units
    start: np.ndarray  # (n,) int32, the side they leave (2 face + side), NO_FACE in free space
    lamp: np.ndarray  # (n,) uint8


def build_emitters(scene: Scene, surfaces: Surfaces, centre: np.ndarray, radius: float) -> Emitters:
    """Collect the emitters of a scene.

    centre (3,) and radius [m]: the sphere that directional and sky light must cover; it starts on a disc of that size.
    """
    kinds, parameters, faces, flux, names = [], [], [], [], []

    def add(kind, values, emitted, name, face=NO_FACE):
        kinds.append(kind)
        names.append(name)
        parameters.append(values)
        faces.append(face)
        flux.append(emitted)

    static = surfaces.face_range(0)
    for f in np.flatnonzero(surfaces.emission[static].max(axis=1, initial=0) > 0):
        if surfaces.areas[f] > 0:
            corners = surfaces.vertices[0][surfaces.faces[0][f]].reshape(9)
            # A diffuse emitter sends pi Le per area: Le times the cosine, integrated over the hemisphere.
            sent = math.pi * surfaces.areas[f] * surfaces.emission[f]
            material = scene.materials[scene.static.face_material[f]].name
            add(AREA, np.concatenate([corners, surfaces.normals[f]]), sent, material, f)
    around = Surroundings(np.asarray(centre, np.float64), radius, unit(scene.up))
    tables, starts = tables_of(scene.lights)
    for light, table in zip(scene.lights, starts, strict=True):
        kind = KIND_OF[type(light)]
        name = sky_name(scene) if kind == SKY else light.name
        if isinstance(light, SkyLight) and light.cie != UNIFORM_SKY:
            table, tables = len(tables), np.concatenate([tables, table_of(patches(light, around.up))])
        add(kind, parameters_of(light, around, table), KINDS[kind].flux(light, around), name)
    return _distribution(kinds, parameters, faces, flux, names, tables)


def _distribution(kinds, parameters, faces, flux, names, tables) -> Emitters:
    flux = np.array(flux, np.float64).reshape(-1, 3)
    largest = flux.max(axis=1, initial=0)
    lit = largest > 0
    flux, largest = flux[lit], largest[lit]
    every, names = names, [name for name, is_lit in zip(names, lit, strict=True) if is_lit]
    lamps = lamps_of(names, flux)._replace(dark=frozenset(every) - frozenset(names))
    total = float(largest.sum())
    cdf = np.cumsum(largest) / total if total > 0 else np.zeros(0)
    if len(cdf):
        cdf[-1] = 1.0
    # Each emitter is picked with probability largest / total, so every photon's largest channel is `total`.
    units = np.rint(flux / largest[:, None] * UNITS).astype(np.int64)
    return Emitters(
        kind=np.array(kinds, np.int64)[lit],
        parameters=np.array(parameters, np.float64).reshape(-1, WIDTH)[lit],
        face=np.array(faces, np.int64)[lit],
        flux=flux,
        cdf=cdf,
        units=units,
        unit_flux=total / UNITS,
        scale=np.ones(lamps.count),
        lamp=np.array([lamps.sources[name] for name in names], np.int64),
        lamps=lamps,
        tables=tables,
        arriving=np.ones(lamps.count),
        guides=np.zeros(0),
        guide=np.zeros((int(lit.sum()), 2), np.int64),
    )


@kernel
def _emit(seed, i, sources, photons, k):
    """Write photon i of the sources into row k of the photons."""
    u, v = random_numbers.position_numbers(seed, i)
    s, t = random_numbers.direction_numbers(seed, i)
    e = random_numbers.picked(sources.cdf, u)
    before = sources.cdf[e - 1] if e > 0 else 0.0
    # The rest of the number, scaled to [0, 1), is uniform again.
    u = min((u - before) / (sources.cdf[e] - before), 1.0)
    first, last, carried = sources.guide[e, 0], sources.guide[e, 1], 1.0
    if last > first:
        s, t, u, v, carried = guided(sources.guides[first:last], s, t, u, v)
    start_point, way = emitted(sources.kind[e], sources.parameters[e], sources.tables, u, v, s, t)
    photons.origin[k, 0], photons.origin[k, 1], photons.origin[k, 2] = start_point
    photons.direction[k, 0], photons.direction[k, 1], photons.direction[k, 2] = way
    for c in range(3):
        photons.flux[k, c] = int(sources.units[e, c] * carried + 0.5)
    photons.start[k] = sources.face[e] * 2 if sources.face[e] >= 0 else NO_FACE
    photons.lamp[k] = sources.lamp[e]


@kernel
def _emit_range(seed, first, sources, photons):
    for k in range(len(photons.start)):
        _emit(seed, first + k, sources, photons, k)


def emit(emitters: Emitters, seed: int, first: int, count: int) -> EmittedPhotons:
    """Emit photons first .. first + count - 1."""
    photons = EmittedPhotons(
        np.empty((count, 3), np.float32), np.empty((count, 3), np.float32), np.empty((count, 3), np.int32),
        np.empty(count, np.int32), np.empty(count, np.uint8),
    )  # fmt: skip
    if count:
        _emit_range(seed, first, _Sources(*(getattr(emitters, name) for name in _Sources._fields)), photons)
    return photons


def unchanged_lamps(before: Emitters, now: Emitters) -> np.ndarray:
    """Return the number before of each lamp now (G,) int64, -1: it is new or emits otherwise.

    A lamp is unchanged if its name, its emitters in order, and their fluxes are the same; its share of the photons may
    differ.
    """
    numbers = {name: g for g, name in enumerate(before.lamps.names)}
    pairs = [numbers.get(name, -1) for name in now.lamps.names]
    alike = [g if g >= 0 and _alike(before, g, now, k) else -1 for k, g in enumerate(pairs)]
    return np.array(alike, np.int64)


def _alike(before: Emitters, g: int, now: Emitters, k: int) -> bool:
    a, b = np.flatnonzero(before.lamp == g), np.flatnonzero(now.lamp == k)
    if len(a) != len(b):
        return False
    old, new = before.parameters[a].copy(), now.parameters[b].copy()
    luminaires = before.kind[a] == PHOTOMETRIC
    starts = old[luminaires, TABLE].astype(int), new[luminaires, TABLE].astype(int)
    tabled = luminaires | (before.kind[a] == SKY)  # other parameters of a sky describe its table
    old[tabled, TABLE] = new[tabled, TABLE] = 0
    guides = ([of.guides[slice(*of.guide[e])] for e in rows] for of, rows in ((before, a), (now, b)))
    return (
        np.array_equal(before.kind[a], now.kind[b])
        and all(map(np.array_equal, *guides))
        and np.array_equal(old, new)
        and np.array_equal(before.flux[a], now.flux[b])
        and all(
            np.array_equal(_table(before.tables, i), _table(now.tables, j)) for i, j in {*zip(*starts, strict=True)}
        )
    )


def _table(tables: np.ndarray, start: int) -> np.ndarray:
    """Return one table of luminaires, see `photometric.py`."""
    rows, planes = tables[start : start + 2].astype(int)
    return tables[start : start + 2 + rows + planes + 2 * rows * planes + rows]
