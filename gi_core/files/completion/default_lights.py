"""Default lights of scenes without light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.files.completion.camera_view import unit
from gi_core.files.completion.pilot import Box, Rays, bottom_centre, corners_of, horizontal, ring
from gi_core.geometry.paint import join_finishes, join_paints
from gi_core.scene.pose import to_world
from gi_core.scene.types import Material, Mesh, Scene, SkyLight

RADIANCE = 10.0  # [W/m2/sr]; exposure is metered, so only its colour matters
SKY = 0.05 * RADIANCE  # in the open: nothing else brings light to the sides that the lamp does not see
LAMP_DROP = 0.03  # of the headroom: the lamp hangs that far below the ceiling
LAMP_SIDE = 0.3  # of the headroom
LEAST_SIDE = 0.08  # the same, where beams or furniture leave little room
LOOK_UP = 0.3  # of the headroom: from there ceilings are sought, and the lamp must see it
ASIDE = (0.25, 0.5, 0.8)  # of the headroom: where else it may hang
OPEN_AWAY = 0.5  # of the scene's size: without a ceiling, how far the lamp is above everything, and towards the camera
OPEN_SIDE = 0.8  # of the scene's size
NAME = "default light"  # material of the lamp
SAID = "no light in the file: "  # the note about it begins so


def lit_by_stand_ins(scene: Scene) -> bool:
    """Return whether all light of the scene is a default light."""
    return any(note.startswith(SAID) for note in scene.notes)


def headroom(scene: Scene, rays: Rays, box: Box, stand: np.ndarray) -> float:
    """Return the height [m] above `stand` (3,) of the first thing over the first mobile; inf under the sky."""
    up = np.array(scene.up)
    top = float((to_world(scene.mobiles[0].pose, scene.mobiles[0].mesh.vertices) @ up).max() - stand @ up)
    start = max(top * 1.02, 1e-3 * box.size)
    t, _ = rays.hits((stand + up * start)[None], up[None])
    return float(t[0]) + start


def lamp_below_ceiling(scene: Scene, rays: Rays, stand: np.ndarray, height: float) -> Scene:
    """Return the scene with a square lamp over `stand` (3,), just below the ceiling at `height` [m], facing down.

    Under a beam or a cupboard it hangs beside instead, in sight of the place below.
    """
    up = np.array(scene.up)
    around = ring(up, 8)
    low = stand + up * LOOK_UP * height
    best, side = stand + up * height * (1 - LAMP_DROP), 0.0
    for offset in (np.zeros(3), *(share * height * d for share in ASIDE for d in around)):
        above, _ = rays.hits((low + offset)[None], up[None])
        top = float(above[0]) + LOOK_UP * height
        if not (top <= height * 1.5 and rays.sees(low, (low + offset)[None])[0]):
            continue  # under the sky, or behind a wall
        centre = stand + offset + up * top * (1 - LAMP_DROP)
        if not rays.sees(centre, low[None])[0]:
            continue
        t, _ = rays.hits(np.broadcast_to(centre, around.shape), around)
        free = min(LAMP_SIDE * height, 1.5 * float(t.min()))
        if free > side:
            best, side = centre, free
    where = "below the object over the mobile" if scene.mobiles else "below the ceiling"
    return _with_lamp(scene, best, max(side, LEAST_SIDE * height), -up, around[0], where)


def lamp_in_the_open(scene: Scene, rays: Rays, box: Box) -> Scene:
    """Return the scene with a square lamp above everything, towards the camera, facing the middle; and a dim sky."""
    up = np.array(scene.up)
    middle = (box.low + box.high) / 2
    centre = middle + up * (float((corners_of(rays.low, rays.high) @ up).max()) - float(middle @ up))
    centre += OPEN_AWAY * box.size * up
    if scene.camera is not None:
        towards = np.subtract(scene.camera.position, middle)
        centre = centre + OPEN_AWAY * box.size * unit(towards - (towards @ up) * up)
    normal = unit(middle - centre)
    across = unit(np.cross(normal, horizontal(up)[1]))
    sky = SkyLight("default sky", (SKY,) * 3)
    lit = _with_lamp(scene, centre, OPEN_SIDE * box.size, normal, across, "above the scene, under a dim sky")
    return replace(lit, lights=(*lit.lights, sky))


def _with_lamp(scene: Scene, centre, side: float, normal, across, where: str) -> Scene:
    along = np.cross(normal, across)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = np.array([centre + side / 2 * (a * across + b * along) for a, b in signs])
    material = Material(NAME, (0.0, 0.0, 0.0), (RADIANCE,) * 3)
    note = f"{SAID}a lamp of {side:.3g} x {side:.3g} m hangs {where}"
    return replace(
        scene,
        static=_with_quad(scene, corners, normal),
        materials=(*scene.materials, material),
        notes=(*scene.notes, note),
    )


def _with_quad(scene: Scene, corners: np.ndarray, normal: np.ndarray) -> Mesh:
    m = scene.static
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + len(m.vertices)
    normals, colours = m.corner_normals, m.face_reflectance
    quad = Mesh(corners, faces, np.zeros(2, np.int32), None, np.zeros((2, 3)))
    return m._replace(
        vertices=np.concatenate([m.vertices, corners]),
        faces=np.concatenate([m.faces, faces]).astype(np.int32),
        face_material=np.concatenate([m.face_material, [len(scene.materials)] * 2]).astype(np.int32),
        corner_normals=None if normals is None else np.concatenate([normals, np.broadcast_to(normal, (2, 3, 3))]),
        face_reflectance=None if colours is None else np.concatenate([colours, np.zeros((2, 3))]),
        paint=join_paints([m, quad], scene.materials),
        finish=join_finishes([m, quad]),
    )


def stand_of(scene: Scene) -> np.ndarray:
    """Return the middle of the bottom of the first mobile's box. (3,) [m]."""
    mobile = scene.mobiles[0]
    return bottom_centre(to_world(mobile.pose, mobile.mesh.vertices), np.array(scene.up))
