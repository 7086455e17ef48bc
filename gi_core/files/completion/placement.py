"""Placement of mobiles without a pose: upright, sized to the scene, on the nearest floor in view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.base.vectors import length
from gi_core.files.completion.floors import Column, floor_spot
from gi_core.files.completion.pilot import Box, Rays, bottom_centre, horizontal
from gi_core.scene.pose import to_world
from gi_core.scene.types import Pose, Scene

SMALLEST, LARGEST = 1 / 150, 1 / 3  # of the scene's size: a mobile beyond is in other units
SCALED = 1 / 8  # of the scene's size, after scaling


def sized(scene: Scene, index: int, file_up, size: float) -> Scene:
    """Return the scene with one mobile made ready: upright, its origin below its middle, at home in `size` [m].

    file_up: the up axis of the mobile's file. Scaled with a note if it is too large or too small.
    """
    mobile, up = scene.mobiles[index], np.array(scene.up)
    mesh = mobile.mesh
    R = turn(np.asarray(file_up, np.float64), up)
    mesh = mesh._replace(vertices=mesh.vertices @ R.T)
    if mesh.corner_normals is not None:
        mesh = mesh._replace(corner_normals=mesh.corner_normals @ R.T)
    mesh = mesh._replace(vertices=mesh.vertices - bottom_centre(mesh.vertices, up))
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    share = longest / size
    factor = 1.0 if SMALLEST <= share <= LARGEST else SCALED / share
    notes = scene.notes
    if factor != 1.0:
        mesh = mesh._replace(vertices=mesh.vertices * factor)
        note = f'mobile "{mobile.name}" scaled by {factor:.3g}: it is {longest:.3g} long in a scene of {size:.3g}'
        notes = (*notes, note)
    return replace(scene, mobiles=_with(scene, index, mobile._replace(mesh=mesh)), notes=notes)


def column(scene: Scene, index: int) -> Column:
    """Return the upright cylinder round a mobile, about the centre of its bottom."""
    up = np.array(scene.up)
    v = scene.mobiles[index].mesh.vertices
    off = v - bottom_centre(v, up)
    flat = off - (off @ up)[:, None] * up
    return Column(float((off @ up).max()), float(length(flat).max()))


def place(scene: Scene, index: int, rays: Rays, box: Box, others: list[int], lit: bool) -> tuple[Scene, bool]:
    """Return the scene with one mobile resting on the floor, clear of `others`; and whether the camera shows it whole.

    With a camera the floor is the nearest in its view; without one, where a camera would look.
    """
    mobile, up = scene.mobiles[index], np.array(scene.up)
    spot = floor_spot(scene, rays, box, column(scene, index), _standing(scene, others), lit)
    notes = scene.notes
    if not spot.found:
        notes = (*notes, f'no free floor found for mobile "{mobile.name}": it stands where there is most room; drag it')
    pose = Pose(tuple(float(x) for x in spot.point - bottom_centre(mobile.mesh.vertices, up)))
    return replace(scene, mobiles=_with(scene, index, mobile._replace(pose=pose)), notes=notes), spot.shown


def _standing(scene: Scene, others: list[int]) -> list[tuple[np.ndarray, float]]:
    """Return the middle (3,) [m] and radius [m] of each mobile that has its place."""
    balls = []
    for i in others:
        v = to_world(scene.mobiles[i].pose, scene.mobiles[i].mesh.vertices)
        middle = (v.min(axis=0) + v.max(axis=0)) / 2
        balls.append((middle, float(length(v - middle).max())))
    return balls


def _with(scene: Scene, index: int, mobile):
    return (*scene.mobiles[:index], mobile, *scene.mobiles[index + 1 :])


def turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of least angle that carries unit vector a to b."""
    c = float(a @ b)
    if c < -1 + 1e-9:
        e = horizontal(a)[0]
        return 2 * np.outer(e, e) - np.eye(3)
    k = np.cross(a, b)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + K + K @ K / (1 + c)
