"""Light of delta lights on static faces, which radiosity reflects first.

Shadows of delta lights are sharp, so a face may have other light than its corners. Points on each face are lit by
shadow rays. Bright faces, such as a small patch of sun, also get rays from receivers (`bright_faces.py`), because few
bounces meet them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.pause import pause
from gi_core.gather.bright_faces import BrightFaces, StaticFaces
from gi_core.gather.direct_light import DirectLight, Places
from gi_core.gather.path_ends import starts
from gi_core.gather.path_tracer import scatter
from gi_core.geometry.error import luminance
from gi_core.lights.lamps import sum_of_lamps
from gi_core.lights.light_points import DELTA
from gi_core.model import Model
from gi_core.rays.accelerator import FAR
from gi_core.rays.all_objects import nearest_in_world


class FaceLight(NamedTuple):
    """Direct light [W/m2] by delta lights at n static receivers and F static faces, per lamp; (0, 3 G): none."""

    receivers: np.ndarray  # (n, 3 G) float64, of receivers
    reflected: np.ndarray  # (2 F, 3 G) float32, reflected by fronts and backs of faces; bright fronts: 0
    bright: BrightFaces
    of_bright: np.ndarray  # (A, 3 G) float64, reflected by the fronts of bright faces


def face_light(model: Model, seed: int, weights: np.ndarray) -> FaceLight:
    """Return the light of a model's static faces, with a pause every 10 ms; weights (n,): of static receivers."""
    s, lights, world = model.surfaces, model.lights, model.world
    of = s.face_range(0)
    count = of.stop
    faces = StaticFaces.of(s)
    delta = DirectLight(model, seed, (DELTA,))
    if count and len(lights.delta.kind):
        delta = delta.measured_at(Places.of_receivers(model))
    if not delta.per_lamp.any():
        none, dark = np.zeros((0, lights.channels)), np.zeros(count)
        return FaceLight(none, none.astype(np.float32), faces.bright(dark, dark, len(world.face_object)), none)
    points = min(max((1 << 19) // (count * len(lights.delta.kind)), 1), 4)  # at most 0.3 s of rays
    albedo = np.tile(world.bsdfs.albedo[of], lights.channels // 3)
    both = np.zeros((count, 2, lights.channels), np.float32)
    for side, rows in enumerate((np.arange(count), np.flatnonzero(s.two_sided[of]))):
        light = delta.measured_at(_on_faces(model, rows, 1 - 2 * side, points)).per_lamp
        both[rows, side] = albedo[rows] * light.reshape(len(rows), points, lights.channels).mean(axis=1)
        pause()
    reflected = luminance(sum_of_lamps(both[faces.face, 0]))
    view = _looked_at(model, seed, weights)[faces.face]
    # Above 0: the mean is that of all faces that receivers see.
    bright = faces.bright(np.maximum(reflected, 1e-12 * reflected.max()), view, len(world.face_object))
    of_bright = both[bright.face, 0].astype(np.float64)
    both[bright.face, 0] = 0.0
    return FaceLight(delta.per_lamp, both.reshape(2 * count, -1), bright, of_bright)


def _on_faces(model: Model, rows: np.ndarray, side: int, points: int) -> Places:
    """Return so many points on each of the static faces rows (f,), on a side 1 or -1 of them, face by face."""
    s = model.surfaces
    n = np.arange(1, len(rows) * points + 1)
    # A sequence of low discrepancy in the unit square (Roberts 2018).
    u, v = (n * step % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
    root = np.sqrt(u)
    weights = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
    rows = np.repeat(rows, points)
    positions = (weights[:, :, None] * s.vertices[0][s.faces[0][rows]]).sum(axis=1)
    lifts = model.lifts[s.corner_front[rows]].max(axis=1)
    return Places(positions, side * s.normals[rows], lifts)


def _looked_at(model: Model, seed: int, weights: np.ndarray) -> np.ndarray:
    """Return how often bounces hit the front of each static face, (F,) float64; they start by weights (n,)."""
    pilot_bounces = 1 << 15  # that look for bright faces: 20 ms
    at, (positions, normals, lifts) = model.static, Places.of_receivers(model)
    shares = np.cumsum(np.where(normals.any(axis=1), weights, 0.0))
    rows = np.searchsorted(shares, shares[-1] * (np.arange(pilot_bounces) + 0.5) / pilot_bounces)
    path = np.arange(pilot_bounces)
    ends = starts(path, path, positions[rows], normals[rows], lifts[rows])
    origin, direction = np.empty((2, pilot_bounces, 3), np.float32)
    scatter(model.world.bsdfs, seed, pilot_bounces.bit_length() - 1, 0, ends, origin, direction)
    limits = np.full(pilot_bounces, FAR * model.world.size, np.float32)
    _, face = nearest_in_world(model.accelerator, at, origin, direction, limits)
    in_front = (model.surfaces.normals[face] * direction).sum(axis=1) < 0.0
    return np.bincount(face[(face >= 0) & in_front], minlength=model.surfaces.face_range(0).stop).astype(np.float64)
