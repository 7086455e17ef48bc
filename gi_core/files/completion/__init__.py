"""Completion of a scene whose file lacks places of mobiles, a light or a camera.

Mobiles stand upright, sized to the scene, on the nearest floor in view. A lamp hangs below the ceiling, or
above a scene in the open.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.base.vectors import length
from gi_core.files.completion.camera_view import unit
from gi_core.files.completion.floors import Column, floor_spot
from gi_core.files.completion.pilot import Box, Rays, bottom_centre, corners_of, horizontal, is_lit, ring, useful_box
from gi_core.files.completion.viewpoint import default_camera
from gi_core.geometry.mesh_parts import join
from gi_core.lights.daylight import LUMENS_PER_WATT
from gi_core.scene.pose import least_turn, to_world
from gi_core.scene.types import Material, Mesh, Pose, Scene, SkyLight

SMALLEST_MOBILE, LARGEST_MOBILE = 1 / 150, 1 / 3  # of the scene's size: a mobile beyond is in other units
SCALED = 1 / 8  # of the scene's size, after scaling
RADIANCE = 10.0  # [W/m2/sr], 1,790 cd/m2 in a photometric file: beside luminaires that are added it neither blinds nor
# is black
SKY = 0.05  # of it, in the open: nothing else brings light to the sides that the lamp does not see
DEFAULT_LAMP = "default light"  # material of the lamp
SAID = "no light in the file: "  # the note about it begins so


def complete(scene: Scene, unplaced, bare: bool, rays: Rays | None = None):
    """Return the scene with every mobile placed, a light and a camera; and rays and useful box if it is bare.

    unplaced: (index of a mobile, up axis of its file or None to take its coordinates as they are); rays: against the
    static part, if they exist already.
    """
    if not unplaced and is_lit(scene, rays) and scene.camera is not None and not bare:
        return scene, None, None

    rays = rays or Rays(scene)
    box = useful_box(scene, rays)
    for index, up in unplaced:
        if up is not None:
            scene = sized(scene, index, up, box.size)
    waiting = [index for index, _ in unplaced]
    standing = [i for i in range(len(scene.mobiles)) if i not in waiting]
    if scene.camera is None:
        scene, box = _with_camera(scene, rays, box, waiting, standing)
    for index in waiting:
        scene, _ = place(scene, index, rays, box, standing)
        standing.append(index)
    if not is_lit(scene, rays):
        subject, height = _subject(scene, rays, box)
        indoors = np.isfinite(height)
        scene = lamp_below_ceiling(scene, rays, subject, height) if indoors else lamp_in_the_open(scene, rays, box)
        box = useful_box(scene, rays) if bare else box
    return scene, rays, box


def _with_camera(scene: Scene, rays, box, waiting: list[int], standing: list[int]):
    """Return the scene with a camera, and the box of the part that it shows.

    The camera shows most of a room, or of the whole scene in the open. If the first mobile has no visible place in
    that picture, the mobile is placed first, and the camera shows it.
    """
    if standing:
        return _looking(scene, rays, box)
    empty, seen = _looking(replace(scene, mobiles=()), rays, box)
    if not waiting:
        return empty, seen
    index = waiting.pop(0)
    standing.append(index)
    placed, shown = place(replace(scene, camera=empty.camera), index, rays, seen, [])
    if shown:
        return placed, seen
    placed, _ = place(scene, index, rays, box, [])
    return _looking(placed, rays, box)


def _looking(scene: Scene, rays, box):
    """Return the scene with a camera on its first mobile, or on the place for one; and the box of the lit part."""
    subject, height = _subject(scene, rays, box)
    indoors = bool(np.isfinite(height))
    if not is_lit(scene, rays) and indoors:
        # Only the room that the lamp will light is worth looking at.
        box = useful_box(lamp_below_ceiling(scene, rays, subject, height), rays)
    return replace(scene, camera=default_camera(scene, rays, box, subject, indoors)), box


def _subject(scene: Scene, rays, box) -> tuple[np.ndarray, float]:
    """Return the place (3,) of the first mobile, or for one, and the headroom [m] above it, inf in the open."""
    if scene.mobiles:
        mobile = scene.mobiles[0]
        stand = bottom_centre(to_world(mobile.pose, mobile.mesh.vertices), np.array(scene.up))
        return stand, headroom(scene, rays, box, stand)
    size = (1 / 12) * box.size  # height of the object that a scene without mobiles is shown for
    spot = floor_spot(replace(scene, camera=None), rays, box, Column(size, size / 2))
    return spot.point, spot.headroom if spot.indoors else np.inf


# Mobiles --------------------------------------------------------------------------------------------


def sized(scene: Scene, index: int, file_up, size: float) -> Scene:
    """Return the scene with one mobile made ready: upright, its origin below its middle, at home in `size` [m].

    file_up: the up axis of the mobile's file. Scaled with a note if it is too large or too small.
    """
    mobile, up = scene.mobiles[index], np.array(scene.up)
    mesh = mobile.mesh
    R = least_turn(np.asarray(file_up, np.float64), up)
    mesh = mesh._replace(vertices=mesh.vertices @ R.T)
    if mesh.corner_normals is not None:
        mesh = mesh._replace(corner_normals=mesh.corner_normals @ R.T)
    mesh = mesh._replace(vertices=mesh.vertices - bottom_centre(mesh.vertices, up))
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    share = longest / size
    factor = 1.0 if SMALLEST_MOBILE <= share <= LARGEST_MOBILE else SCALED / share
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


def place(scene: Scene, index: int, rays: Rays, box: Box, placed: list[int]) -> tuple[Scene, bool]:
    """Return the scene with one mobile resting on the floor, clear of `placed`; and whether the camera shows it whole.

    With a camera the floor is the nearest in its view; without one, where a camera would look.
    """
    mobile, up = scene.mobiles[index], np.array(scene.up)
    spot = floor_spot(scene, rays, box, column(scene, index), _standing(scene, placed))
    notes = scene.notes
    if not spot.has_room:
        notes = (*notes, f'no free floor found for mobile "{mobile.name}": it stands where there is most room; drag it')
    pose = Pose(tuple(float(x) for x in spot.point - bottom_centre(mobile.mesh.vertices, up)))
    return replace(scene, mobiles=_with(scene, index, mobile._replace(pose=pose)), notes=notes), spot.shown


def _standing(scene: Scene, placed: list[int]) -> list[tuple[np.ndarray, float]]:
    """Return the middle (3,) [m] and radius [m] of each mobile that has its place."""
    balls = []
    for i in placed:
        v = to_world(scene.mobiles[i].pose, scene.mobiles[i].mesh.vertices)
        middle = (v.min(axis=0) + v.max(axis=0)) / 2
        balls.append((middle, float(length(v - middle).max())))
    return balls


def _with(scene: Scene, index: int, mobile):
    return (*scene.mobiles[:index], mobile, *scene.mobiles[index + 1 :])


# Lights ---------------------------------------------------------------------------------------------


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
    look_up = 0.3  # of the headroom: from there ceilings are sought, and the lamp must see it
    lamp_drop = 0.03  # of the headroom: the lamp hangs that far below the ceiling
    up = np.array(scene.up)
    around = ring(up, 8)
    low = stand + up * look_up * height
    best, side = stand + up * height * (1 - lamp_drop), 0.0
    for offset in (np.zeros(3), *(share * height * d for share in (0.25, 0.5, 0.8) for d in around)):
        above, _ = rays.hits((low + offset)[None], up[None])
        top = float(above[0]) + look_up * height
        if not (top <= height * 1.5 and rays.sees(low, (low + offset)[None])[0]):
            continue  # under the sky, or behind a wall
        centre = stand + offset + up * top * (1 - lamp_drop)
        if not rays.sees(centre, low[None])[0]:
            continue
        t, _ = rays.hits(np.broadcast_to(centre, around.shape), around)
        free = min(0.3 * height, 1.5 * float(t.min()))  # 0.3 of the headroom
        if free > side:
            best, side = centre, free
    where = "below the object over the mobile" if scene.mobiles else "below the ceiling"
    # 0.08 of it where beams or furniture leave little room
    return _with_lamp(scene, best, max(side, 0.08 * height), -up, around[0], where)


def lamp_in_the_open(scene: Scene, rays: Rays, box: Box) -> Scene:
    """Return the scene with a square lamp above everything, towards the camera, facing the middle; and a dim sky."""
    open_away = 0.5  # of the scene's size: without a ceiling, the lamp is so far above all, and towards the camera
    up = np.array(scene.up)
    middle = (box.low + box.high) / 2
    centre = middle + up * (float((corners_of(rays.low, rays.high) @ up).max()) - float(middle @ up))
    centre += open_away * box.size * up
    if scene.camera is not None:
        towards = np.subtract(scene.camera.position, middle)
        centre = centre + open_away * box.size * unit(towards - (towards @ up) * up)
    normal = unit(middle - centre)
    across = unit(np.cross(normal, horizontal(up)[1]))
    sky = SkyLight("default sky", (SKY * _radiance(scene),) * 3)
    # 0.8 of the scene's size
    lit = _with_lamp(scene, centre, 0.8 * box.size, normal, across, "above the scene, under a dim sky")
    return replace(lit, lights=(*lit.lights, sky))


def _with_lamp(scene: Scene, centre, side: float, normal, across, where: str) -> Scene:
    along = np.cross(normal, across)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = np.array([centre + side / 2 * (a * across + b * along) for a, b in signs])
    materials = (*scene.materials, Material(DEFAULT_LAMP, (0.0, 0.0, 0.0), (_radiance(scene),) * 3))
    normals = None if scene.static.corner_normals is None else np.broadcast_to(normal, (2, 3, 3))
    quad = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.full(2, len(scene.materials)), normals)
    note = f"{SAID}a lamp of {side:.3g} x {side:.3g} m hangs {where}"
    return replace(scene, static=join([scene.static, quad], materials), materials=materials, notes=(*scene.notes, note))


def _radiance(scene: Scene) -> float:
    """Return the radiance of a default lamp, or its luminance, in the units of the file."""
    return RADIANCE * (LUMENS_PER_WATT if scene.units == "photometric" else 1.0)
