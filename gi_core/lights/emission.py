"""Emission of photon i: light, origin, direction and flux (report Alg. 2.3.1).

The report distributes N photons over the lights in proportion to flux, so photon i depends on N. Here a coordinate of
the Sobol sequence picks the light, so photon i depends on (seed, i) alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple, assert_never

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.fixed_point import UNITS
from gi_core.base.jit import kernel
from gi_core.base.vec import cross, weighted
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights import photometric
from gi_core.lights.lamps import Lamps, lamps_of, sky_name
from gi_core.lights.photometric import axes, tables_of
from gi_core.scene.types import DirectionalLight, PhotometricLight, PointLight, Scene, SkyLight, SpotLight

AREA, POINT, SPOT, DIRECTIONAL, SKY, PHOTOMETRIC = range(6)
NO_FACE = -1  # start of a path in free space


class Emitters(NamedTuple):
    """Emitters: one per emissive face, one per other light.

    `parameters` by kind: AREA three corners (9) and unit normal (3); POINT position (3); SPOT
    position (3), axis (3), cos inner, cos outer; DIRECTIONAL direction (3), disc centre (3), disc
    radius; SKY up (3), centre (3), radius; PHOTOMETRIC position (3), axis (3), C0 (3), half the size along C0 and C90,
    start in `tables`.
    """

    kind: np.ndarray  # (E,) int64
    parameters: np.ndarray  # (E, 12) float64
    face: np.ndarray  # (E,) int64, global face of an area emitter, else NO_FACE
    flux: np.ndarray  # (E, 3) float64 [W]
    cdf: np.ndarray  # (E,) float64, running share of the photons, ends at 1
    units: np.ndarray  # (E, 3) int64, flux of one photon of this emitter in fixed-point units
    unit_flux: float  # watts per fixed-point unit, times the number of photons, of a lamp of scale 1
    scale: np.ndarray  # (G,) float64, of the unit of each lamp's photons; 1 where photons are shared by flux
    lamp: np.ndarray  # (E,) int64, lamp of each emitter
    lamps: Lamps
    tables: np.ndarray  # (n,) float64, of luminaires, see `photometric.py`

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

    def shared(self, shares: np.ndarray) -> Emitters:
        """Return emitters whose lamps emit these shares (G,) > 0 of the photons; they sum to 1. Fluxes stay."""
        largest = self.flux.max(axis=1)
        of_lamp = np.bincount(self.lamp, largest, self.lamps.count)
        cdf = np.cumsum(shares[self.lamp] * (largest / of_lamp[self.lamp]))
        cdf[-1] = 1.0
        return self._replace(cdf=cdf, scale=self.shares_of_flux / shares)

    def effective(self, levels: np.ndarray) -> float:
        """Return the share of photons that count at levels (G, 3): 1 where each carries the same flux (Kish 1965)."""
        shares, carried = self.shares, self.scale * levels.max(axis=1)
        squares = float((shares * carried**2).sum())
        return float((shares * carried).sum()) ** 2 / squares if squares > 0 else 1.0


def build_emitters(scene: Scene, surfaces: Surfaces, centre: np.ndarray, radius: float) -> Emitters:
    """Collect the emitters of a scene.

    centre (3,) and radius [m]: the sphere that directional and sky light must cover; it starts on a disc of that size.
    """
    kinds, parameters, faces, flux, names = [], [], [], [], []

    def add(kind, values, emitted, name, face=NO_FACE):
        kinds.append(kind)
        names.append(name)
        parameters.append(np.concatenate([values, np.zeros(12 - len(values))]))
        faces.append(face)
        flux.append(emitted)

    static = surfaces.face_range(0)
    for f in np.flatnonzero(surfaces.emission[static].max(axis=1, initial=0) > 0):
        if surfaces.areas[f] > 0:
            corners = surfaces.vertices[0][surfaces.faces[0][f]].reshape(9)
            # A diffuse emitter sends pi Le per area: Le times the cosine, integrated over the hemisphere.
            emitted = math.pi * surfaces.areas[f] * surfaces.emission[f]
            material = scene.materials[scene.static.face_material[f]].name
            add(AREA, np.concatenate([corners, surfaces.normals[f]]), emitted, material, f)
    tables, starts = tables_of(scene.lights)
    for light, table in zip(scene.lights, starts, strict=True):
        match light:
            case PointLight():
                add(POINT, np.array(light.position, float), np.array(light.flux, float), light.name)
            case SpotLight():
                ci, co = (math.cos(math.radians(a)) for a in (light.inner_degrees, light.outer_degrees))
                values = np.concatenate([light.position, unit(light.direction), [ci, co]])
                add(SPOT, values, np.array(light.intensity, float) * spot_solid_angle(ci, co), light.name)
            case PhotometricLight():
                axis, c0 = axes(light)
                values = np.concatenate([light.position, axis, c0, np.array(light.size) / 2, [table]])
                add(PHOTOMETRIC, values, np.array(light.flux, float), light.name)
            case DirectionalLight():
                d = unit(light.direction)
                values = np.concatenate([d, centre - d * radius, [radius]])
                add(DIRECTIONAL, values, np.array(light.irradiance, float) * math.pi * radius * radius, light.name)
            case SkyLight():
                values = np.concatenate([unit(scene.up), centre, [radius]])
                emitted = np.array(light.radiance, float) * 2 * math.pi * math.pi * radius * radius
                add(SKY, values, emitted, sky_name(scene))
            case _:
                assert_never(light)
    return _distribution(kinds, parameters, faces, flux, names, tables)


def _distribution(kinds, parameters, faces, flux, names, tables) -> Emitters:
    flux = np.array(flux, np.float64).reshape(-1, 3)
    largest = flux.max(axis=1, initial=0)
    lit = largest > 0
    flux, largest = flux[lit], largest[lit]
    names = [name for name, is_lit in zip(names, lit, strict=True) if is_lit]
    lamps = lamps_of(names, flux)
    total = float(largest.sum())
    cdf = np.cumsum(largest) / total if total > 0 else np.zeros(0)
    if len(cdf):
        cdf[-1] = 1.0
    # Each emitter is picked with probability largest / total, so every photon's largest channel is `total`.
    units = np.rint(flux / largest[:, None] * UNITS).astype(np.int64)
    return Emitters(
        kind=np.array(kinds, np.int64)[lit],
        parameters=np.array(parameters, np.float64).reshape(-1, 12)[lit],
        face=np.array(faces, np.int64)[lit],
        flux=flux,
        cdf=cdf,
        units=units,
        unit_flux=total / UNITS,
        scale=np.ones(lamps.count),
        lamp=np.array([lamps.sources[name] for name in names], np.int64),
        lamps=lamps,
        tables=tables,
    )


def unit(v) -> np.ndarray:
    v = np.asarray(v, np.float64)
    return v / np.sqrt((v * v).sum())


def spot_solid_angle(cos_inner: float, cos_outer: float) -> float:
    """Return the integral of a spot's falloff over directions [sr]: 2 pi (1 - ci + (ci - co) / 3)."""
    return 2 * math.pi * ((1 - cos_inner) + (cos_inner - cos_outer) / 3)


