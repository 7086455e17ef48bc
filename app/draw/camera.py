"""A turntable camera: it looks at a pivot from a yaw, a pitch and a distance, and never rolls.

Every operation returns a new camera, so an animation is two cameras and a number between 0 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gi_core.scene import Camera, Pose
from gi_core.scene.pose import rotation, to_world

STEEPEST = np.radians(89.0)  # at 90 the side-ways direction has no answer
ORBIT_SPEED = np.radians(180.0)  # of a drag across the picture's height
DOLLY_STEP = 0.88  # what one notch of the wheel leaves of the distance
NEAREST, FARTHEST = 0.01, 30.0  # of the scene's radius: the range of distances
NEAR_SHARE = 1e-3  # of the far plane: 24 bits of depth then resolve 1e-4 of the scene
DEFAULT_VIEW = (np.radians(30.0), np.radians(22.0))  # yaw, pitch of a scene without a camera


@dataclass(frozen=True)
class Bounds:
    """A box around the scene."""

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
    """Where the camera is; lengths in metres, angles in radians."""

    pivot: tuple[float, float, float]
    distance: float
    yaw: float  # about `up`
    pitch: float  # of the eye above the pivot
    fov: float  # vertical
    up: tuple[float, float, float]
    bounds: Bounds

    # Directions -------------------------------------------------------------------------------------

    def basis(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the unit vectors right, upward and forward of the picture."""
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

    def projection(self, aspect: float) -> np.ndarray:
        """Return the (4, 4) float64 eye-to-clip matrix; the planes hug the scene's bounds."""
        far = float(np.linalg.norm(self.eye() - self.bounds.centre)) + 1.05 * self.bounds.radius
        near = max(far - 2.1 * self.bounds.radius, far * NEAR_SHARE)
        t = np.tan(self.fov / 2)
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

    def project(self, point, aspect: float) -> tuple[float, float] | None:
        """Return where a point appears in the picture, None behind the eye."""
        x, y, _, w = self.projection(aspect) @ self.view() @ [*point, 1.0]
        return ((x / w + 1) / 2, (1 - y / w) / 2) if w > 0 else None

    # Motions ----------------------------------------------------------------------------------------

    def orbit(self, dx: float, dy: float) -> Turntable:
        """Turn by a drag, in picture heights; the scene follows the hand."""
        pitch = float(np.clip(self.pitch + dy * ORBIT_SPEED, -STEEPEST, STEEPEST))
        return replace(self, yaw=self.yaw - dx * ORBIT_SPEED, pitch=pitch)

    def pan(self, dx: float, dy: float) -> Turntable:
        """Shift by a drag, in picture heights; what lies at the pivot's depth stays under the hand."""
        right, upward, _ = self.basis()
        height = 2 * self.distance * np.tan(self.fov / 2)
        pivot = np.array(self.pivot) + height * (dy * upward - dx * right)
        away = pivot - self.bounds.centre
        length = float(np.linalg.norm(away))
        if length > 3 * self.bounds.radius:  # nobody finds back from farther
            pivot = self.bounds.centre + away * (3 * self.bounds.radius / length)
        return replace(self, pivot=tuple(pivot))

    def dolly(self, notches: float) -> Turntable:
        """Go nearer by notches of the wheel."""
        r = self.bounds.radius
        distance = self.distance * DOLLY_STEP ** float(np.clip(notches, -100, 100))
        return replace(self, distance=float(np.clip(distance, NEAREST * r, FARTHEST * r)))

    def centred(self, point) -> Turntable:
        """Make a point the pivot: it comes to the middle at the depth that it has, seen from the same side."""
        depth = float((np.asarray(point, np.float64) - self.eye()) @ self.basis()[2])
        near = NEAREST * self.bounds.radius
        return replace(self, pivot=tuple(map(float, point)), distance=max(depth, near))

    def towards(self, other: Turntable, t: float) -> Turntable:
        """Return the camera a share t in [0, 1] of the way to another, slow at both ends, by the shorter turn."""
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

    def as_camera(self) -> Camera:
        """Return the same view as a scene's camera."""
        return Camera(tuple(map(float, self.eye())), tuple(map(float, self.pivot)), float(np.degrees(self.fov)))


def frame_of(up) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors east, north, up, right-handed; yaw 0 is east."""
    up = np.asarray(up, np.float64)
    up = up / np.linalg.norm(up)
    # Start from the axis that `up` leans on least; for up = y that makes east = x or z, whichever is first.
    axis = np.eye(3)[int(np.argmin(np.abs(up)))]
    east = axis - (axis @ up) * up
    east = east / np.linalg.norm(east)
    return east, np.cross(up, east), up


def from_camera(camera: Camera | None, up, bounds: Bounds, lit: Bounds | None = None) -> Turntable:
    """Return the turntable that shows what a scene's camera shows.

    Without one: what light reaches (`lit`, else all) from above a corner; a ground slab may be far larger.
    """
    if camera is None:
        lit = lit or bounds
        fov = np.radians(40.0)
        distance = lit.radius / np.sin(fov / 2)
        yaw, pitch = DEFAULT_VIEW
        return Turntable(tuple(lit.centre), float(distance), float(yaw), float(pitch), float(fov), tuple(up), bounds)
    east, north, upward = frame_of(up)
    back = np.array(camera.position, np.float64) - np.array(camera.target, np.float64)
    distance = float(np.linalg.norm(back))
    if distance == 0:
        return from_camera(None, up, bounds, lit)
    back = back / distance
    pitch = float(np.clip(np.arcsin(np.clip(back @ upward, -1, 1)), -STEEPEST, STEEPEST))
    flat = abs(back @ upward) > 1 - 1e-9
    yaw = 0.0 if flat else float(np.arctan2(back @ north, back @ east))
    return Turntable(
        tuple(map(float, camera.target)),
        distance,
        yaw,
        pitch,
        float(np.radians(camera.vertical_fov_degrees)),
        tuple(map(float, up)),
        bounds,
    )


def scene_bounds(solver, poses) -> Bounds:
    """Return the box round everything, mobiles at their poses."""
    surfaces = solver.surfaces
    points = [surfaces.vertices[0]]
    for mobile, vertices in zip(solver.scene.mobiles, surfaces.vertices[1:], strict=True):
        points.append(to_world(poses[mobile.name], vertices))
    points = [p for p in points if len(p)]
    if not points:
        return Bounds((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    low, high = np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)
    return Bounds(tuple(map(float, low)), tuple(map(float, high)))


def matrix(pose: Pose) -> np.ndarray:
    """Return the (4, 4) object-to-world matrix of a pose."""
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = rotation(pose), pose.position
    return M
