"""Discomfort glare of luminaires: the Unified Glare Rating of CIE 117 at eyes that look one way.

    UGR = 8 log10(0.25 / Lb sum L^2 w / p^2)

L [cd/m2] is the luminance of a luminaire towards the eye, w [sr] its solid angle, p Guth's position index. Lb
[cd/m2] is the luminance of the background, E / pi. E is the vertical illuminance without direct light of luminaires.

The sum is over points on each luminaire, each with its part of the solid angle. Above the line of sight p is Guth's
formula of 1963, below it that of Iwata and Tokura 1997. The norm's text was not at hand; the formulas are those of
manuals and of evalglare. Lights without an area have no luminance: they bring direct light, but no glare.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import cross, dot, row
from gi_core.geometry.error import REC709
from gi_core.lights.next_event import FACE, light_points, way_to
from gi_core.lights.photometric import density
from gi_core.model import Model
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene.types import Pose


class Glare(NamedTuple):
    """Light of luminaires at n eyes."""

    sources: np.ndarray  # (n,) float64, sum of L^2 w / p^2 [cd2/m4 sr]
    direct: np.ndarray  # (n,) float64, illuminance across the line of sight [lx]

    def rating(self, illuminance: np.ndarray) -> np.ndarray:
        """Return the UGR (n,), at least 0, from the whole illuminance (n,) [lx] across the line of sight.

        nan where noise leaves no background.
        """
        background = (illuminance - self.direct) / math.pi
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(background > 0.0, 0.25 * self.sources / background, np.nan)
            return np.where(self.sources > 0.0, np.maximum(8.0 * np.log10(ratio), 0.0), 0.0)

    def deviation(self, illuminance: np.ndarray, errors: np.ndarray) -> np.ndarray:
        """Return the standard errors (n,) of the UGR from those of the illuminance (n,) [lx]."""
        left = np.maximum(illuminance - self.direct, 1e-300)
        return np.where(self.sources > 0.0, 8.0 / math.log(10.0) * errors / left, 0.0)


def glare(
    model: Model, levels: np.ndarray, eyes: np.ndarray, view: np.ndarray, up: np.ndarray,
    poses: Mapping[str, Pose] | None, seed: int,
) -> Glare:  # fmt: skip
    """Return the light of luminaires at levels (G, 3) at eyes (n, 3) [m], which look along `view` (3,) unit.

    poses: of all mobiles, None: without them.
    """
    lights, n = model.lights_at(levels), len(eyes)
    points = light_points(lights, model.emitters.arriving, seed, (FACE,), math.inf)
    assert points is not None
    rows = np.flatnonzero(points.kind == FACE)
    points = points._replace(**{name: getattr(points, name)[rows] for name in points._fields})
    eyes = np.ascontiguousarray(eyes - model.origins[0], np.float64)
    at, out = model.static if poses is None else model.transforms(poses), np.zeros((n, 2))
    for i in range(n):
        to = points.place - eyes[i]
        distance = np.sqrt((to * to).sum(axis=1))
        start = np.broadcast_to(eyes[i], to.shape)
        reached, _ = nearest_in_world(model.accelerator, at, start, to / distance[:, None], distance)
        seen = ~(reached < distance * (1.0 - 1e-4))  # the luminaire's own face is at that distance
        _add(points, lights.area, eyes[i], view, up, REC709, seen, out[i])
    return Glare(out[:, 0].copy(), out[:, 1].copy())


@kernel
def _add(points, area, eye, view, up, weights, seen, out):
    """Add the luminaires' sum, and their illuminance, at an eye."""
    for j in range(len(seen)):
        x, y, z, d = way_to(row(points.place, j), False, 0.0, (eye[0], eye[1], eye[2]))
        way, e = (x, y, z), points.index[j]
        ahead, axis = dot(way, (view[0], view[1], view[2])), row(area.normal, e)
        at_light = -dot(way, axis)
        if not seen[j] or ahead <= 0.0 or at_light <= 0.0:
            continue
        share = at_light
        if area.table[e] >= 0:
            share = math.pi * density(area.tables, area.table[e], axis, row(area.c0, e), -x, -y, -z)
        value = weights[0] * points.value[j, 0] + weights[1] * points.value[j, 1] + weights[2] * points.value[j, 2]
        L = weights[0] * area.radiance[e, 0] + weights[1] * area.radiance[e, 1] + weights[2] * area.radiance[e, 2]
        angle = value * share / (d * d)  # luminance times solid angle
        out[0] += L * share / at_light * angle / position_index(way, ahead, view, up) ** 2
        out[1] += angle * ahead


@inlined
def position_index(way, ahead, view, up):
    """Return the position index of a unit direction; ahead > 0: its cosine to the line of sight."""
    v = (view[0], view[1], view[2])
    aside = (way[0] - ahead * v[0], way[1] - ahead * v[1], way[2] - ahead * v[2])  # across the line of sight
    across = cross(v, (up[0], up[1], up[2]))  # horizontal
    above = cross(across, v)
    x, y = dot(aside, across), dot(aside, above)
    if y < 0.0:
        ratio = min(math.sqrt(dot(aside, aside)) / ahead, 3.0)  # farther below p stays, as in evalglare
        return 1.0 + (0.8 if ratio < 0.6 else 1.2) * ratio
    a = math.degrees(math.atan2(abs(x), y))  # of the plane of the direction and the line of sight, from the vertical
    b = math.degrees(math.acos(min(ahead, 1.0)))
    near = 35.2 - 0.31889 * a - 1.22 * math.exp(-2.0 * a / 9.0)
    far = 21.0 + 0.26667 * a - 0.002963 * a * a
    return math.exp(1e-3 * near * b + 1e-5 * far * b * b)
