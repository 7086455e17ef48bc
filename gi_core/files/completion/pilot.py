"""Pilot trace: the box of the lit part of a scene, from a few paths; and rays and directions for completion.

The bounding box misleads: a ground slab may be five times the room that stands on it. Real photons mislead too: most of
those of a sun stay outside the windows, and dark walls end the others. Their box is 9.9 m in LuxCore's kitchen, that
of these paths the 7.6 m of the room. These paths survive every bounce, and start from all kinds of lights alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.threads import available_cores
from gi_core.base.vectors import box, central_box, dot, length
from gi_core.files.completion.camera_view import unit
from gi_core.geometry.surfaces import face_normals, flatten
from gi_core.rays.accelerator import Accelerator
from gi_core.scene.types import DistantLight, PlacedLight, Scene, SkyLight

BOUNCES = 4
COMPLETION_SEED = 0x5EED
AT_PLACE = 5e-4  # of the distance to a place: a hit so near to it is the surface that the place lies on


class Box(NamedTuple):
    """The box of the central hits, with these hits."""

    low: np.ndarray  # (3,) [m]
    high: np.ndarray  # (3,) [m]
    size: float  # longest side [m]
    hits: np.ndarray  # (n, 3) the central hits [m]
    normals: np.ndarray  # (n, 3) unit, on the side that the light came to
    side_hits: np.ndarray  # (F, 2) int64, how many hits each face of the static part had on its front and back


def lift_off(corners: np.ndarray) -> np.ndarray:
    """Return how far (n, 1) [m] rays start off faces of corners (n, 3, 3)."""
    # 1e-5 of a face's largest coordinate clears the face that a ray starts on, in float32
    return 1e-5 * np.abs(corners).max(axis=(1, 2), initial=0.0)[:, None]


class Rays:
    """Rays against the static part of a scene."""

    def __init__(self, scene: Scene):
        statics = Scene(scene.static, scene.materials)
        self.surfaces, _ = flatten(statics, with_receivers=False)
        self.accelerator = Accelerator(self.surfaces, available_cores()).opaque
        v = scene.static.vertices[scene.static.faces.reshape(-1)]
        self.low, self.high = box(v)
        self.extent = float((self.high - self.low).max())
        self._lifts = lift_off(v.reshape(-1, 3, 3))

    def hits(self, origins, directions):
        """Return distance (n,), inf where nothing is hit, and face (n,), -1 there."""
        o = np.ascontiguousarray(origins, np.float32)
        d = np.ascontiguousarray(directions, np.float32)
        t, face = self.accelerator.nearest(0, o, d, np.full(len(o), 8 * max(self.extent, 1e-9), np.float32))
        return np.where(face >= 0, t.astype(np.float64), np.inf), face

    def lifts(self, face: np.ndarray) -> np.ndarray:
        """Return how far (n, 1) [m] rays start off faces (n,)."""
        return self._lifts[face]

    def sees(self, a, b) -> np.ndarray:
        """Return whether nothing is between points a (n, 3) or (3,) and b (n, 3). (n,) bool."""
        to = b - a
        t, _ = self.hits(np.broadcast_to(a, to.shape), unit(to))
        return t > (1 - AT_PLACE) * length(to)


def useful_box(scene: Scene, rays: Rays) -> Box:
    """Return the box of the central 98 % of hits of paths from the lights, or from the surfaces if it is dark."""
    rng = np.random.default_rng(COMPLETION_SEED)
    origins, directions, normals = _starts(scene, rays, rng)
    # In the dark a place counts that light could reach from another, and any that light could start from.
    hits, sides = ([], []) if is_lit(scene, rays) else ([origins], [normals])
    side_hits = np.zeros((len(scene.static.faces), 2), np.int64)
    for _ in range(BOUNCES):
        t, face = rays.hits(origins, directions)
        landed = face >= 0
        if not landed.any():
            break
        points = origins[landed] + directions[landed] * t[landed, None]
        hits.append(points)
        n = rays.surfaces.normals[face[landed]]
        facing = -np.sign(dot(n, directions[landed]))
        go_on = (facing > 0) | rays.surfaces.two_sided[face[landed]]  # the back of a one-sided face absorbs
        sides.append(n * facing[:, None])
        np.add.at(side_hits, (face[landed], (facing < 0).astype(int)), 1)
        n = (n * facing[:, None])[go_on]
        origins = points[go_on] + n * rays.lifts(face[landed][go_on])
        directions = cosine(n, rng)
    hit_points, facing = (np.concatenate(a) if a else np.zeros((0, 3)) for a in (hits, sides))
    low, high = rays.low, rays.high
    if len(hit_points) >= 100:
        low, high = central_box(hit_points)
    size = max(float((high - low).max()), 1e-9)
    edge = AT_PLACE * size  # hits on walls at the box's sides are central, however their coordinates are rounded
    central = ((hit_points >= low - edge) & (hit_points <= high + edge)).all(axis=1)
    return Box(low, high, size, hit_points[central], facing[central], side_hits)


def is_lit(scene: Scene, rays: Rays | None = None) -> bool:
    """Return whether the scene has a light, or faces that can light others: the glow of a switch cannot.

    rays: against the static part, if they exist already.
    """
    if scene.lights:
        return True
    normals, areas = face_normals(scene.static)
    flux = _emission(scene) * np.pi * areas  # [W or lm]
    # up to a mean irradiance of 1e-4 W/m2 or lx emissive faces light nothing
    if not flux.any() or flux.sum() > 1e-4 * areas.sum():
        return bool(flux.any())
    rays = rays or Rays(scene)
    rng = np.random.default_rng(COMPLETION_SEED)
    origins, directions, _ = _from_faces(scene.static, rays, normals, flux, rng, 2000)
    reach, face = rays.hits(origins, directions)
    # The ground may be far larger than the part that the lamp reaches: nine tenths of its hits are so near.
    return bool((face >= 0).any() and flux.sum() > 1e-4 * np.pi * np.quantile(reach[face >= 0], 0.9) ** 2)


def _emission(scene: Scene) -> np.ndarray:
    """Return the radiance (F,) of the static faces, of their brightest channel."""
    return np.array([max(m.emission) for m in scene.materials])[scene.static.face_material]


def cells(box: Box, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the cells (n, 3) int64, a 14th of the box's size, of points (n, 3) [m] with normals (n, 3)."""
    # Half a cell off the surface: the outside of a wall that is lit inside is dark.
    # 0.3819 of a cell: walls and floors at round numbers must not flicker between two cells
    return np.floor(points / (1 / 14 * box.size) + 0.5 * normals + 0.3819).astype(np.int64)


