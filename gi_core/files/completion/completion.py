"""Completion of a scene whose file lacks places of mobiles, a light or a camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.files.completion.default_lights import headroom, lamp_below_ceiling, lamp_in_the_open, stand_of
from gi_core.files.completion.floors import Column, floor_spot
from gi_core.files.completion.pilot import Rays, is_lit, useful_box
from gi_core.files.completion.placement import place, sized
from gi_core.files.completion.viewpoint import default_camera
from gi_core.scene.types import Scene

DEFAULT_COLUMN = 1 / 12  # of the scene's size: height of the object that a scene without mobiles is shown for


def complete(scene: Scene, unplaced, bare: bool, rays: Rays | None = None):
    """Return the scene with every mobile placed, a light and a camera; and rays and useful box if it is bare.

    unplaced: (index of a mobile, up axis of its file or None to take its coordinates as they are); rays: against the
    static part, if they exist already.
    """
    if not unplaced and is_lit(scene) and scene.camera is not None and not bare:
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
        scene, _ = place(scene, index, rays, box, standing, is_lit(scene))
        standing.append(index)
    if not is_lit(scene):
        scene = _with_light(scene, rays, box)
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
    placed, shown = place(replace(scene, camera=empty.camera), index, rays, seen, [], is_lit(scene))
    if shown:
        return placed, seen
    placed, _ = place(scene, index, rays, box, [], is_lit(scene))
    return _looking(placed, rays, box)


def _looking(scene: Scene, rays, box):
    """Return the scene with a camera on its first mobile, or on the place for one; and the box of the lit part."""
    subject, height = _subject(scene, rays, box)
    indoors = bool(np.isfinite(height))
    if not is_lit(scene) and indoors:
        # Only the room that the lamp will light is worth looking at.
        box = useful_box(lamp_below_ceiling(scene, rays, subject, height), rays)
    return replace(scene, camera=default_camera(scene, rays, box, subject, indoors)), box


def _with_light(scene: Scene, rays, box):
    """Return the scene with a lamp below the ceiling over the first mobile, or in the open."""
    subject, height = _subject(scene, rays, box)
    if np.isfinite(height):
        return lamp_below_ceiling(scene, rays, subject, height)
    return lamp_in_the_open(scene, rays, box)


def _subject(scene: Scene, rays, box) -> tuple[np.ndarray, float]:
    """Return the place (3,) of the first mobile, or for one, and the headroom [m] above it, inf in the open."""
    if scene.mobiles:
        stand = stand_of(scene)
        return stand, headroom(scene, rays, box, stand)
    size = DEFAULT_COLUMN * box.size
    spot = floor_spot(replace(scene, camera=None), rays, box, Column(size, size / 2), (), is_lit(scene))
    return spot.point, spot.headroom if spot.indoors else np.inf
