"""Scenes with irradiance in closed form: scene, field, and the receivers to compare.

With these photon numbers a mean over a group reveals an error of 2 % in 99 of 100 cases.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.scene.pose import axis_angle
from gi_core.scene.types import DirectionalLight, Mobile, PhotometricLight, PointLight, Pose, Scene, SkyLight, SpotLight
from tests.support import closed_form
from tests.support import scene_builders as build
from tests.support.photometry import candela, table_flux


class ClosedFormCase(NamedTuple):
    """A setting and its answer."""

    scene: Callable[[float], Scene]  # of a factor on all flux
    field: Callable  # points (m, 3), normals (m, 3) -> E (m,)
    groups: Callable  # receivers -> {name: (R,) bool}
    photons: int
    radius: float  # [m]
    neighbours: int = 125
    dark: Callable | None = None  # receivers -> (R,) bool: those that get exactly nothing


def within(r, margin):
    """Receivers of a floor [-1, 1]^2 at least `margin` from its rim: a photon map has no hits beyond."""
    return np.abs(r.positions[:, :2]).max(axis=1) < 1 - margin


def rings(*edges):
    """Groups by distance from the axis, away from the rim."""

    def groups(r):
        x = np.hypot(r.positions[:, 0], r.positions[:, 1])
        return {
            f"{a} to {b} m off the axis": (x >= a) & (x < b) & within(r, 0.15)
            for a, b in zip(edges[:-1], edges[1:], strict=True)
        }

    return groups


def point_over_plane(scale):
    return build.plane_scene(PointLight("p", (0, 0, 0.6), (4 * math.pi * scale,) * 3), reflectance=0.5, divisions=20)


def spot_over_plane(scale):
    return build.plane_scene(
        SpotLight("s", (0, 0, 1), (0, 0, -1), (scale,) * 3, 20.0, 40.0), reflectance=0.5, divisions=20
    )


def directional_plane(scale):
    return build.plane_scene(DirectionalLight("d", (1, 0.5, -1), (3.0 * scale,) * 3), reflectance=0.5, divisions=20)


def sky_plane(scale):
    return build.plane_scene(SkyLight("s", (scale,) * 3), reflectance=0.5, divisions=20)


def rectangles(scale):
    return build.lamp_over_floor(10.0 * scale, divisions=20)


def furnace(scale):
    return build.furnace_scene(scale, 0.5, divisions=8)


def sphere_in_sun(scale):
    return build.sphere_scene(DirectionalLight("d", (0, 0, -1), (scale,) * 3, 0.0))


def sphere_by_lamp(scale):
    return build.sphere_scene(PointLight("p", (0, 0, 2.5), (4 * math.pi * scale,) * 3))


BROAD = PhotometricLight(
    "luminaire", (0.1, 0.0, 0.8), (0.3, 0.1, -1.0), (0.0, 1.0, 0.0), (1.0,) * 3, np.array([0.0, 20.0, 50.0, 90.0]),
    np.array([0.0, 90.0, 200.0, 360.0]),
    np.array([[80.0, 99.0, 60.0, 30.0], [80.0, 60.0, 90.0, 20.0], [80.0, 90.0, 50.0, 40.0], [80.0, 99.0, 60.0, 30.0]]),
)  # fmt: skip


def luminaire_over_plane(scale):
    light = BROAD._replace(flux=(table_flux(BROAD) / 100 * scale,) * 3)  # the table in hundredths
    return build.plane_scene(light, reflectance=0.5, divisions=20)


def from_luminaire(points, normals):
    """Return I cos / d^2, with the intensity of the table in hundredths."""
    way = points - np.array(BROAD.position)
    d = np.sqrt((way * way).sum(axis=1))
    return candela(BROAD, way / d[:, None]) / 100 * np.maximum(-(way * normals).sum(axis=1), 0) / d**3


PLATE_POSE = Pose((0.2, 0.1, 0.1), axis_angle((1, 1, 0), 25))


def plate(scale):
    """A one-sided square plate, a mobile that has been moved and tilted, under a point light."""
    tile = Mobile("plate", build.quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0), (16, 16)), Pose((0, 0, -3.0)))
    light = PointLight("p", (0, 0, 1.2), (4 * math.pi * scale,) * 3)
    return Scene(build.floor(0.1, 1, centre=(0, 0, -4)), (build.grey(0.5),), (tile,), (light,), up=(0.0, 0.0, 1.0))


def furnace_groups(r):
    """Walls are cut into eighths and 2r = 1/8: the first row beside an edge is 2r from it."""
    from_edge = np.sort(np.minimum(r.positions, 1 - r.positions), axis=1)[:, 1]  # the smallest is the wall itself
    return {"2r from an edge": np.abs(from_edge - 0.125) < 1e-9, "farther": from_edge > 0.126}


def outside(r):
    return (r.positions * r.normals).sum(axis=1) > 0


def bands(*cosines):
    """Groups of the outside of a sphere by the cosine of incidence of light from +z."""

    def groups(r):
        return {
            f"cosine {a} to {b}": outside(r) & (r.normals[:, 2] > a) & (r.normals[:, 2] <= b)
            for a, b in zip(cosines[:-1], cosines[1:], strict=True)
        }

    return groups


def inside(r):
    return ~outside(r)


CASES = {
    "point light over a plane": ClosedFormCase(
        point_over_plane,
        lambda p, n: closed_form.point_over_plane(1.0, 0.6, np.hypot(p[:, 0], p[:, 1])),
        rings(0, 0.4, 0.7, 1.2),
        25_000,
        0.12,
    ),
    "spot over a plane": ClosedFormCase(
        spot_over_plane,
        lambda p, n: closed_form.spot_over_plane(
            1.0, 1.0, np.hypot(p[:, 0], p[:, 1]), math.cos(math.radians(20)), math.cos(math.radians(40))
        ),
        rings(0, 0.36, 0.8),
        25_000,
        0.12,
        200,
    ),
    "luminaire over a plane": ClosedFormCase(
        luminaire_over_plane, from_luminaire, rings(0, 0.4, 0.7, 1.2), 25_000, 0.12
    ),
    "oblique parallel light": ClosedFormCase(
        directional_plane,
        lambda p, n: np.full(len(p), closed_form.directional(3.0, (1, 0.5, -1), (0, 0, 1))),
        lambda r: {"all": within(r, 0.15)},
        25_000,
        0.12,
    ),
    "sky": ClosedFormCase(
        sky_plane,
        lambda p, n: np.full(len(p), closed_form.sky(1.0)),
        lambda r: {"all": within(r, 0.15)},
        25_000,
        0.12,
    ),
    "parallel rectangles": ClosedFormCase(
        rectangles,
        lambda p, n: np.where(
            p[:, 2] < 0.5, closed_form.parallel_rectangle(10.0, -0.5, 0.5, -0.5, 0.5, 1.0, p[:, 0], p[:, 1]), 0.0
        ),
        rings(0, 0.4, 0.8, 1.2),
        150_000,
        0.12,
        250,
    ),
    "furnace": ClosedFormCase(
        furnace, lambda p, n: np.full(len(p), closed_form.furnace(1.0, 0.5)), furnace_groups, 40_000, 1 / 16, 250
    ),
    "two-sided sphere in parallel light": ClosedFormCase(
        sphere_in_sun,
        lambda p, n: closed_form.directional(1.0, (0, 0, -1), n),
        bands(0.1, 0.5, 0.8, 1.0),
        25_000,
        0.11,
        dark=inside,
    ),
    "two-sided sphere beside a lamp": ClosedFormCase(
        sphere_by_lamp,
        lambda p, n: closed_form.point_light(1.0, (0, 0, 2.5), p, n),
        bands(0.5, 0.8, 1.0),
        150_000,
        0.11,
        dark=inside,
    ),
    "tilted plate that has been moved": ClosedFormCase(
        plate,
        lambda p, n: closed_form.point_light(1.0, (0, 0, 1.2), p, n),
        lambda r: {"plate": np.linalg.norm(r.positions - PLATE_POSE.position, axis=1) < 0.4},
        40_000,
        0.1,
        250,
    ),
}
