"""Acceleration structures: one per object, built once in object space.

A mobile's structure never changes: rays are transformed into its object space.
"""

from __future__ import annotations

import copy
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vectors import box, dot
from gi_core.geometry.surfaces import Surfaces
from gi_core.rays import holes, panes
from gi_core.rays.structures import DEFAULT, STRUCTURES, any_hit, nearest_hit, new_ray
from gi_core.scene.pose import rotation
from gi_core.scene.types import Pose

# Of the largest coordinate at hand, of an origin or a face; float32 rounds by 6e-8 of it. A share of the world's size
# would move light as soon as anything far away is in the file.
LIFT = 2e-6  # lifts a ray off the face that it leaves
GAP = 8 * LIFT  # between the end of a shadow ray and its light: rays meet lamps at smaller angles than they leave faces
CUT_PAD = 1e-5  # of a size: growth of bounding boxes, so that culling loses no hit
FAR = 4.0  # of the world's size: length of a segment that hits nothing


class Transforms(NamedTuple):
    """Object-to-world transforms of all objects, the static part (identity) first."""

    rotation: np.ndarray  # (objects, 3, 3) float64
    position: np.ndarray  # (objects, 3) float64


def transforms(poses: list[Pose]) -> Transforms:
    """Return the transforms of the static part (identity) and of the mobiles at `poses`, in that order."""
    return Transforms(
        np.stack([np.eye(3), *(rotation(p) for p in poses)]),
        np.array([(0.0, 0.0, 0.0), *(p.position for p in poses)], np.float64),
    )


class Accelerator:
    """Nearest-hit and any-hit queries against the objects of a scene."""

    def __init__(self, surfaces: Surfaces, threads: int = 1, rays: str = DEFAULT):
        self.first_face = surfaces.first_face
        self.threads, self.rays = threads, rays
        meshes = list(zip(surfaces.vertices, surfaces.faces, strict=True))
        self.has_panes = bool((surfaces.pane >= 0).any())
        build = (panes if self.has_panes else holes).build
        self.scenes = build(STRUCTURES[rays], meshes, surfaces)  # for kernels: all objects
        low, high = bounding_boxes(surfaces)
        pad = CUT_PAD * np.linalg.norm(high - low, axis=1).max()
        self.boxes = np.stack([low - pad, high + pad], axis=1)  # (objects, 2, 3), grown, in object space
        self.face_object = np.repeat(np.arange(surfaces.objects), np.diff(surfaces.first_face)).astype(np.int16)

    @property
    def opaque(self) -> Accelerator:
        """The same objects without their panes."""
        if not self.has_panes:
            return self
        other = copy.copy(self)
        other.scenes, other.has_panes = self.scenes.opaque, False
        return other

    def nearest(self, o: int, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray):
        """Return distance (n,) float32 and global face (n,) int32, -1 for none, in object o's space.

        origins, directions: (n, 3) float32, directions unit; limits: (n,) float32, not changed.
        """
        n, first = len(origins), self.first_face[o]
        origins, directions, limits = as_rays(origins, directions, limits)
        distances, faces = np.empty(n, np.float32), np.empty(n, np.int32)

        def work(_, a, b):
            part = origins[a:b], directions[a:b], limits[a:b], distances[a:b], faces[a:b]
            _nearest(self.scenes, o, first, new_ray(), *part)

        run_ranges(work, n, self.threads, COSTLY)
        return distances, faces

    def occluded(self, o: int, origins: np.ndarray, directions: np.ndarray, limits: np.ndarray) -> np.ndarray:
        """Return (n,) bool: object o blocks the ray within its limit; arguments as nearest()."""
        blocked = np.empty(len(origins), bool)
        origins, directions, limits = as_rays(origins, directions, limits)

        def work(_, a, b):
            _occluded(self.scenes, o, new_ray(), origins[a:b], directions[a:b], limits[a:b], blocked[a:b])

        run_ranges(work, len(origins), self.threads, COSTLY)
        return blocked


def as_rays(*arrays: np.ndarray) -> list[np.ndarray]:
    """Return arrays of any shape, contiguous and float32, as the kernels are compiled for."""
    return [np.ascontiguousarray(a, np.float32) for a in arrays]


@kernel
def _nearest(scenes, o, first_face, ray, origins, directions, limits, distances, faces):
    for k in range(len(origins)):
        ox, oy, oz = origins[k, 0], origins[k, 1], origins[k, 2]
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        distances[k], face = nearest_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, limits[k])
        faces[k] = face + first_face if face >= 0 else -1


@kernel
def _occluded(scenes, o, ray, origins, directions, limits, blocked):
    for k in range(len(origins)):
        ox, oy, oz = origins[k, 0], origins[k, 1], origins[k, 2]
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        blocked[k] = any_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, limits[k])


@kernel
def line(ox, oy, oz, ex, ey, ez):
    """Return the float32 unit direction and length of the line between two float32 points.

    Every use of a stored segment as a ray, in cuts and in disc tests, has these bits.
    """
    dx, dy, dz = np.float64(ex) - ox, np.float64(ey) - oy, np.float64(ez) - oz
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    s = 1.0 / length if length > 0.0 else 0.0
    return np.float32(dx * s), np.float32(dy * s), np.float32(dz * s), np.float32(length)


@kernel
def point_on_line(ox, oy, oz, dx, dy, dz, t):
    """Return origin + t direction as float32, computed in float64."""
    s = np.float64(t)
    return np.float32(ox + s * dx), np.float32(oy + s * dy), np.float32(oz + s * dz)


def _box(vertices: np.ndarray):
    if not len(vertices):
        return np.zeros(3), np.zeros(3)
    return box(vertices)


def bounding_spheres(surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
    """Return centre (objects, 3) in object space and radius (objects,) [m] of a bounding sphere per object."""
    low, high = bounding_boxes(surfaces)
    centres, radii = (low + high) / 2, np.zeros(surfaces.objects)
    for o, vertices in enumerate(surfaces.vertices):
        if len(vertices):
            off = vertices - centres[o]
            radii[o] = np.sqrt(dot(off, off).max())
    return centres, radii


def bounding_boxes(surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
    """Return corners low and high (objects, 3) of the bounding box per object, in object space."""
    low, high = zip(*(_box(v) for v in surfaces.vertices), strict=True)
    return np.array(low), np.array(high)


@kernel
def passes_box(ox, oy, oz, ex, ey, ez, low, high, pad):
    """Return whether the segment o-e intersects the box low - pad .. high + pad."""
    t0, t1 = _slab(ox, ex - ox, low[0] - pad, high[0] + pad, 0.0, 1.0)
    t0, t1 = _slab(oy, ey - oy, low[1] - pad, high[1] + pad, t0, t1)
    t0, t1 = _slab(oz, ez - oz, low[2] - pad, high[2] + pad, t0, t1)
    return t0 <= t1


@kernel
def _slab(o, d, low, high, t0, t1):
    if d == 0.0:
        return (t0, t1) if low <= o <= high else (1.0, 0.0)
    a, b = (low - o) / d, (high - o) / d
    return max(t0, min(a, b)), min(t1, max(a, b))
