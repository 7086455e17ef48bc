"""Next-event estimation: choose a light, a point on it, and say what arrives if nothing blocks it.

Two kinds of light: emissive faces, on which a point is sampled with a known density per area, and
lights without size, which no ray can hit. Built from the scene itself and not from `emission.py`, so
that the reference shares neither sampling nor flux with the photons that it judges.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core import sampling, strata
from gi_core.jit import inlined, kernel
from gi_core.scene.types import DirectionalLight, PointLight, Scene, SkyLight, SpotLight
from gi_core.surfaces import Surfaces

POINT, SPOT, DIRECTIONAL = range(3)
LIGHT_U, LIGHT_V, SMALL_PICK = 0, 1, 2  # dimensions of strata.uniform() at each path vertex


class AreaLights(NamedTuple):
    """Emissive faces of the static part; those on mobiles emit nothing."""

    corners: np.ndarray  # (A, 9) float64 [m]
    normal: np.ndarray  # (A, 3) float64 unit
    radiance: np.ndarray  # (A, 3) float64 Le [W/m2/sr]
    cdf: np.ndarray  # (A,) float64, running share of area x largest channel of Le, ends at 1
    density: np.ndarray  # (A,) float64 [1/m2], of sampling a point on it
    lamp: np.ndarray  # (F,) int32, which of these a global face is, -1: none


class SmallLights(NamedTuple):
    """Point, spot and directional lights."""

    kind: np.ndarray  # (D,) int64
    parameters: np.ndarray  # (D, 8) float64: position (3), unit direction it shines in (3), cos inner, cos outer
    value: np.ndarray  # (D, 3) float64: intensity [W/sr], or irradiance on a facing plane [W/m2]


class Sky(NamedTuple):
    """The sum of all sky lights."""

    up: np.ndarray  # (3,) float64 unit
    radiance: np.ndarray  # (3,) float64 [W/m2/sr]


def area_lights(surfaces: Surfaces) -> AreaLights:
    """Collect the emissive faces; each is chosen in proportion to its flux."""
    static = surfaces.face_range(0)
    emitted = np.zeros_like(surfaces.emission)
    emitted[static] = surfaces.emission[static]
    power = surfaces.areas * emitted.max(axis=1, initial=0)
    faces = np.flatnonzero(power > 0)
    lamp = np.full(len(power), -1, np.int32)
    lamp[faces] = np.arange(len(faces))
    density = cdf = np.zeros(0)
    if len(faces):
        share = power[faces] / power[faces].sum()
        density = share / surfaces.areas[faces]
        cdf = np.cumsum(share)
        cdf[-1] = 1.0
    corners = surfaces.vertices[0][surfaces.faces[0][faces]].reshape(-1, 9)
    return AreaLights(corners, surfaces.normals[faces], emitted[faces], cdf, density, lamp)


def small_lights(scene: Scene) -> SmallLights:
    """Collect the lights that no ray can hit."""
    kind, parameters, value = [], [], []
    for light in scene.lights:
        row = np.zeros(8)
        if isinstance(light, PointLight):
            kind.append(POINT)
            row[:3] = light.position
            value.append(np.array(light.flux, float) / (4 * math.pi))
        elif isinstance(light, SpotLight):
            kind.append(SPOT)
            row[:3], row[3:6] = light.position, _unit(light.direction)
            row[6:] = math.cos(math.radians(light.inner_degrees)), math.cos(math.radians(light.outer_degrees))
            value.append(np.array(light.intensity, float))
        elif isinstance(light, DirectionalLight):
            kind.append(DIRECTIONAL)
            row[3:6] = _unit(light.direction)
            value.append(np.array(light.irradiance, float))
        else:
            continue
        parameters.append(row)
    return SmallLights(
        np.array(kind, np.int64),
        np.array(parameters, np.float64).reshape(-1, 8),
        np.array(value, np.float64).reshape(-1, 3),
    )


def sky_of(scene: Scene) -> Sky:
    """Return the dome of a scene; radiance 0 where it has none."""
    radiance = sum((np.array(s.radiance, float) for s in scene.lights if isinstance(s, SkyLight)), np.zeros(3))
    return Sky(_unit(scene.up), radiance)


def _unit(v) -> np.ndarray:
    v = np.asarray(v, np.float64)
    return v / np.sqrt((v * v).sum())


class Shadows(NamedTuple):
    """Rays from path vertices to lights, and what they bring if nothing is in between. Room for n of them."""

    row: np.ndarray  # (n,) int64, where the sum of the path is
    origin: np.ndarray  # (n, 3) float32 [m]
    direction: np.ndarray  # (n, 3) float32 unit
    limit: np.ndarray  # (n,) float32 [m], a little short of the light
    value: np.ndarray  # (n, 3) float64 irradiance where the path starts [W/m2]


def room_for_shadows(n: int) -> Shadows:
    """Return room for n rays."""
    return Shadows(
        np.empty(n, np.int64),
        np.empty((n, 3), np.float32),
        np.empty((n, 3), np.float32),
        np.empty(n, np.float32),
        np.empty((n, 3)),
    )


@kernel
def area_events(seed, m, vertex, ends, lights, gap, out):
    """Sample a point on an emissive face for each path vertex; return how many could be lit, written to `out`.

    Rays end `gap` [m] before the face.
    """
    count = 0
    for k in range(len(ends.path)):
        path = ends.path[k]
        u = strata.uniform(seed, path, vertex, LIGHT_U, m)
        e, p_light, px, py, pz = point_on_lamp(lights, u, strata.uniform(seed, path, vertex, LIGHT_V, m))
        x, y, z = px - ends.position[k, 0], py - ends.position[k, 1], pz - ends.position[k, 2]
        geometry, x, y, z, d = arrives(x, y, z, ends.normal[k], lights.normal[e], p_light)
        if geometry <= 0.0:
            continue
        for i in range(3):
            out.value[count, i] = ends.throughput[k, i] * lights.radiance[e, i] * geometry
        aim(ends.row[k], ends.position[k], x, y, z, max(d - gap, 0.0), out, count)
        count += 1
    return count


@inlined
def point_on_lamp(lights, u, v):
    """Return the emissive face that u in [0, 1) chooses, the density [1/m2] of the choice, and a point on it [m]."""
    e = min(np.searchsorted(lights.cdf, u, side="right"), len(lights.cdf) - 1)
    before = lights.cdf[e - 1] if e > 0 else 0.0
    share = lights.cdf[e] - before
    # What the choice of the face leaves of the number is uniform again.
    b, c = sampling.triangle(min(max((u - before) / share, 0.0), 1.0), v)
    a = 1.0 - b - c
    p = lights.corners[e]
    x, y, z = a * p[0] + b * p[3] + c * p[6], a * p[1] + b * p[4] + c * p[7], a * p[2] + b * p[5] + c * p[8]
    return e, share / _area(p), x, y, z


@inlined
def arrives(x, y, z, normal, light_normal, p_light):
    """Return E / Le of a point on a lamp at (x, y, z) from here, 0 where none can be, the unit direction to it and
    its distance.

    Weighted by the balance heuristic against cosine-sampled bounces: E = Le cos cos' / d^2 / (p_light + p_bounce),
    both densities per area. A plain E / p_light has no finite variance where a lamp meets a wall: 1 / d^2 has no
    bound there.
    """
    d2 = x * x + y * y + z * z
    d = math.sqrt(d2)
    geometry = 0.0
    if d2 > 0.0:
        x, y, z = x / d, y / d, z / d
        cosine = x * normal[0] + y * normal[1] + z * normal[2]
        at_light = -(x * light_normal[0] + y * light_normal[1] + z * light_normal[2])
        if cosine > 0.0 and at_light > 0.0:
            geometry = cosine * at_light / d2 / (p_light + bounce_density(cosine, at_light, d2))
    return geometry, x, y, z, d


@kernel
def aim(row, position, x, y, z, limit, out, j):
    """Write ray j, from a position."""
    out.row[j], out.limit[j] = row, limit
    for c in range(3):
        out.origin[j, c] = position[c]
    out.direction[j, 0], out.direction[j, 1], out.direction[j, 2] = x, y, z


@kernel
def bounce_density(cosine, at_light, d2):
    """Return the density per area [1/m2] with which a cosine-sampled bounce reaches a point."""
    return cosine / math.pi * at_light / d2


@kernel
def _area(p):
    ux, uy, uz = p[3] - p[0], p[4] - p[1], p[5] - p[2]
    vx, vy, vz = p[6] - p[0], p[7] - p[1], p[8] - p[2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return 0.5 * math.sqrt(x * x + y * y + z * z)


@kernel
def small_light_at(kind, p, x, y, z, nx, ny, nz, far):
    """Return E / value of one light at a point, the unit direction to it and its distance."""
    if kind == DIRECTIONAL:
        dx, dy, dz, d = -p[3], -p[4], -p[5], far
        return max(0.0, dx * nx + dy * ny + dz * nz), dx, dy, dz, d
    dx, dy, dz = p[0] - x, p[1] - y, p[2] - z
    d2 = dx * dx + dy * dy + dz * dz
    if d2 <= 0.0:
        return 0.0, 0.0, 0.0, 1.0, 0.0
    d = math.sqrt(d2)
    dx, dy, dz = dx / d, dy / d, dz / d
    strength = max(0.0, dx * nx + dy * ny + dz * nz) / d2
    if kind == SPOT:
        cosine = -(dx * p[3] + dy * p[4] + dz * p[5])
        ramp = (cosine - p[7]) / max(p[6] - p[7], 1e-12)
        ramp = min(1.0, max(0.0, ramp))
        strength *= ramp * ramp
    return strength, dx, dy, dz, d


@kernel
def small_events(seed, m, vertex, ends, lights, far, gap, out):
    """Choose one small light for each path vertex, in proportion to what it brings there if free.

    Output as of area_events(). One light's irradiance is then exact; among several the choice has the
    least variance that one shadow ray can have in the open.
    """
    lamps, count = len(lights.kind), 0
    for k in range(len(ends.path)):
        x, y, z = ends.position[k, 0], ends.position[k, 1], ends.position[k, 2]
        nx, ny, nz = ends.normal[k, 0], ends.normal[k, 1], ends.normal[k, 2]
        total = 0.0
        for e in range(lamps):
            s, _, _, _, _ = small_light_at(lights.kind[e], lights.parameters[e], x, y, z, nx, ny, nz, far)
            total += s * max(lights.value[e, 0], max(lights.value[e, 1], lights.value[e, 2]))
        if total <= 0.0:
            continue
        left = strata.uniform(seed, ends.path[k], vertex, SMALL_PICK, m) * total
        for e in range(lamps):
            s, dx, dy, dz, d = small_light_at(lights.kind[e], lights.parameters[e], x, y, z, nx, ny, nz, far)
            weight = s * max(lights.value[e, 0], max(lights.value[e, 1], lights.value[e, 2]))
            if weight <= 0.0:
                continue
            # Overwritten until the sum reaches the draw: rounding at the end leaves the last one.
            for i in range(3):
                out.value[count, i] = ends.throughput[k, i] * lights.value[e, i] * s * (total / weight)
            aim(ends.row[k], ends.position[k], dx, dy, dz, max(d - gap, 0.0), out, count)
            left -= weight
            if left < 0.0:
                break
        count += 1
    return count
