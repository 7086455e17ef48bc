"""Places of objects: free ones for new objects, on what lies below, beside another object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import groupby, product
from typing import TYPE_CHECKING

import numpy as np

from gi_core.base.vectors import frame_of
from gi_core.model import Model
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene import Pose
from gi_core.scene.pose import three

if TYPE_CHECKING:
    from app.draw.camera import Turntable
    from app.session.open_scene import OpenScene


SUNK = 0.05  # of an object: it may stand so deep in the floor, which need not be level, and a copy in others


def free_pose(session: OpenScene, poses: Mapping[str, Pose], name: str, near: np.ndarray | None) -> Pose | None:
    """Return the pose of an object at the free place nearest to a point that an eye sees, None where none is free.

    poses: of all mobiles; near: point and eye (2, 3) [m], None for the place where the object is, and its pose if that
    is free. The object slides there over what lies below the point, without passing through static faces, and stands on
    level ground. Where the eye sees no free place, the nearest one is taken.
    """
    low, high = session.box_of((name,), poses)
    at = np.array(poses[name].position)
    lows, highs = _boxes(session, [session.box_of((other,), poses) for other in poses if other != name])
    up = frame_of(session.scene.up)[2]
    foot = SUNK * float((high - low) @ np.abs(up)) * up
    low, high = low + np.maximum(foot, 0), high + np.minimum(foot, 0)

    def is_free(to: np.ndarray) -> bool:
        return not ((lows < high + to - at) & (highs > low + to - at)).all(axis=1).any()

    if near is None and is_free(at):
        return poses[name]

    def is_seen(place: np.ndarray) -> bool:
        if near is None:
            return True
        to = place + float((high - low) @ np.abs(up)) / 2 * up - near[1]
        away = float(np.linalg.norm(to))
        return bool(_reach(session.model, poses, (name,), near[1:], to[None] / away)[0] > away)

    free = filter(is_free, _places(session, poses, name, at if near is None else near[0]))
    place = first = next(free, None)
    while place is not None and not is_seen(place):
        place = next(free, None)
    place = first if place is None else place
    return None if place is None else poses[name]._replace(position=three(place))


def _places(session: OpenScene, poses: Mapping[str, Pose], name: str, near: np.ndarray) -> np.ndarray:
    """Return places (n, 3) [m] for the middle of an object's foot below a point and rings about it, the nearest first.

    Mobiles are no obstacles on the way there, but one may be what lies below. What lies below the corners of the foot
    must be as high as below its middle.
    """
    ring_directions = 12  # directions about the point
    east, north, up = frame_of(session.scene.up)
    size, (low, high) = session.chosen.scene_size, session.box_of((name,), poses)
    length, width, height = ((high - low) @ np.abs(axis) for axis in (east, north, up))
    near = near + GAP * size * up
    below = _reach(session.model, poses, poses, near[None], -up[None])[0]
    near = near - (below - GAP * size if np.isfinite(below) else 0) * up
    start = near + min(height, _reach(session.model, poses, poses, near[None], up[None])[0]) / 2 * up
    angle = 2 * np.pi * np.arange(ring_directions) / ring_directions
    ways = np.cos(angle)[:, None] * east + np.sin(angle)[:, None] * north
    free = _reach(session.model, poses, poses, np.broadcast_to(start, ways.shape), ways)
    radii = [max((length + width) / 4, GAP * size)]
    while radii[-1] < size:
        radii.append(1.25 * radii[-1])
    rings = [start + r * ways[free > r] for r in radii]
    above = np.concatenate((start[None], *rings))
    foot = np.array([(0, 0), (-1, -1), (-1, 1), (1, -1), (1, 1)]) / 2 @ np.stack([length * east, width * north])
    corners = (above[:, None] + foot).reshape(-1, 3)
    drop = _reach(session.model, poses, (name,), corners, np.broadcast_to(-up, corners.shape)).reshape(-1, len(foot))
    lands = np.isfinite(drop).all(axis=1)
    above, drop = above[lands], drop[lands]
    level = np.ptp(drop, axis=1) < SUNK * height
    return above[level] - (drop[level].min(axis=1) - GAP * size)[:, None] * up


def _reach(model: Model, poses: Mapping[str, Pose], without: Iterable[str], origins, directions) -> np.ndarray:
    """Return the distances (n,) [m] of rays from origins (n, 3) to the nearest faces, inf for none; without mobiles."""
    far = AWAY * model.scene_size * frame_of(model.scene.up)[2]
    poses = {**poses, **{name: poses[name]._replace(position=three(poses[name].position + far)) for name in without}}
    start = np.ascontiguousarray(origins - model.origins[0], np.float32)
    ways = np.ascontiguousarray(directions, np.float32)
    limits = np.full(len(start), np.inf, np.float32)
    t, face = nearest_in_world(model.accelerator, model.transforms(poses), start, ways, limits)
    return np.where(face >= 0, t.astype(np.float64), np.inf)


def _boxes(session: OpenScene, boxes: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Return corners low and high (n, 3) [m] of all boxes: static faces', and these."""
    corners = session.scene.static.vertices[session.scene.static.faces]
    lows = np.concatenate([corners.min(axis=1), *([low] for low, _ in boxes)])
    return lows, np.concatenate([corners.max(axis=1), *([high] for _, high in boxes)])


