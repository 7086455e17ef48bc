"""Error of an estimate on tangent discs, predicted from a small trace.

Two formulas with measured constants (docs/decisions/default-settings.md):

- Noise is that of counting: a disc that expects n photons has a relative error of sqrt(2 / (pi n)). Where light is
  dense n is large; the mean over places where photons land is the L1 error. The Sobol sequence removes a sixth of it.
- Bias comes from discs that do not lie on free, even ground: an object cuts their plane, or nothing is below their
  rim. Such a disc reads the light of another surface, with an error of some 40 %. On even ground discs blur only the
  edges of shadows, which costs far less.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.nearest_points import nearest
from gi_core.geometry.sides import NONE
from gi_core.model import Model
from gi_core.photons.paths import PathVertices

LIT_PLACES = 2000  # lit places sampled
NEIGHBOURS = 8  # hits per density estimate
TURNED = 0.3  # of the scene's size: distance that a difference of 1 between normals counts as
FEWEST = 100  # hits needed for a prediction
SOBOL = 0.82  # noise of the Sobol sequence over that of independent photons: 0.74 to 0.90 in six scenes
OFF = 0.4  # of the light on uneven ground: 0.2 to 0.8 in six scenes
DIRECTIONS = 8  # around a lit place
OBSTACLE_HEIGHT = 0.05  # of the radius above the ground: lower obstacles hide little of a disc
RIM = 0.7  # of the radius: half of a disc's area lies inside
BELOW = 0.3  # of the radius below the disc: lower ground is another surface


class Places(NamedTuple):
    """Lit places: a sample of hits of equal flux."""

    positions: np.ndarray  # (n, 3) float64 [m]
    normals: np.ndarray  # (n, 3) float64 unit, of the side that was hit
    density: np.ndarray  # (n,) float64, hits per photon and area there [1/m2]
    spacing: float  # [m] median distance between receivers there


class Pilot(NamedTuple):
    """A pilot trace and its hits."""

    photons: int
    paths: PathVertices
    hits: np.ndarray  # (n, 3) float64 [m]
    normals: np.ndarray  # (n, 3) float64 unit, of the side that was hit


def pilot_of(model: Model, paths: PathVertices) -> Pilot:
    """Return the hits of the paths of a pilot trace."""
    arrived = paths.side != NONE
    arrived[paths.offsets[:-1]] = False  # the first vertex of a path is on the light
    side = paths.side[arrived]
    normals = model.world.normals[side >> 1] * np.where(side & 1, -1.0, 1.0)[:, None]
    return Pilot(len(paths.offsets) - 1, paths, paths.position[arrived].astype(np.float64), normals)


def places(model: Model, pilot: Pilot, low: np.ndarray, high: np.ndarray, size: float) -> Places:
    """Return lit places in the box; only those in view of the scene's camera, if these are enough."""
    inside = ((pilot.hits >= low) & (pilot.hits <= high)).all(axis=1)
    rows = np.flatnonzero(inside if inside.sum() >= FEWEST else np.ones(len(inside), bool))
    seen = rows[_seen(model, pilot.hits[rows], pilot.normals[rows])]
    rows = seen if len(seen) >= FEWEST else rows
    rows = rows[np.linspace(0, len(rows) - 1, min(LIT_PLACES, len(rows))).astype(np.int64)]
    # Distances include normals, so hits on the other side of a board count as far away.
    apart = np.concatenate([pilot.hits, TURNED * size * pilot.normals], axis=1)
    k = min(NEIGHBOURS, len(apart) - 1)
    reach, _ = nearest(apart, apart[rows], k + 1)  # the nearest is the hit itself
    density = k / (math.pi * np.maximum(reach, 1e-6 * size) ** 2 * pilot.photons)
    static = model.surfaces.receiver_range(0)
    _, there = nearest(model.object_receivers.positions[static], pilot.hits[rows])
    spacing = float(np.sqrt(np.median(model.object_receivers.areas[static][there])))
    return Places(pilot.hits[rows], pilot.normals[rows], density, spacing)


def _seen(model: Model, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return which points (n,) bool the scene's camera sees; none without a camera. A picture is half as wide again."""
    camera = model.scene.camera
    if camera is None or not len(points):
        return np.zeros(len(points), bool)
    eye, forward = (np.array(v, np.float64) for v in (camera.position, camera.target))
    forward = (forward - eye) / max(float(np.linalg.norm(forward - eye)), 1e-30)
    way = eye - points
    distance = np.maximum(np.sqrt((way * way).sum(axis=1)), 1e-30)
    way /= distance[:, None]
    ahead = -(way @ forward) > math.cos(math.radians(0.75 * camera.vertical_fov_degrees))
    facing = (way * normals).sum(axis=1) > 0
    _, face = _nearest(model, points + 1e-3 * distance[:, None] * way, way, distance * (1 - 2e-3))
    return ahead & facing & (face < 0)


def noise(lit: Places, radius: float, photons: float) -> float:
    """Return the relative L1 error from counting that many photons on discs of that radius."""
    expected = lit.density * math.pi * radius * radius * photons
    # A disc that expects hardly any photons has an error of at most twice its light: other discs get nearly all.
    return float(np.minimum(SOBOL * np.sqrt(2 / math.pi / np.maximum(expected, 1e-30)), 2.0).mean())


def photons_for(lit: Places, radius: float, wanted: float) -> float:
    """Return the photons for which noise() is `wanted`."""
    return (noise(lit, radius, 1e12) / wanted) ** 2 * 1e12


def bias(model: Model, lit: Places, radius: float) -> float:
    """Return the relative l1 bias, which no number of photons removes; radius [m]."""
    return OFF * uneven(model, lit, radius)


def uneven(model: Model, lit: Places, radius: float) -> float:
    """Return the share of light at places whose disc is not entirely on free, flat ground; radius [m]."""
    n = lit.normals
    axis = np.eye(3)[np.abs(n).argmin(axis=1)]
    u = np.cross(n, axis)
    u /= np.sqrt((u * u).sum(axis=1))[:, None]
    v = np.cross(n, u)
    angle = 2 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    out = np.cos(angle)[:, None, None] * u + np.sin(angle)[:, None, None] * v
    start = np.broadcast_to(lit.positions + OBSTACLE_HEIGHT * radius * n, out.shape)
    free, _ = _nearest(model, start.reshape(-1, 3), out.reshape(-1, 3), np.full(out[..., 0].size, RIM * radius))
    rim = start + RIM * radius * out
    down = np.broadcast_to(-n, out.shape)
    _, ground = _nearest(model, rim.reshape(-1, 3), down.reshape(-1, 3), np.full(len(free), BELOW * radius))
    return float(((free < np.float32(RIM * radius)) | (ground < 0)).mean())


def _nearest(model: Model, origins, directions, limits):
    return model.accelerator.nearest(
        0, np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32),
        np.asarray(limits, np.float32),
    )  # fmt: skip