def spread(box: Box, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return up to `most` hits (n, 3), one a cell, their normals (n, 3), and their weights (n,), which sum to 1.

    The weight is the square root of the cell's hits: light caught in a narrow gap must not outvote the room.
    """
    if not len(box.hits):
        return ((box.low + box.high) / 2)[None], np.zeros((1, 3)), np.ones(1)
    _, one, count = np.unique(cells(box, box.hits, box.normals), axis=0, return_index=True, return_counts=True)
    chosen = np.random.default_rng(COMPLETION_SEED).permutation(len(one))[:most]
    weight = np.sqrt(count[chosen])
    rows = one[chosen]
    return box.hits[rows], box.normals[rows], weight / weight.sum()


def horizontal(up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (3,) that are horizontal and at right angles."""
    axis = np.eye(3)[int(np.argmin(np.abs(up)))]
    east = unit(np.cross(up, axis))
    return east, np.cross(up, east)


def ring(up: np.ndarray, n: int) -> np.ndarray:
    """Return n horizontal directions (n, 3), evenly around."""
    east, north = horizontal(up)
    a = np.arange(n)[:, None] * 2 * np.pi / n
    return np.cos(a) * east + np.sin(a) * north


def corners_of(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the eight corners (8, 3) of a box."""
    return np.where((np.arange(8)[:, None] >> np.arange(3)) & 1, high, low)


def bottom_centre(vertices: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the centre (3,) [m] of the bottom of a box, upright along `up`, around the vertices (V, 3)."""
    east, north = horizontal(up)
    middle = [(vertices @ d).min() / 2 + (vertices @ d).max() / 2 for d in (east, north)]
    return middle[0] * east + middle[1] * north + (vertices @ up).min() * up


def sphere_directions(n: int) -> np.ndarray:
    """Return n directions (n, 3) spread evenly (a Fibonacci spiral)."""
    k = np.arange(n)
    z = 1 - (2 * k + 1) / n
    r, a = np.sqrt(1 - z * z), k * np.pi * (3 - np.sqrt(5))
    return np.stack([r * np.cos(a), r * np.sin(a), z], axis=1)


def cosine(normals: np.ndarray, rng) -> np.ndarray:
    """Return a cosine-distributed unit direction (n, 3) about each unit normal (n, 3)."""
    return unit(normals * (1 + 1e-6) + unit(rng.normal(size=normals.shape)))


def _starts(scene: Scene, rays: Rays, rng):
    """Return origins, directions, normals: shared out among emissive faces, lamps with a place and the sky.

    In the dark they start on all faces.
    """
    mesh = scene.static
    normals, areas = face_normals(mesh)
    emission = _emission(scene) * areas * is_lit(scene, rays)
    placed = [np.array(light.position) for light in scene.lights if isinstance(light, PlacedLight)]
    distant = [light for light in scene.lights if isinstance(light, DistantLight)]
    kinds = [emission.any(), bool(placed), bool(distant)]
    n = 6000 // max(sum(kinds), 1)  # with BOUNCES segments each some 20,000 hits
    parts = []
    if emission.any():
        parts.append(_from_faces(mesh, rays, normals, emission, rng, n))
    if placed:
        d = unit(rng.normal(size=(n, 3)))
        parts.append((np.stack(placed)[rng.integers(len(placed), size=n)], d, np.zeros((n, 3))))
    if distant:
        sun = distant[0]
        toward = np.array(scene.up) if isinstance(sun, SkyLight) else -np.array(sun.direction)
        sides = np.where(dot(normals, toward) < 0, -1.0, 1.0)
        # 4 places tried for each that sun or sky shall reach
        landed = _from_faces(mesh, rays, normals * sides[:, None], areas, rng, n * 4)
        # Where it lands, not where it would land through walls.
        d = np.broadcast_to(toward, landed[0].shape)
        d = cosine(d, rng) if isinstance(sun, SkyLight) else unit(d)
        free = np.flatnonzero((rays.hits(landed[0], d)[1] < 0) & (dot(d, landed[2]) > 0))
        rows = free[:n] if len(free) else slice(n)
        parts.append(tuple(column[rows] for column in landed))
    if not parts:
        two_sided = np.array([m.two_sided for m in scene.materials])[mesh.face_material]
        sides = np.where(two_sided & (rng.random(len(areas)) < 0.5), -1.0, 1.0)
        parts.append(_from_faces(mesh, rays, normals * sides[:, None], areas, rng, n))
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def _from_faces(mesh, rays: Rays, normals, weight, rng, n: int):
    """Return n origins on faces picked by weight (F,), cosine-distributed directions about their normals, and these."""
    face = np.searchsorted(np.cumsum(weight) / weight.sum(), rng.random(n), side="right").clip(0, len(weight) - 1)
    u, v = rng.random((2, n, 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = (mesh.vertices[mesh.faces[face, k]] for k in range(3))
    up = normals[face]
    return a + u * (b - a) + v * (c - a) + up * lift_off(mesh.vertices[mesh.faces[face]]), cosine(up, rng), up
