"""Scenes without a scene file: places of mobile, camera and lamp."""

from dataclasses import replace

import numpy as np
import pytest

from app.settings import OPTIONS, Settings, open_scene
from gi_core.files.completion import RADIANCE, complete
from gi_core.files.completion.camera_view import in_frame, picture_rays
from gi_core.files.load import load_scene
from gi_core.scene import Camera, Mesh, Mobile, Scene
from gi_core.scene.pose import to_world
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb, write_obj, write_room
from tests.support.scene_builders import box, grey, lamp, merge, quad, sphere

Y = (0.0, 1.0, 0.0)
GREY = (grey(0.7),)


def house() -> Mesh:
    """Return a thick-walled room of 6 x 2.5 x 5 m with a window, on one end of a walled terrace of 20 x 20 m."""
    terrace = box((-10, -1, -10), (10, 0, 10))
    walls = [
        box((-3, 0, -10), (-2.8, 2.5, -5)),
        box((2.8, 0, -10), (3, 2.5, -5)),
        box((-3, 0, -10), (3, 2.5, -9.8)),
        box((-3, 0, -5.2), (-1, 2.5, -5)),
        box((1, 0, -5.2), (3, 2.5, -5)),  # between the last two a window of 2 m
        box((-3, 2.5, -10), (3, 2.8, -5)),  # the roof
        box((-10, 0, 9.8), (10, 1, 10)),
    ]
    return merge(terrace, *walls)


def completed(mesh: Mesh, *mobiles: Mobile, materials=GREY, camera=None, lights=()) -> Scene:
    scene = Scene(mesh, materials, mobiles, lights, camera=camera)
    return complete(scene, [(i, np.array(Y)) for i in range(len(mobiles))], True)[0]


def cube(size: float, name: str = "cube") -> Mobile:
    h = size / 2
    return Mobile(name, box((-h, 0, -h), (h, size, h)))


def corners(scene: Scene, i: int = 0) -> np.ndarray:
    return to_world(scene.mobiles[i].pose, scene.mobiles[i].mesh.vertices)


def lamp_faces(scene: Scene) -> np.ndarray:
    """Return the corners (2, 3, 3) of the default light."""
    index = next(i for i, m in enumerate(scene.materials) if m.name == "default light")
    return scene.static.vertices[scene.static.faces[scene.static.face_material == index]]


def inside_house(points) -> bool:
    p = np.reshape(points, (-1, 3))
    return bool((np.abs(p[:, 0]) < 3).all() and (p[:, 1] < 2.5).all() and (p[:, 2] < -5).all())


def test_completion_of_a_house_with_a_terrace_stays_in_the_room():
    """The terrace is the larger floor by far, but objects on it would be outside the picture of the room."""
    scene = completed(house(), cube(0.6))
    assert inside_house(corners(scene)) and inside_house(scene.camera.position) and inside_house(lamp_faces(scene))
    assert corners(scene)[:, 1].min() == pytest.approx(0, abs=1e-4)
    assert np.abs(in_frame(scene.camera, Y, corners(scene))).max() < 1
    assert inside_house(completed(house()).camera.position)


def test_mobile_stands_in_view_of_the_files_camera():
    """Over the terrace, away from the house: the nearest floor in view, whole in the picture."""
    camera = Camera((0.0, 2.0, 0.0), (0.0, 1.0, 5.0))
    scene = completed(house(), cube(0.6), camera=camera)
    at = corners(scene)
    assert scene.camera == camera
    assert np.abs(in_frame(camera, Y, at)).max() < 1
    assert at[:, 1].min() == pytest.approx(0, abs=1e-4) and 0 < at[:, 2].mean() < 6
    behind = completed(house(), cube(0.6), camera=Camera((0.0, 2.0, 0.0), (0.0, 1.0, -5.0)))
    assert corners(behind)[:, 2].max() < 0


def test_mobiles_do_not_overlap():
    scene = completed(house(), cube(0.6, "a"), cube(0.6, "b"), cube(0.6, "c"))
    for i in range(3):
        for j in range(i):
            a, b = corners(scene, i), corners(scene, j)
            assert (a.min(axis=0) >= b.max(axis=0)).any() or (b.min(axis=0) >= a.max(axis=0)).any(), (i, j)


