"""Lights of a scene as paths find them, and the choice among emissive faces.

Two kinds of light: emissive faces, on which a point is sampled with a known density per area, and lights without size,
which no ray can hit. Built from the scene itself and not from `emission.py`, so that the reference shares neither
sampling nor flux with the photons that it judges.

Faces are chosen by flux, or by importance for a mobile (`aimed`): radiance, area, distance and the best cosine that any
point of the mobile's bounding sphere has at the lamp. All receivers of a mobile share that choice, so that their
errors are correlated and invisible on a smooth surface. It is a function of the mobile's pose alone, constant while
the mobile moves by less than its radius: points on lamps that follow every step make its light flicker.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.hilbert_curve import hilbert_order
from gi_core.base.jit import kernel
from gi_core.geometry.surfaces import Surfaces
from gi_core.scene.types import DirectionalLight, PointLight, Scene, SkyLight, SpotLight

POINT, SPOT, DIRECTIONAL = range(3)
BY_FLUX = 0.02  # of the choice goes by flux alone: a lamp that touches the sphere is not forgotten, nor is a large face


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


class Lights(NamedTuple):
    """All lights of a scene, by the way they are found."""

    area: AreaLights
    small: SmallLights
    sky: Sky


def area_lights(surfaces: Surfaces) -> AreaLights:
    """Collect the emissive faces in the order of a Hilbert curve; each is chosen in proportion to its flux.

    Samples are stratified over the running share: so each stratum is a patch of a lamp, not a band across it.
    """
    static = surfaces.face_range(0)
    emitted = np.zeros_like(surfaces.emission)
    emitted[static] = surfaces.emission[static]
    power = surfaces.areas * emitted.max(axis=1, initial=0)
    faces = np.flatnonzero(power > 0)
    corners = surfaces.vertices[0][surfaces.faces[0][faces]]
    order = hilbert_order(corners.mean(axis=1))
    faces, corners = faces[order], corners[order].reshape(-1, 9)
    lamp = np.full(len(power), -1, np.int32)
    lamp[faces] = np.arange(len(faces))
    share = power[faces] / power.sum() if len(faces) else np.zeros(0)
    cdf = np.cumsum(share)
    cdf[-1:] = 1.0
    return AreaLights(corners, surfaces.normals[faces], emitted[faces], cdf, share / surfaces.areas[faces], lamp)


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


def steady(centre: np.ndarray, radius: float) -> np.ndarray:
    """Return the middle of the cell of a grid, a radius wide, that a place (3,) lies in: it stays there for a while.

    What a frame differs by from the mean of those before and after it, 8 paths: 2.7 % in gallery, without this 6.3 %,
    of very many paths 2.3 %; living_room 4.4, 5.6 and 2.6 %. The error is the same.
    """
    return radius * np.round(centre / radius)


def aimed(lights: AreaLights, centre: np.ndarray, radius: float) -> AreaLights:
    """Return lamps with the choice that suits a sphere: centre (3,) [m] in the world, radius [m]."""
    share, area = np.empty_like(lights.cdf), np.empty_like(lights.cdf)
    _aim(lights.corners, lights.normal, lights.radiance, np.asarray(centre, np.float64), radius, share, area)
    cdf = np.cumsum(share)
    cdf[-1:] = 1.0
    return lights._replace(cdf=cdf, density=share / area)


@kernel
def _aim(corners, normal, radiance, centre, radius, share, area):
    """Write the share of the choice and the area [m2] of each face."""
    flux = brought = 0.0
    for e in range(len(corners)):
        p, n = corners[e], normal[e]
        ux, uy, uz = p[3] - p[0], p[4] - p[1], p[5] - p[2]
        vx, vy, vz = p[6] - p[0], p[7] - p[1], p[8] - p[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area[e] = 0.5 * math.sqrt(x * x + y * y + z * z)
        power = area[e] * max(radiance[e, 0], max(radiance[e, 1], radiance[e, 2]))
        x = centre[0] - (p[0] + p[3] + p[6]) / 3.0
        y = centre[1] - (p[1] + p[4] + p[7]) / 3.0
        z = centre[2] - (p[2] + p[5] + p[8]) / 3.0
        d2 = x * x + y * y + z * z
        share[e] = power * _best_cosine(x * n[0] + y * n[1] + z * n[2], d2, radius) / (d2 + radius * radius + area[e])
        flux += power
        brought += share[e]
    for e in range(len(corners)):
        power = area[e] * max(radiance[e, 0], max(radiance[e, 1], radiance[e, 2]))
        if brought > 0.0:
            share[e] = (1.0 - BY_FLUX) * share[e] / brought + BY_FLUX * power / flux
        else:
            share[e] = power / flux


@kernel
def _best_cosine(height, d2, radius):
    """Return the largest cosine at a lamp to any point of a sphere, 0 if all are behind it.

    height: of the centre over the lamp's plane, d2: its distance squared. The sphere is seen within asin(radius / d).
    """
    if d2 <= radius * radius:
        return 1.0
    d = math.sqrt(d2)
    cosine, sine_out = height / d, radius / d
    cosine_out = math.sqrt(1.0 - sine_out * sine_out)
    if cosine >= cosine_out:
        return 1.0
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    return max(0.0, cosine * cosine_out + sine * sine_out)
