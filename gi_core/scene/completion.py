"""What a scene needs and its file does not say: where mobiles stand, a light, a camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.scene.types import Scene


def complete(scene: Scene, unplaced, bare: bool):
    """Return the scene with every mobile placed, a light and a camera; and the useful box (None if not needed).

    unplaced: (index of a mobile, up axis of its file or None to take its coordinates as they are).
    """
    emits = np.array([any(m.emission) for m in scene.materials])
    lit = bool(scene.lights) or bool(emits[scene.static.face_material].any())
    if not unplaced and lit and scene.camera is not None and not bare:
        return scene, None
    from gi_core.scene.pilot import Rays, useful_box
    from gi_core.scene.placement import place
    from gi_core.scene.stand_ins import default_camera, default_light

    rays = Rays(scene)
    box = useful_box(scene, rays)
    for index, up in unplaced:
        scene = place(scene, index, up, rays, box)
    if not lit:
        scene = default_light(scene, rays, box)
    if scene.camera is None:
        scene = replace(scene, camera=default_camera(scene, rays, box))
    return scene, box