@pytest.mark.parametrize("gap", [0.01, 0.05])
def test_a_board_behind_cards_is_viewed_from_its_front(gap):
    """Light caught between them is best seen edge-on, and half of the hits are on the board's back."""
    corners = [(x, y, 0) for x in (-1.2, 0.2) for y in (-1.2, 0.2)]
    board = quad((-1, -1, -gap), (2, 0, 0), (0, 2, 0))
    scene = completed(merge(board, *(quad(c, (1, 0, 0), (0, 1, 0)) for c in corners)), materials=(grey(0.7, True),))
    x, y = in_frame(scene.camera, Y, board.vertices).T
    assert scene.camera.position[2] > 1
    assert np.ptp(x) * np.ptp(y) > 0.4, "a tenth of the picture"


@pytest.mark.parametrize("two_sided", [False, True])
def test_outward_closed_box_is_viewed_from_outside(two_sided):
    """Its inside is invisible, so a lamp inside would light nothing in view."""
    scene = completed(box((-1, -1, -1), (1, 1, 1)), materials=(grey(0.7, two_sided),))
    assert np.abs(scene.camera.position).max() > 1.5
    assert lamp_faces(scene)[..., 1].min() > 1
    assert np.abs(in_frame(scene.camera, Y, scene.static.vertices[:8])).max() < 1  # the whole of it


def test_a_closed_box_wound_inwards_is_a_room():
    scene = completed(box((-1, -1, -1), (1, 1, 1), inward=True), cube(0.3), materials=(grey(0.7, True),))
    assert np.abs(scene.camera.position).max() < 1
    assert (lamp_faces(scene)[..., 1] < 1).all() and (lamp_faces(scene)[..., 1] > 0.8).all()
    assert corners(scene)[:, 1].min() == pytest.approx(-1, abs=1e-4)


def test_open_front_faces_the_camera():
    """A Cornell box: five walls, the sixth open at +z, a lamp inside."""
    room = box((0, 0, 0), (1, 1, 1), inward=True)
    front = (room.vertices[room.faces][..., 2] == 1).all(axis=1)
    room = room._replace(faces=room.faces[~front], face_material=room.face_material[~front])
    light = quad((0.4, 0.99, 0.4), (0.2, 0, 0), (0, 0, 0.2), material=1)
    scene = completed(merge(room, light), cube(0.2), materials=(grey(0.7, True), lamp(10.0)))
    assert scene.camera.position[2] > 0.5
    filled = picture_rays([scene.camera], Y, 32, 20)[0]
    t = (0 - scene.camera.position[2]) / filled[:, 2]  # where the picture's rays cross the back wall
    at = np.array(scene.camera.position) + t[:, None] * filled
    back = (filled[:, 2] < 0) & (np.abs(at[:, :2] - 0.5) < 0.5).all(axis=1)
    assert back.mean() > 0.1
    assert np.abs(in_frame(scene.camera, Y, corners(scene))).max() < 1
    assert not any("no light" in n for n in scene.notes)


def test_horns_are_in_the_picture():
    """A block with a thin horn on each corner: horns catch less light than the share outside the useful box."""
    horns = [box((x, 1, z), (x + 0.02, 1.45, z + 0.02)) for x in (0, 3.98) for z in (0, 3.98)]
    block = merge(box((0, 0, 0), (4, 1, 4)), *horns)
    at = np.abs(in_frame(completed(block).camera, Y, block.vertices))
    assert 0.5 < at.max() < 1


def test_single_object_fits_the_frame_and_is_lit_from_the_camera():
    for mesh in (sphere((5, 5, 5), 2.0), box((0, 0, 0), (4, 0.1, 1)), quad((0, 0, 0), (0, 0, 3), (3, 0, 0))):
        scene = completed(mesh)
        at = np.abs(in_frame(scene.camera, Y, mesh.vertices))
        assert 0.5 < at.max() < 1.01
        shines = lamp_faces(scene)
        centre = shines.reshape(-1, 3).mean(axis=0)
        middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
        assert (centre - middle) @ np.subtract(scene.camera.position, middle) > 0
        normal = np.cross(shines[:, 1] - shines[:, 0], shines[:, 2] - shines[:, 0])
        assert (normal @ (middle - centre) > 0).all()
        (sky,) = scene.lights
        assert 0 < sky.radiance[0] < 0.1 * RADIANCE, "the sides that the lamp does not see are not black"


