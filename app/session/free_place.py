"""Places of objects: free ones for new objects, at rest on the surface below, beside another object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from app.draw.camera import Turntable
from app.session.open_scene import OpenScene
from gi_core.base.vectors import frame_of
from gi_core.model import Model
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene import Pose
from gi_core.scene.pose import three

SUNK = 0.05  # of an object: it may stand so deep in the floor, which need not be level


def free_pose(session: OpenScene, poses: Mapping[str, Pose], name: str, near: np.ndarray | None) -> Pose | None:
    """Return the pose of an object at the free place nearest to a point that an eye sees, None where none is free.

    poses: of all mobiles; near: point and eye (2, 3) [m], None for the place where the object is, and its pose if that
    is free. The object slides there over the surfaces below the point, without passing through static faces. It stands
    on level ground. Where the eye sees no free place, the nearest one is taken.
    """
    low, high = session.box_of((name,), poses)
    at = np.array(poses[name].position)
    boxes = [session.box_of((other,), poses) for other in poses if other != name]
    faces = session.scene.static.vertices[session.scene.static.faces]
    lows, highs = (np.concatenate([f(faces, axis=1), *([b[k]] for b in boxes)]) for k, f in enumerate((np.min, np.max)))
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

    Mobiles are no obstacles on the way there, but one may lie below. The surface below the corners of the foot must be
    as high as below its middle.
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


AWAY = 1e3  # of the scene's size: where the object itself is out of the rays' way
GAP = 1e-5  # of the scene's size between object and floor: their faces must not coincide


def lowered_pose(model: Model, poses: dict[str, Pose], name: str) -> Pose | None:
    """Return the pose of an object at rest on the surface below it; None if there is none."""
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


def beside(session: OpenScene, camera: Turntable, names: tuple[str, ...]) -> np.ndarray:
    """Return the shift (3,) [m] of copies beside objects, as far right in the picture as they go.

    Of four shifts the first counts that keeps them in the box of the scene, else that to the right.
    """
    (low, high), up = session.box_of(names), np.abs(session.scene.up)
    # 0.05 of the box of the objects lies between it and the copies'
    across, along = np.diag(1.05 * (high - low))[np.argsort(up, kind="stable")[:2]]
    right, margin = camera.basis()[0], SUNK * (high - low)
    shifts = sorted((across, -across, along, -along), key=lambda s: -float(s @ right))

    def is_inside(shift: np.ndarray) -> bool:
        lowest, highest = low + shift + margin, high + shift - margin
        return bool((lowest >= session.chosen.low).all() and (highest <= session.chosen.high).all())

    return next(filter(is_inside, shifts), shifts[0])
