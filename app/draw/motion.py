"""Poses of mobiles per frame: along their paths, at a constant step or spread over the whole path."""

from __future__ import annotations

import numpy as np

from gi_core.scene import KeyFrames, Pose
from gi_core.scene.pose import pose_at, rotation
from gi_core.solver import Solver


def paths_of(solver: Solver) -> dict[str, KeyFrames]:
    """Return the paths of the scene's mobiles, else a circle for the first mobile.

    The circle's centre is that of the box of the central 98 % of photon hits.
    """
    scene, chosen = solver.scene, solver.chosen
    paths = {m.name: m.path for m in scene.mobiles if m.path is not None}
    if paths or not scene.mobiles:
        return paths
    mobile = scene.mobiles[0]
    return {mobile.name: _circle(mobile.pose, (chosen.low + chosen.high) / 2, scene.up, 0.25 * chosen.scene_size)}


def spread(paths: dict[str, KeyFrames], frames: int) -> list[dict[str, Pose]]:
    """Return the poses of `frames` frames, evenly spaced over the time of the longest path."""
    if not paths:
        return [{} for _ in range(frames)]
    start = min(float(p.times[0]) for p in paths.values())
    end = max(float(p.times[-1]) for p in paths.values())
    return [{name: pose_at(p, t) for name, p in paths.items()} for t in np.linspace(start, end, frames)]


def walk(paths: dict[str, KeyFrames], step: float, frames: int) -> list[dict[str, Pose]]:
    """Return the poses of each frame; each mobile moves `step` [m] along its path per frame.

    A closed path repeats, an open one reverses, so that every frame is a step.
    """
    distances = step * np.arange(frames)
    columns = {name: [pose_at(p, t) for t in _times_at(p, distances)] for name, p in paths.items()}
    return [{name: column[i] for name, column in columns.items()} for i in range(frames)]


def _times_at(path: KeyFrames, distances: np.ndarray) -> np.ndarray:
    """Return the times [s] at which the repeated path reaches the distances [m]."""
    # 32 samples of a path's length per key-frame interval
    fine = np.interp(np.arange(0, len(path.times) - 1 + 1e-9, 1 / 32), np.arange(len(path.times)), path.times)
    points = np.stack([np.interp(fine, path.times, path.positions[:, k]) for k in range(3)], axis=1)
    gone = np.concatenate([[0.0], np.cumsum(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)))])
    length = gone[-1]
    if not length > 0:  # rotation in place: a step is 1/100 of its time
        gone, length = fine - fine[0], fine[-1] - fine[0]
        distances = np.arange(len(distances)) * length / 100
    return np.interp(_within(path, distances, length), gone, fine)


def _within(path: KeyFrames, gone, length: float):
    """Return the place on a path of `length`, in its unit: a closed path repeats, an open one reverses."""
    if not length > 0:  # a path of one pose
        return 0.0 * gone
    closed = np.allclose(path.positions[0], path.positions[-1]) and np.isclose(
        abs(float(np.dot(path.quaternions[0], path.quaternions[-1]))), 1.0
    )
    return np.mod(gone, length) if closed else length - np.abs(np.mod(gone, 2 * length) - length)


def _circle(pose: Pose, centre: np.ndarray, up, radius: float) -> KeyFrames:
    """Return a circle around `centre` at the pose's height, starting towards the pose, without rotation."""
    circle_corners = 64
    n = np.asarray(up, np.float64)
    n = n / np.sqrt((n * n).sum())
    out = np.asarray(pose.position) - centre
    height = (out * n).sum()
    out = out - height * n
    if (out * out).sum() < (1e-6 * radius) ** 2:
        out = rotation(Pose())[int(np.argmin(np.abs(n)))]
        out = out - (out * n).sum() * n
    out = out / np.sqrt((out * out).sum())
    turn = 2 * np.pi * np.arange(circle_corners + 1) / circle_corners
    round_ = np.cos(turn)[:, None] * out + np.sin(turn)[:, None] * np.cross(n, out)
    positions = centre + height * n + radius * round_
    positions[-1] = positions[0]
    return KeyFrames(
        np.linspace(0.0, 8.0, circle_corners + 1), positions, np.tile(pose.quaternion, (circle_corners + 1, 1))
    )


def play_head(path: KeyFrames, seconds: float) -> float:
    """Return the path time [s] after `seconds` of playback: a closed path repeats, an open one reverses."""
    first, last = float(path.times[0]), float(path.times[-1])
    return first + float(_within(path, seconds, last - first))