@kernel
def _emit(seed, i, kind, parameters, face, cdf, units, lamps, tables, origin, direction, flux, start, lamp, k):
    """Write photon i into row k."""
    u, v = random_numbers.position_numbers(seed, i)
    s, t = random_numbers.direction_numbers(seed, i)
    e = random_numbers.picked(cdf, u)
    before = cdf[e - 1] if e > 0 else 0.0
    # The rest of the number, scaled to [0, 1), is uniform again.
    u = min((u - before) / (cdf[e] - before), 1.0)
    p = parameters[e]
    ox, oy, oz = p[0], p[1], p[2]
    dx, dy, dz = 0.0, 0.0, 0.0
    if kind[e] == AREA:
        b, c = random_numbers.triangle(u, v)
        a = 1.0 - b - c
        ox = a * p[0] + b * p[3] + c * p[6]
        oy = a * p[1] + b * p[4] + c * p[7]
        oz = a * p[2] + b * p[5] + c * p[8]
        x, y, z = random_numbers.cosine_hemisphere(s, t)
        dx, dy, dz = random_numbers.from_frame(x, y, z, p[9], p[10], p[11])
    elif kind[e] == POINT:
        x, y, z = random_numbers.cone(s, t, -1.0)
        dx, dy, dz = x, y, z
    elif kind[e] == SPOT:
        # The flux inside `inner` is 1 - ci, in the ramp (ci - co) / 3; there cos has density ~ ramp^2.
        inner, ramp = 1.0 - p[6], (p[6] - p[7]) / 3.0
        outwards = s * (inner + ramp)  # flux nearer the axis
        z = 1.0 - outwards
        if outwards > inner:
            z = p[7] + (p[6] - p[7]) * max(0.0, 1.0 - (outwards - inner) / ramp) ** (1.0 / 3.0)
        r = math.sqrt(max(0.0, 1.0 - z * z))
        dx, dy, dz = random_numbers.from_frame(
            r * math.cos(2.0 * math.pi * t), r * math.sin(2.0 * math.pi * t), z, p[3], p[4], p[5]
        )
    elif kind[e] == DIRECTIONAL:
        x, y = random_numbers.disc(u, v)
        dx, dy, dz = p[0], p[1], p[2]
        ax, ay, az = random_numbers.from_frame(x * p[6], y * p[6], 0.0, dx, dy, dz)
        ox, oy, oz = p[3] + ax, p[4] + ay, p[5] + az
    elif kind[e] == PHOTOMETRIC:
        gamma, plane = photometric.drawn(tables, int(p[11]), s, t)
        c90 = cross(p[6:9], p[3:6])
        r = math.sin(gamma)
        dx, dy, dz = weighted((r * math.cos(plane), r * math.sin(plane), math.cos(gamma)), p[6:9], c90, p[3:6])
        ax, ay, az = weighted(((2.0 * u - 1.0) * p[9], (2.0 * v - 1.0) * p[10], 0.0), p[6:9], c90, p[3:6])
        ox, oy, oz = p[0] + ax, p[1] + ay, p[2] + az
    else:
        x, y, z = random_numbers.cone(s, t, 0.0)
        dx, dy, dz = random_numbers.from_frame(-x, -y, -z, p[0], p[1], p[2])
        x, y = random_numbers.disc(u, v)
        ax, ay, az = random_numbers.from_frame(x * p[6], y * p[6], 0.0, dx, dy, dz)
        ox, oy, oz = p[3] - dx * p[6] + ax, p[4] - dy * p[6] + ay, p[5] - dz * p[6] + az
    origin[k, 0], origin[k, 1], origin[k, 2] = ox, oy, oz
    direction[k, 0], direction[k, 1], direction[k, 2] = dx, dy, dz
    for c in range(3):
        flux[k, c] = units[e, c]
    start[k] = face[e] * 2 if face[e] >= 0 else NO_FACE
    lamp[k] = lamps[e]


@kernel
def _emit_range(
    seed, first, kind, parameters, face, cdf, units, lamps, tables, origin, direction, flux, start, lamp
):  # fmt: skip
    for k in range(len(start)):
        _emit(
            seed, first + k, kind, parameters, face, cdf, units, lamps, tables, origin, direction, flux, start, lamp, k
        )


def emit(emitters: Emitters, seed: int, first: int, count: int):
    """Emit photons first .. first + count - 1.

    Returns origin (n, 3) float32 [m], direction (n, 3) float32 unit, flux (n, 3) int32 in fixed-point
    units, start (n,) int32 the side they leave (2 face + side, NO_FACE in free space), lamp (n,) uint8.
    """
    origin = np.empty((count, 3), np.float32)
    direction = np.empty((count, 3), np.float32)
    flux = np.empty((count, 3), np.int32)
    start = np.empty(count, np.int32)
    lamp = np.empty(count, np.uint8)
    if count:
        e = emitters
        emitted = origin, direction, flux, start, lamp
        _emit_range(seed, first, e.kind, e.parameters, e.face, e.cdf, e.units, e.lamp, e.tables, *emitted)
    return origin, direction, flux, start, lamp
