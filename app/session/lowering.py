"""The pose of an object lowered, or raised a little, until it stands on what lies below it."""

from __future__ import annotations

import numpy as np

from gi_core.model import Model
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene import Pose
from gi_core.scene.pose import three

RAYS = 4096  # downwards from vertices
SUNK = 0.1  # of the object's height: it may begin so deep in the floor
AWAY = 1e3  # of the scene's box: where the object itself is out of the rays' way
GAP = 1e-5  # of the scene's box between object and floor: their faces must not coincide


def lowered_pose(model: Model, poses: dict[str, Pose], name: str) -> Pose | None:
    """Return the pose of an object at rest on what lies below it; None if nothing does."""
    up = np.array(model.scene.up, np.float64)
    up /= np.sqrt((up * up).sum())
    o = 1 + [m.name for m in model.scene.mobiles].index(name)
    points = model.vertices_at(o, poses) - model.origins[0]
    heights = points @ up
    size = float(np.ptp(model.surfaces.vertices[0], axis=0).max()) if len(model.surfaces.vertices[0]) else 1.0
    # The lowest vertices decide on level ground, the others on steps.
    points = points[np.argsort(heights, kind="stable")[:RAYS]]
    lift = SUNK * max(float(np.ptp(heights)), GAP * size)
    pose = poses[name]
    gone = pose._replace(position=three(np.array(pose.position) + AWAY * size * up))
    start = np.ascontiguousarray(points + lift * up, np.float32)
    down = np.ascontiguousarray(np.broadcast_to(-up, start.shape), np.float32)
    at = model.transforms({**poses, name: gone})
    t, face = nearest_in_world(model.accelerator, at, start, down, np.full(len(start), np.inf, np.float32))
    if not (face >= 0).any():
        return None
    drop = float(t[face >= 0].min()) - lift - GAP * size
    return pose._replace(position=three(np.array(pose.position) - drop * up))
