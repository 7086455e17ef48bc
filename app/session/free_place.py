"""A place for an inserted object where its box meets no other object: the nearest to a point, on what lies below."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from app.draw.camera import frame_of
from app.session.lowering import AWAY, GAP
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene import Pose
from gi_core.scene.pose import three

if TYPE_CHECKING:
    from app.session.open_scene import OpenScene

RING = 12  # directions about the point
GROWTH = 1.25  # ratio of the radii of neighbouring rings
FOOT = 0.05  # of the object's height: it may stand so deep in the floor, which need not be level


def free_pose(session: OpenScene, poses: Mapping[str, Pose], name: str, near: np.ndarray | None) -> Pose | None:
    """Return the pose of an object at the free place nearest to a point (3,) [m], None where there is none.

    poses: of all mobiles; near: None for the place where the object is, and its pose if that is free. The object slides
    there over what lies below the point, without passing through static faces, and stands on level ground.
    """
    low, high = session.box_of((name,), poses)
    at, (lows, highs) = np.array(poses[name].position), _boxes(session, poses, name)
    up = frame_of(session.scene.up)[2]
    foot = FOOT * float((high - low) @ np.abs(up)) * up
    low, high = low + np.maximum(foot, 0), high + np.minimum(foot, 0)

    def is_free(to: np.ndarray) -> bool:
        return not ((lows < high + to - at) & (highs > low + to - at)).all(axis=1).any()

    if near is None and is_free(at):
        return poses[name]
    for place in _places(session, poses, name, at if near is None else near):
        if is_free(place):
            return poses[name]._replace(position=three(place))
    return None


def _places(session: OpenScene, poses: Mapping[str, Pose], name: str, near: np.ndarray) -> np.ndarray:
    """Return places (n, 3) [m] for the middle of an object's foot below a point and rings about it, the nearest first.

    Mobiles are no obstacles on the way there, but one may be what lies below. What lies below the corners of the foot
    must be as high as below its middle.
    """
    east, north, up = frame_of(session.scene.up)
    size, (low, high) = session.chosen.scene_size, session.box_of((name,), poses)
    length, width, height = ((high - low) @ np.abs(axis) for axis in (east, north, up))
    near = near + GAP * size * up
    below = _reach(session, poses, poses, near[None], -up[None])[0]
    near = near - (below - GAP * size if np.isfinite(below) else 0) * up
    start = near + min(height, _reach(session, poses, poses, near[None], up[None])[0]) / 2 * up
    angle = 2 * np.pi * np.arange(RING) / RING
    ways = np.cos(angle)[:, None] * east + np.sin(angle)[:, None] * north
    free = _reach(session, poses, poses, np.broadcast_to(start, ways.shape), ways)
    radii = [max((length + width) / 4, GAP * size)]
    while radii[-1] < size:
        radii.append(GROWTH * radii[-1])
    rings = [start + r * ways[free > r] for r in radii]
    above = np.concatenate((start[None], *rings))
    foot = np.array([(0, 0), (-1, -1), (-1, 1), (1, -1), (1, 1)]) / 2 @ np.stack([length * east, width * north])
    corners = (above[:, None] + foot).reshape(-1, 3)
    drop = _reach(session, poses, (name,), corners, np.broadcast_to(-up, corners.shape)).reshape(-1, len(foot))
    lands = np.isfinite(drop).all(axis=1)
    above, drop = above[lands], drop[lands]
    level = np.ptp(drop, axis=1) < FOOT * height
    return above[level] - (drop[level].min(axis=1) - GAP * size)[:, None] * up


def _reach(session: OpenScene, poses: Mapping[str, Pose], without: Iterable[str], origins, directions) -> np.ndarray:
    """Return the distances (n,) [m] of rays from origins (n, 3) to the nearest faces, inf for none; without mobiles."""
    model, far = session.model, AWAY * session.chosen.scene_size * frame_of(session.scene.up)[2]
    poses = {**poses, **{name: poses[name]._replace(position=three(poses[name].position + far)) for name in without}}
    start = np.ascontiguousarray(origins - model.origins[0], np.float32)
    ways = np.ascontiguousarray(directions, np.float32)
    limits = np.full(len(start), np.inf, np.float32)
    t, face = nearest_in_world(model.accelerator, model.transforms(poses), start, ways, limits)
    return np.where(face >= 0, t.astype(np.float64), np.inf)


def _boxes(session: OpenScene, poses: Mapping[str, Pose], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return corners low and high (n, 3) [m] of the boxes of static faces and of the other mobiles."""
    corners = session.scene.static.vertices[session.scene.static.faces]
    boxes = [session.box_of((other,), poses) for other in poses if other != name]
    lows = np.concatenate([corners.min(axis=1), *([low] for low, _ in boxes)])
    highs = np.concatenate([corners.max(axis=1), *([high] for _, high in boxes)])
    return lows, highs
