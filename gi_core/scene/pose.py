"""Rigid poses: rotation matrices, key-frame interpolation, points to and from object space.

Arithmetic that reaches a path is written out element by element, as a BLAS product may differ in the last bit with the
number of rows. A frame would then differ from the same pose from scratch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from gi_core.scene.errors import SceneError, shown
from gi_core.scene.rules import BIGGEST, is_array
from gi_core.scene.types import KeyFrames, Pose

# Smaller deviations are corrected: rounded numbers, products of many float32 matrices. Larger ones mean a scale, or
# numbers of another meaning.


def rotation(pose: Pose) -> np.ndarray:
    """Return the (3, 3) float64 rotation matrix of a pose."""
    w, x, y, z = pose.quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def to_world(pose: Pose, points: np.ndarray) -> np.ndarray:
    """Carry points (n, 3) from object space to the world, float64."""
    R = rotation(pose)
    p = np.asarray(points, np.float64)
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    columns = [R[i, 0] * x + R[i, 1] * y + R[i, 2] * z + pose.position[i] for i in range(3)]
    return np.stack(columns, axis=1)


def to_world_at(rotations: np.ndarray, positions: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Carry points (n, 3) by a transform each: rotations (n, 3, 3), positions (n, 3), float64."""
    R, x, y, z = rotations, points[:, 0], points[:, 1], points[:, 2]
    columns = [R[:, i, 0] * x + R[:, i, 1] * y + R[:, i, 2] * z + positions[:, i] for i in range(3)]
    return np.stack(columns, axis=1)


def to_world_directions(pose: Pose, directions: np.ndarray) -> np.ndarray:
    """Carry directions (n, 3) from object space to the world, float64."""
    return to_world(Pose((0.0, 0.0, 0.0), pose.quaternion), directions)


def multiply_quaternions(a, b) -> tuple[float, float, float, float]:
    """Return the rotation `b` followed by `a`."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def axis_angle(axis, degrees: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion of a turn about an axis."""
    a = np.asarray(axis, np.float64)
    a = a / np.linalg.norm(a)
    half = np.radians(degrees) / 2
    s = np.sin(half)
    return (float(np.cos(half)), float(a[0] * s), float(a[1] * s), float(a[2] * s))


