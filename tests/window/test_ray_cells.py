"""Cells over the picture belong to the structure that traces rays now."""

from __future__ import annotations

import re
from types import SimpleNamespace

from app.draw.camera import from_camera, scene_bounds
from app.window.ray_cells import RayCells
from gi_core.model import Model
from tests.support.scene_builders import coloured_room


def test_cells_follow_the_structure_while_the_cursor_is_on_the_panel():
    """The panel changes the structure: the cursor is then outside the picture, where its last position counts."""
    cells, scene = RayCells(), coloured_room(())
    shown = []
    for rays, mouse in (("bvh", (60, 40)), ("octree", (900, 40)), ("none", (900, 40)), ("octree", (60, 40))):
        model = Model(scene, rays=rays)
        camera = from_camera(scene.camera, scene.up, scene_bounds(model, model.start_poses()))
        view = SimpleNamespace(camera=camera, aspect=1.0, origin=(0, 0), size=(100, 100))
        cells.update(SimpleNamespace(session=SimpleNamespace(model=model), view=view), mouse)
        shown.append(cells.text)
    assert [text.split(":")[0] for text in shown] == ["bvh", "octree", "none has no cells to show", "octree"]
    assert shown[1] == shown[3] and int(re.search(r"on the ray: (\d+)", shown[1])[1]) > 0