def test_lamp_hangs_below_the_shelf_over_the_mobile():
    """A placed mobile in a niche: a lamp under the ceiling would leave it in the dark."""
    room = box((0, 0, 0), (3, 3, 3), inward=True)
    shelf = box((0, 1, 0), (1, 1.1, 1))
    mobile = cube(0.3)
    mobile = mobile._replace(pose=mobile.pose._replace(position=(0.5, 0.0, 0.5)))
    scene, _, _ = complete(Scene(merge(room, shelf), (grey(0.7),), (mobile,)), [], True)
    assert 0.8 < lamp_faces(scene)[..., 1].max() < 1
    (note,) = (n for n in scene.notes if "no light" in n)
    assert note.endswith("hangs below the object over the mobile")


def test_the_lamp_does_not_stick_into_a_beam():
    room = box((0, 0, 0), (4, 4, 4), inward=True)
    beam = box((2.3, 3.5, 0), (2.6, 4, 4))
    mobile = cube(0.4)
    mobile = mobile._replace(pose=mobile.pose._replace(position=(2.0, 0.0, 2.0)))
    scene, _, _ = complete(Scene(merge(room, beam), (grey(0.7),), (mobile,)), [], True)
    assert lamp_faces(scene)[..., 0].max() < 2.3


def test_lamp_hangs_beside_a_slot_too_narrow_for_it():
    """A mobile under a gap of 0.1 between two beams: a lamp in there would be a slit."""
    room = box((0, 0, 0), (4, 3, 4), inward=True)
    beams = [box((1.5, 1.5, 0), (1.95, 3, 4)), box((2.05, 1.5, 0), (2.5, 3, 4))]
    mobile = cube(0.4)
    mobile = mobile._replace(pose=mobile.pose._replace(position=(2.0, 0.0, 2.0)))
    scene, rays, _ = complete(Scene(merge(room, *beams), (grey(0.7),), (mobile,)), [], True)
    shines = lamp_faces(scene)
    assert np.ptp(shines.reshape(-1, 3), axis=0).max() > 0.4
    assert shines[..., 0].max() < 1.5 or shines[..., 0].min() > 2.5
    to = np.array([2.0, 0.2, 2.0]) - shines.mean(axis=(0, 1))
    length = np.sqrt((to * to).sum())
    assert rays.hits((shines.mean(axis=(0, 1)) + 1e-3 * to)[None], (to / length)[None])[0][0] > 0.9 * length


def test_a_wide_mobile_does_not_stand_half_behind_a_post():
    """The middle of a place may be visible and both flanks hidden: the whole place counts."""
    room = box((0, 0, 0), (8, 3, 6), inward=True)
    post = box((2.4, 0, 2.8), (2.6, 3, 3.2))
    sofa = Mobile("sofa", box((-0.2, 0, -0.7), (0.2, 0.6, 0.7)))
    camera = Camera((0.2, 1.5, 3.3), (4.0, 0.8, 3.0), 60.0)
    scene, rays, _ = complete(Scene(merge(room, post), (grey(0.7),), (sofa,), camera=camera), [(0, np.array(Y))], True)
    to = corners(scene) - camera.position
    length = np.sqrt((to * to).sum(axis=1))
    t, _ = rays.hits(np.broadcast_to(camera.position, to.shape), to / length[:, None])
    assert (t > 0.99 * length).all() and np.abs(in_frame(camera, Y, corners(scene))).max() < 1