def least_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of least angle that carries unit vector a (3,) to b (3,)."""
    cosine, axis = float(a @ b), np.cross(a, b)
    if cosine < -1 + 1e-9:  # half a turn, about any axis
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        return 2 * np.outer(across, across) / (across @ across) - np.eye(3)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + K + K @ K / (1 + cosine)


def quaternion_of(R: np.ndarray) -> tuple[float, float, float, float]:
    """Return the unit quaternion, w >= 0, of a (3, 3) rotation matrix."""
    R = np.asarray(R, np.float64)
    # Each row estimates 4 q q_i for one i; the longest row is the best conditioned.
    K = np.array(
        [
            [1 + R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], 1 - R[0, 0] + R[1, 1] - R[2, 2], R[1, 2] + R[2, 1]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1 - R[0, 0] - R[1, 1] + R[2, 2]],
        ]
    )
    q = K[int(np.argmax(np.diag(K)))]
    q = q / np.linalg.norm(q)
    return four(q if q[0] >= 0 else -q)


def carried(poses: Mapping[str, Pose], before: Pose, after: Pose) -> dict[str, Pose]:
    """Return poses by name after the rigid motion that takes the pose `before` to `after`.

    A motion without a turn keeps quaternions bit for bit.
    """
    if before.quaternion == after.quaternion:
        shift = np.subtract(after.position, before.position)
        return {name: pose._replace(position=three(np.add(pose.position, shift))) for name, pose in poses.items()}
    w, x, y, z = before.quaternion
    turn = multiply_quaternions(after.quaternion, (w, -x, -y, -z))
    out = {}
    for name, pose in poses.items():
        away = Pose((0.0, 0.0, 0.0), turn), np.subtract(pose.position, before.position)[None]
        position = np.add(after.position, to_world(*away)[0])
        out[name] = as_pose(Pose(three(position), multiply_quaternions(turn, pose.quaternion)), f"mobile {shown(name)}")
    return out


def three(values: Iterable[float]) -> tuple[float, float, float]:
    """Return three numbers, say of an array, as a tuple of Python floats."""
    x, y, z = map(float, values)
    return x, y, z


def four(values: Iterable[float]) -> tuple[float, float, float, float]:
    """Return four numbers as a tuple of Python floats."""
    a, b, c, d = map(float, values)
    return a, b, c, d


def to_millionths(numbers: Iterable[float], size: float) -> tuple[float, ...]:
    """Return numbers [m] in decimal places of a millionth of a size [m]: the others come of a mouse and of float32."""
    places = 6 - math.floor(math.log10(max(size, 1e-300)))
    return tuple(round(float(x), places) + 0.0 for x in numbers)


def as_pose(pose: Pose | np.ndarray, where: str = "pose") -> Pose:
    """Check a pose, or turn a rigid (4, 4) matrix into one.

    Raises SceneError for anything that is not finite and rigid.
    """
    if isinstance(pose, Pose):
        if not is_array(pose.position, (3,)) or not is_array(pose.quaternion, (4,)):
            raise SceneError(
                f"{where}: a pose is three finite metres and four finite quaternion numbers, none over {BIGGEST:g}, "
                f"got {shown(pose)}"
            )
        q = np.asarray(pose.quaternion, np.float64)
        length = float(np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]))
        if abs(length - 1) > 1e-3:  # (0.707, 0, 0.707, 0) passes, (0.7, 0, 0.7, 0) does not
            instead = "1, 0, 0, 0" if length < 1e-9 else ", ".join(f"{c / length + 0.0:.4g}" for c in q)
            raise SceneError(
                f"{where}: the quaternion (w, x, y, z) of a pose must have length 1, got {length:.4g}; "
                f"write [{instead}], and scale the mesh instead if that was meant"
            )
        # a checked pose stays as it is: a saved one opens with the same bits
        return Pose(three(pose.position), four(q if abs(length - 1) < 1e-15 else q / length))
    if not is_array(pose, (4, 4)):
        raise SceneError(f"{where}: a pose is a Pose or a finite 4 x 4 matrix, got {shown(pose)}")
    M = np.asarray(pose, np.float64)
    R = M[:3, :3]
    off = np.abs(R.T @ R - np.eye(3)).max()
    if off > 1e-4 or np.linalg.det(R) < 0 or np.abs(M[3] - [0, 0, 0, 1]).max() > 0:
        raise SceneError(
            f"{where}: poses must be rigid (rotation and translation only), got a matrix with R^T R off 1 by "
            f"{off:.3g} and det {np.linalg.det(R):.3g}; bake scale into the mesh"
        )
    return Pose(three(M[:3, 3]), quaternion_of(R))


def pose_at(path: KeyFrames, time: float) -> Pose:
    """Return the pose on a path at a time [s], held at its two ends."""
    times = path.times
    t = float(np.clip(time, times[0], times[-1]))
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0)))
    if len(times) == 1:
        return Pose(three(path.positions[0]), four(path.quaternions[0]))
    u = (t - times[k]) / (times[k + 1] - times[k])
    position = path.positions[k] * (1 - u) + path.positions[k + 1] * u
    return Pose(three(position), _slerp(path.quaternions[k], path.quaternions[k + 1], u))


def _slerp(a: np.ndarray, b: np.ndarray, u: float) -> tuple[float, float, float, float]:
    cosine = float(np.dot(a, b))
    if cosine < 0:  # the shorter way round
        b, cosine = -b, -cosine
    if cosine > 1 - 1e-9:
        q = a * (1 - u) + b * u
    else:
        angle = np.arccos(cosine)
        q = (np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle)
    q = q / np.linalg.norm(q)
    return four(q)
