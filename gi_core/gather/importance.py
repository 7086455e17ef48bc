"""Importance of receivers: how much their light counts in errors and noise.

Bounces from the view meet all of an open room by area, and little in gaps, such as that below a tile, where no one
looks. So errors count by the area that pixels of the scene's camera, and bounces from there, meet (Smits, Arvo and
Salesin 1992, An Importance-Driven Radiosity Algorithm).

The sun outside a house may be a thousand times brighter than a room. Noise relative to all light would be that outside,
and a room would stay mottled while its scene counts as done. So noise is relative to the light of each place that is
brighter than the median in view. Places that are white in the picture count less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.files.completion.camera_view import picture_rays, unit
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, LIFT

BACKS = 4  # of one-sided faces, which the camera sees through
WHITE = 8.0  # times the median in view, which is drawn mid-grey


def importance(model: Model, E: np.ndarray) -> np.ndarray:
    """Return the importance (n,) [m2] of receivers of luminance E (n,) [W/m2].

    n: all receivers, or those of the static part, which come first.
    """
    areas = areas_in_reach(model)[: len(E)]
    return areas * visual_shares(model, E, areas)


def areas_in_reach(model: Model) -> np.ndarray:
    """Return the area (R,) [m2] by which receivers count, whatever their light.

    Static receivers: the area of all, distributed as the view and bounces from there meet it; their own without a
    camera. Mobiles: their own.
    """
    out, static = model.object_receivers.areas.astype(np.float64), model.surfaces.receiver_range(0)
    met, rng = _in_view(model), np.random.default_rng(0)
    reached = met.receivers(static.stop)
    for _ in range(4):  # bounces
        z, turn = 2.0 * rng.random(len(met.area)) - 1.0, 2.0 * np.pi * rng.random(len(met.area))
        r = np.sqrt(1.0 - z * z)
        way = unit(met.normal + np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1))  # by the cosine
        met, _ = _meet(model, met.place, way, met.area, FAR * model.world.size)
        reached += met.receivers(static.stop)
    reached[out[static] == 0.0] = 0.0
    if reached.any():
        out[static] = reached * (out[static].sum() / reached.sum())
    return out


def visual_shares(model: Model, E: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Return shares (n,) by which noise of receivers of luminance E (n,) [W/m2] counts: 1 up to the level, less above.

    n: all receivers, or those of the static part, which come first. areas (n,) [m2]: find a level without a camera.
    """
    level = _median_in_view(model, E)
    if not level > 0.0:
        lit = E > 0.0
        level = _median(E[lit], areas[lit])
    if not level > 0.0:
        return np.ones(len(E))
    return (level / np.maximum(E, level)) * (WHITE * level / np.maximum(E, WHITE * level))


def _median_in_view(model: Model, E: np.ndarray) -> float:
    """Return the median luminance [W/m2] of static faces in the view of the scene's camera; 0: nothing is seen."""
    seen = _in_view(model)
    return float(np.median(E[seen.corners].mean(axis=1))) if len(seen.corners) else 0.0


class Met(NamedTuple):
    """Points where n rays meet the static part."""

    corners: np.ndarray  # (n, 3) int32, receivers at the corners of the face, on the side that is met
    place: np.ndarray  # (n, 3) float64 [m], off the surface
    normal: np.ndarray  # (n, 3) float64 unit, of that side
    area: np.ndarray  # (n,) float64, that each stands for

    def receivers(self, count: int) -> np.ndarray:
        """Return the areas (count,) of the receivers that were met."""
        return np.bincount(self.corners.reshape(-1), np.repeat(self.area / 3, 3), count)


def _in_view(model: Model) -> Met:
    """Return what pixels of the scene's camera show, past backs of one-sided faces; nothing without a camera."""
    camera, far = model.scene.camera, FAR * model.world.size
    if camera is None:
        return Met(np.zeros((0, 3), np.int32), *np.zeros((2, 0, 3)), np.zeros(0))
    eye, parts = np.array(camera.position, np.float64), []
    way = picture_rays([camera], model.scene.up, 64, 40)[0]
    rays = np.repeat(eye[None], len(way), axis=0), way, np.ones(len(way))
    for _ in range(BACKS):
        met, rays = _meet(model, *rays, far + float(np.linalg.norm(eye)))
        parts.append(met)
    seen = Met(*map(np.concatenate, zip(*parts, strict=True)))
    to_eye = eye - seen.place
    d2 = (to_eye * to_eye).sum(axis=1)
    slope = (to_eye * seen.normal).sum(axis=1) / np.sqrt(d2)
    return seen._replace(area=seen.area * d2 / np.maximum(slope, 0.1))  # 0.1: no pixel stands for ten times its area


Rays = tuple[np.ndarray, np.ndarray, np.ndarray]  # origin (n, 3) [m], unit direction (n, 3), area (n,) as of Met


def _meet(model: Model, origin: np.ndarray, way: np.ndarray, area: np.ndarray, far: float) -> tuple[Met, Rays]:
    """Return what Rays meet up to `far` [m], and those that go on past backs of one-sided faces."""
    s, reach = model.surfaces, model.world.reach
    limits = np.full(len(way), far, np.float32)
    distance, face = model.accelerator.opaque.nearest(0, origin.astype(np.float32), way.astype(np.float32), limits)
    hit = face >= 0
    origin, way, area, distance, face = origin[hit], way[hit], area[hit], distance[hit], face[hit]
    lift = LIFT * np.maximum(reach[face], np.abs(origin).max(axis=1, initial=0.0))
    front = (s.normals[face] * way).sum(axis=1) < 0
    on = front | s.two_sided[face]
    normal = np.where(front[:, None], 1.0, -1.0) * s.normals[face]
    corners = np.where(front[:, None], s.corner_front[face], s.corner_back[face])
    place = origin + distance[:, None] * way
    met = Met(corners[on], (place + lift[:, None] * normal)[on], normal[on], area[on])
    return met, ((place + lift[:, None] * way)[~on], way[~on], area[~on])


def _median(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the weighted median; 0 of nothing."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])]) if len(order) and total[-1] > 0 else 0.0
