"""Cells over the picture belong to the structure that traces rays now, and to a ray that the picture shows."""

import re
from types import SimpleNamespace

import numpy as np

from app.draw.camera import from_camera, scene_bounds
from app.draw.picking import Picker
from app.settings import CLICKED, POINTED, Settings
from app.window.method_marks import RayCells, on_picture
from gi_core.model import Model
from gi_core.scene.types import Camera, Material, Scene
from tests.support.scene_builders import box, coloured_room


def viewport_of(model: Model, camera=None, clicked=None, cells: str = POINTED) -> SimpleNamespace:
    """Return what RayCells reads of a viewport of 100 x 100 points."""
    scene, poses = model.scene, model.start_poses()
    camera = camera or from_camera(scene.camera, scene.up, scene_bounds(model, poses))
    view = SimpleNamespace(camera=camera, aspect=1.0, origin=(0, 0), size=(100, 100))
    session = SimpleNamespace(
        model=model, pose_list=poses, picker=Picker(model), settings=Settings(scene="", cells=cells)
    )
    return SimpleNamespace(session=session, view=view, clicked=clicked)


def numbers(cells: RayCells) -> list[int]:
    """Return cells on the ray, empty ones, and triangles in them."""
    found = re.search(r"cells on the ray: (\d+), (\d+) of them empty, triangles in them: ([\d,]+)", cells.text)
    return [int(text.replace(",", "")) for text in found.groups()]


def test_cells_follow_the_structure_while_the_cursor_is_on_the_panel():
    """The panel changes the structure: the cursor is then outside the picture, where its last position counts."""
    cells, scene = RayCells(), coloured_room(())
    shown = []
    for rays, mouse in (("bvh", (60, 40)), ("octree", (900, 40)), ("none", (900, 40)), ("octree", (60, 40))):
        cells.update(viewport_of(Model(scene, rays=rays)), mouse)
        shown.append(cells.text)
    assert [text.split(":")[0] for text in shown] == ["bvh", "octree", "none has no cells to show", "octree"]
    assert shown[1] == shown[3] and numbers(cells)[0] > 0


def test_the_ray_passes_walls_that_the_picture_leaves_out():
    """A room seen from outside: its near wall is culled, and the ray ends at the far one."""
    room = box((0, 0, 0), (1, 1, 1), 8, 0, inward=True)
    scene = Scene(room, (Material("grey"),), camera=Camera((0.53, -2.0, 0.53), (0.53, 0.5, 0.53), 30.0), up=(0, 0, 1))
    viewport, counts = viewport_of(Model(scene, rays="octree")), []
    for cull in (True, False):
        viewport.session.settings = Settings(scene="", cells=POINTED, cull=cull)
        cells = RayCells()
        cells.update(viewport, (50, 50))
        counts.append(numbers(cells))
    through, stopped = counts
    assert through[0] > stopped[0] and through[1] > 0 and through[2] > stopped[2] > 0


def test_the_ray_of_a_click_stays_while_the_camera_moves():
    model, cells = Model(coloured_room(()), rays="octree"), RayCells()
    viewport = viewport_of(model, cells=CLICKED)
    eye, d = viewport.view.camera.ray(0.3, 0.6, 1.0)
    viewport.clicked = viewport.session.picker.pick(eye, d, [], True)
    cells.update(viewport, (90, 90))
    before = cells.text
    pointed = RayCells()
    pointed.update(viewport_of(model), (30, 60))
    assert before == pointed.text
    first = cells._lines[-1][0]
    assert np.abs(first[0, 0] - first[0, 1]).max() < 1e-6  # the ray is a point where it starts
    viewport.view.camera = viewport.view.camera.orbit(0.5, 0.1)
    cells.update(viewport, (10, 10))
    assert cells.text == before
    assert np.abs(cells._lines[-1][0][0, 0] - cells._lines[-1][0][0, 1]).max() > 0.05
    viewport.clicked = None
    cells.update(viewport, (10, 10))
    assert cells.text != before


def test_lines_are_cut_in_front_of_the_eye():
    matrix = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]])  # the eye looks along z
    ahead, across, behind = [[0, 0, 1], [1, 0, 1]], [[0.5, 0, 1], [0.5, 0, -1]], [[0, 0, -1], [1, 0, -2]]
    found = on_picture(np.array([ahead, across, behind], float), matrix)
    assert len(found) == 2 and np.isfinite(found).all()
    assert np.allclose(found[0], [[0.5, 0.5], [1.0, 0.5]]) and np.allclose(found[1, 0], [0.75, 0.5])
    assert found[1, 1, 0] > 100  # the line leaves the picture to the right