@pytest.mark.parametrize(("size", "scaled"), [(0.2, False), (0.9, True), (0.001, True)])
def test_scaled_mobile_adds_a_note(tmp_path, size, scaled):
    room = write_obj(tmp_path / "room.obj", BOX, BOX_FACES[:, ::-1])
    scene = load_scene(room, mobiles=[write_obj(tmp_path / "thing.obj", BOX * size)])
    notes = [n for n in scene.notes if n.startswith('mobile "thing" scaled by')]
    assert len(notes) == scaled
    assert 0.1 < np.ptp(corners(scene), axis=0).max() < 0.34


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_up_option_sets_the_vertical_axis(tmp_path, up):
    """The same room for any up axis: the mobile, from a y-up file, stands upright on its floor."""
    room = write_obj(tmp_path / "room.obj", BOX, BOX_FACES[:, ::-1])
    tall = write_obj(tmp_path / "tall.obj", BOX * [0.1, 0.2, 0.1])
    scene = load_scene(room, mobiles=[tall], up=up)
    axis = "xyz".index(up)
    assert np.ptp(corners(scene), axis=0)[axis] == pytest.approx(0.2)
    assert corners(scene)[:, axis].min() == pytest.approx(0, abs=1e-4)
    assert lamp_faces(scene)[..., axis].min() > 0.8


def test_pose_places_the_foot_of_a_mobile_file_and_the_origin_of_a_described_mesh(tmp_path):
    """As the help of --pose says; the cube's corner lies at the origin of its file."""
    (write_room(tmp_path) / "a.toml").write_text(
        '[static]\nmesh = "room.obj"\n[[mobile]]\nname = "m"\nmesh = "cube.obj"'
    )
    given = (0.6, 0.1, 0.5)
    foot = open_scene(Settings(f"{tmp_path}/room.obj", (f"{tmp_path}/cube.obj",), (("cube", given),)))
    origin = open_scene(Settings(f"{tmp_path}/a.toml", poses=(("m", given),)))
    assert corners(foot).min(axis=0) == pytest.approx([0.5, 0.1, 0.4])
    assert corners(origin).min(axis=0) == pytest.approx(given)
    assert "origin [m]: that of its mesh in a scene file, the middle of its foot of" in OPTIONS["poses"].option["help"]


def test_the_files_own_camera_is_kept(tmp_path):
    extra = {
        "nodes": [{"camera": 0, "translation": [0.5, 0.5, 4]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
    }
    scene = load_scene(write_glb(tmp_path / "a.glb", BOX, BOX_FACES, **extra))
    assert scene.camera.position == (0.5, 0.5, 4.0)


def test_opening_is_the_same_every_time():
    scenes = [completed(house(), cube(0.6)) for _ in range(2)]
    assert scenes[0].camera == scenes[1].camera and scenes[0].mobiles[0].pose == scenes[1].mobiles[0].pose
    again = replace(scenes[0])
    assert np.array_equal(lamp_faces(again), lamp_faces(scenes[1]))


@pytest.mark.parametrize(("emission", "lamps"), [(1e-3, 1), (5.0, 0)])
def test_the_glow_of_a_switch_is_no_light(emission, lamps):
    """A lamp is added unless emissive faces light the room: 1e-4 W/m2 on the average."""
    glow = quad((0.1, 1, 0.2), (0, 0, 0.2), (0.3, 0, 0), material=1)
    room = box((-2, 0, -2), (2, 2.5, 2))
    room = room._replace(faces=np.ascontiguousarray(room.faces[:, ::-1]))
    scene = completed(merge(room, glow), materials=(grey(0.7), lamp(emission)))
    assert sum(m.name == "default light" for m in scene.materials) == lamps


@pytest.mark.parametrize(("height", "lamps"), [(3, 0), (100, 1)])
def test_a_lamp_over_wide_ground_lights_what_it_reaches(height, lamps):
    """1.9 W over 4 km2: 8e-3 W/m2 below it from 3 m, 6e-6 in nine tenths of its light from 100 m."""
    ground = quad((-1000, 0, -1000), (0, 0, 2000), (2000, 0, 0))
    shade = quad((-0.5, height, -0.5), (1, 0, 0), (0, 0, 1), material=1)
    scene = completed(merge(ground, shade), materials=(grey(0.7), lamp(0.6)))
    assert sum(m.name == "default light" for m in scene.materials) == lamps
