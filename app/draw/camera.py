"""A turntable camera: pivot, distance, yaw and pitch, no roll.

Every operation returns a new camera; an animation blends two cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gi_core.base.vectors import frame_of
from gi_core.rays.accelerator import Transforms
from gi_core.scene import Camera
from gi_core.scene.pose import three

MAX_PITCH = np.radians(89.0)  # at 90 degrees the yaw is undefined
ORBIT_SPEED = np.radians(180.0)  # per picture height
MIN_DISTANCE = 0.01  # of the radius of the lit part
WIDE = np.radians(45.0)  # field of view for which these hold; narrower ones are farther away
PITCHES = -MAX_PITCH, MAX_PITCH
PARALLEL = np.radians(2.0)  # field of view of a parallel view: lengths at the scene's ends differ by 3 %
DEFAULT_VIEW = (math.radians(30.0), math.radians(22.0))  # yaw, pitch of a scene without a camera


@dataclass(frozen=True)
class Bounds:
    """An axis-aligned box [m]."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @property
    def centre(self) -> np.ndarray:
        return (np.array(self.low) + np.array(self.high)) / 2

    @property
    def radius(self) -> float:
        return max(float(np.linalg.norm(np.array(self.high) - np.array(self.low))) / 2, 1e-9)


@dataclass(frozen=True)
class Turntable:
    """A camera; lengths in metres, angles in radians."""

    pivot: tuple[float, float, float]
    distance: float
    yaw: float  # about `up`
    pitch: float  # of the eye above the pivot
    fov: float  # vertical
    up: tuple[float, float, float]
    bounds: Bounds  # of the scene
    lit: Bounds  # of the part that light reaches: something far away leaves the near plane as it is

    # Directions -------------------------------------------------------------------------------------

    def basis(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the unit vectors right, upward and forward of the picture, (3,) each."""
        east, north, up = frame_of(self.up)
        back = np.cos(self.pitch) * (np.cos(self.yaw) * east + np.sin(self.yaw) * north) + np.sin(self.pitch) * up
        right = -np.sin(self.yaw) * east + np.cos(self.yaw) * north
        return right, np.cross(back, right), -back

    def eye(self) -> np.ndarray:
        return np.array(self.pivot) - self.distance * self.basis()[2]

    # Matrices and rays ------------------------------------------------------------------------------

    def view(self) -> np.ndarray:
        """Return the (4, 4) float64 world-to-eye matrix."""
        right, upward, forward = self.basis()
        M = np.eye(4)
        M[:3, :3] = right, upward, -forward
        M[:3, 3] = -M[:3, :3] @ self.eye()
        return M

    def depths(self) -> tuple[float, float]:
        """Return the distances of the near and far plane, which enclose the scene's bounds [m]."""
        far, end = (float(np.linalg.norm(self.eye() - b.centre)) + 1.05 * b.radius for b in (self.bounds, self.lit))
        # 1e-3 of the lit part's end: 24 bits of depth resolve 1e-4 of it
        return max(far - 2.1 * self.bounds.radius, 1e-3 * end), far

    def projection(self, aspect: float) -> np.ndarray:
        """Return the (4, 4) float64 eye-to-clip matrix."""
        (near, far), t = self.depths(), np.tan(self.fov / 2)
        M = np.zeros((4, 4))
        M[0, 0], M[1, 1] = 1 / (t * aspect), 1 / t
        M[2, 2], M[2, 3] = (far + near) / (near - far), 2 * far * near / (near - far)
        M[3, 2] = -1.0
        return M

    def ray(self, u: float, v: float, aspect: float) -> tuple[np.ndarray, np.ndarray]:
        """Return origin and unit direction through a point of the picture, (0, 0) top left, (1, 1) bottom right."""
        right, upward, forward = self.basis()
        t = np.tan(self.fov / 2)
        d = forward + (2 * u - 1) * t * aspect * right + (1 - 2 * v) * t * upward
        return self.eye(), d / np.linalg.norm(d)

    # Motions ----------------------------------------------------------------------------------------

    def orbit(self, dx: float, dy: float) -> Turntable:
        """Turn by a drag, in picture heights; the scene follows the cursor."""
        pitch = float(np.clip(self.pitch + dy * ORBIT_SPEED, -MAX_PITCH, MAX_PITCH))
        return replace(self, yaw=self.yaw - dx * ORBIT_SPEED, pitch=pitch)

    def look(self, dx: float, dy: float) -> Turntable:
        """Turn about the eye by a drag, in picture heights; the scene follows the cursor."""
        turned = replace(self, yaw=self.yaw + dx * self.fov, pitch=float(np.clip(self.pitch - dy * self.fov, *PITCHES)))
        return replace(turned, pivot=three(self.eye() + self.distance * turned.basis()[2]))

    def fly(self, right: float, up: float, forward: float) -> Turntable:
        """Move by lengths [m] along the picture's right, the vertical and the view."""
        across, _, ahead = self.basis()
        return self._moved(right * across + up * frame_of(self.up)[2] + forward * ahead)

    def _moved(self, way: np.ndarray) -> Turntable:
        """Move the pivot by `way` (3,) [m], at most to three radii of the scene, which stays findable."""
        away = np.array(self.pivot) + way - self.bounds.centre
        share = 3.0 * self.bounds.radius / max(float(np.linalg.norm(away)), 1e-300)
        return replace(self, pivot=three(self.bounds.centre + away * min(1.0, share)))

    def with_fov(self, fov: float) -> Turntable:
        """Return the view with another field of view [rad]; things at the pivot keep their size."""
        return replace(self, fov=fov, distance=self.distance * float(np.tan(self.fov / 2) / np.tan(fov / 2)))

    @property
    def is_parallel(self) -> bool:
        """Whether lines that are parallel look so."""
        return self.fov <= PARALLEL

    def pan(self, dx: float, dy: float) -> Turntable:
        """Shift by a drag, in picture heights; points at the pivot's depth stay under the cursor."""
        right, upward, _ = self.basis()
        height = 2 * self.distance * np.tan(self.fov / 2)
        return self._moved(height * (dy * upward - dx * right))

    def dolly(self, notches: float) -> Turntable:
        """Approach the pivot by notches of the wheel."""
        wider = max(np.tan(WIDE / 2) / np.tan(self.fov / 2), 1.0)
        distance = self.distance * 0.88 ** float(np.clip(notches, -100, 100))  # 0.88 of the distance per notch
        nearest, farthest = MIN_DISTANCE * self.lit.radius, 30.0 * self.bounds.radius
        return replace(self, distance=float(np.clip(distance, nearest * wider, farthest * wider)))

    def centred(self, point) -> Turntable:
        """Make a point the pivot, at its present depth; the view direction stays."""
        depth = float((np.asarray(point, np.float64) - self.eye()) @ self.basis()[2])
        return replace(self, pivot=three(point), distance=max(depth, MIN_DISTANCE * self.lit.radius))

    def towards(self, other: Turntable, t: float) -> Turntable:
        """Return the blend with another camera at t in [0, 1], eased at both ends, by the shorter turn."""
        if t >= 1:
            return other  # exactly
        t = float(np.clip(t, 0, 1))
        s = t * t * (3 - 2 * t)
        turn = (other.yaw - self.yaw + np.pi) % (2 * np.pi) - np.pi
        pivot = np.array(self.pivot) * (1 - s) + np.array(other.pivot) * s
        return replace(
            other,
            pivot=tuple(pivot),
            distance=self.distance ** (1 - s) * other.distance**s,
            yaw=self.yaw + s * turn,
            pitch=self.pitch * (1 - s) + other.pitch * s,
            fov=self.fov * (1 - s) + other.fov * s,
        )

    def relative_to(self, origin: np.ndarray) -> Turntable:
        """Return the same view in coordinates that start at `origin` (3,) [m]."""
        corners = self.pivot, self.bounds.low, self.bounds.high, self.lit.low, self.lit.high
        pivot, low, high, *lit = (three(np.subtract(p, origin)) for p in corners)
        return replace(self, pivot=pivot, bounds=Bounds(low, high), lit=Bounds(*lit))

    def as_camera(self) -> Camera:
        """Return the same view as a camera record."""
        return Camera(three(self.eye()), three(self.pivot), float(np.degrees(self.fov)))


def from_camera(camera: Camera | None, up, bounds: Bounds, lit: Bounds | None = None) -> Turntable:
    """Return the turntable with the view of a scene's camera.

    Without a camera it frames the box that light reaches (`lit`, default all) from above a corner; a ground slab may
    be far larger than that box.
    """
    lit, back = lit or bounds, np.zeros(3) if camera is None else np.subtract(camera.position, camera.target)
    distance, fov = float(np.linalg.norm(back)), math.radians(camera.vertical_fov_degrees if camera else 40.0)
    if camera is None or distance == 0:
        return Turntable(three(lit.centre), lit.radius / math.sin(fov / 2), *DEFAULT_VIEW, fov, three(up), bounds, lit)
    east, north, upward = frame_of(up)
    back = back / distance
    pitch = float(np.clip(np.arcsin(np.clip(back @ upward, -1, 1)), *PITCHES))
    flat = abs(back @ upward) > 1 - 1e-9
    yaw = 0.0 if flat else float(np.arctan2(back @ north, back @ east))
    return Turntable(three(camera.target), distance, yaw, pitch, fov, three(up), bounds, lit)


def scene_bounds(model, poses) -> Bounds:
    """Return the box around all vertices, mobiles at their poses."""
    points = [p for o in range(model.surfaces.objects) if len(p := model.vertices_at(o, poses))]
    if not points:
        return Bounds((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    low, high = np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)
    return Bounds(three(low), three(high))


def matrices(at: Transforms) -> np.ndarray:
    """Return the (4, 4) object-to-world matrix of each object."""
    M = np.tile(np.eye(4), (len(at.position), 1, 1))
    M[:, :3, :3], M[:, :3, 3] = at.rotation, at.position
    return M