AWAY = 1e3  # of the scene's size: where the object itself is out of the rays' way
GAP = 1e-5  # of the scene's size between object and floor: their faces must not coincide


def lowered_pose(model: Model, poses: dict[str, Pose], name: str) -> Pose | None:
    """Return the pose of an object at rest on what lies below it; None if nothing does."""
    up, size = frame_of(model.scene.up)[2], model.scene_size
    points = model.vertices_at(1 + model.names.index(name), poses)
    heights = points @ up
    # The lowest vertices decide on level ground, the others on steps.
    points = points[np.argsort(heights, kind="stable")[:4096]]  # 4096 rays downwards from vertices
    lift = 0.1 * max(float(np.ptp(heights)), GAP * size)  # it may begin 0.1 of its height deep in the floor
    drop = _reach(model, poses, (name,), points + lift * up, np.broadcast_to(-up, points.shape)).min() - lift
    if not np.isfinite(drop):
        return None
    return poses[name]._replace(position=three(poses[name].position - (drop - GAP * size) * up))


FARTHEST = 4  # place tried along each way


def beside(session: OpenScene, camera: Turntable, names: tuple[str, ...]) -> np.ndarray:
    """Return the shift (3,) [m] to a free place beside objects: right of them in the picture, left, behind, in front.

    Then places further away, on a grid. Where no place is free, the copy may stand in others, and where none is in the
    scene's box, to the right.
    """
    low, high = session.box_of(names)
    shifts = _aside(high - low, session.scene.up, camera.basis()[0])
    inside = [s for s in shifts if _holds(session, low + s, high + s)]
    boxes = _boxes_of_all(session)
    free = (s for s in inside if not _meets(boxes, low + s, high + s))
    return next(free, (inside or shifts)[0])


def _aside(size: np.ndarray, up: tuple[float, float, float], right: np.ndarray) -> list[np.ndarray]:
    """Return shifts (3,) by multiples of a size (3,) and a gap along the two horizontal axes, the nearest first.

    Of places equally near, the first one is that farthest along `right` (3,).
    """
    # 0.05 of the box of the objects lies between it and the copy's
    a, b = np.diag(size * 1.05)[sorted(range(3), key=lambda k: abs(up[k]))[:2]]
    ways = range(-FARTHEST, FARTHEST + 1)
    near = sorted(((i, j) for i, j in product(ways, ways) if (i, j) != (0, 0)), key=lambda p: abs(p[0]) + abs(p[1]))
    rings = groupby(near, key=lambda p: abs(p[0]) + abs(p[1]))
    return [s for _, ring in rings for s in sorted((i * a + j * b for i, j in ring), key=lambda s: -float(s @ right))]


def _holds(session: OpenScene, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether a box lies in that of the scene."""
    margin = SUNK * (high - low)
    return bool((low + margin >= session.chosen.low).all() and (high - margin <= session.chosen.high).all())


def _boxes_of_all(session: OpenScene) -> tuple[np.ndarray, np.ndarray]:
    """Return corners low and high (n, 3) [m] of the boxes of static faces, mobiles, and copies not yet on show."""
    from gi_core.files.edits import Duplicate

    boxes = [session.box_of((name,)) for name in session.poses]
    for edit in session.edits:
        if isinstance(edit, Duplicate) and edit.name not in session.poses and edit.of in session.poses:
            shift = np.subtract(edit.pose.position, session.poses[edit.of].position)
            low, high = session.box_of((edit.of,))
            boxes.append((low + shift, high + shift))
    return _boxes(session, boxes)


def _meets(boxes: tuple[np.ndarray, np.ndarray], low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether a box overlaps one of the boxes, low and high corners (n, 3) [m]."""
    margin, (lows, highs) = SUNK * (high - low), boxes
    return bool(((lows < high - margin) & (highs > low + margin)).all(axis=1).any())
