"""Two-sided lamps shine into the scene, for any winding in their file."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.files.completion.sides import facing_the_scene
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import face_normals
from gi_core.scene import Scene
from tests.support.mesh_writers import BOX, BOX_FACES
from tests.support.scene_builders import box, grey, lamp, merge, quad, sphere

ROOM = box((0, 0, 0), (3, 3, 3), inward=True)
TWO_SIDED_LAMP = lamp(10.0)._replace(two_sided=True)


def lit(light, material=TWO_SIDED_LAMP) -> Scene:
    return facing_the_scene(Scene(merge(ROOM, light), (grey(0.5, two_sided=True), material)))[0]


def down(height: float):
    return quad((1, height, 1), (1, 0, 0), (0, 0, 1), material=1)


def up(height: float):
    return quad((1, height, 1), (0, 0, 1), (1, 0, 0), material=1)


def normals_of_lamp(scene: Scene) -> np.ndarray:
    return face_normals(scene.static)[0][scene.static.face_material == 1]


@pytest.mark.parametrize(("light", "turned"), [(down(2.99), 0), (up(2.99), 1)])
def test_a_lamp_at_the_ceiling_shines_down(light, turned):
    scene = lit(light)
    np.testing.assert_allclose(normals_of_lamp(scene), [[0, -1, 0]] * 2, atol=1e-12)
    assert scene.notes == ("lamps that faced a wall are turned round: lamp",)[:turned]


def test_lamp_with_two_open_sides_stays_with_a_note():
    scene = lit(up(1.5))
    np.testing.assert_allclose(normals_of_lamp(scene), [[0, 1, 0]] * 2, atol=1e-12)
    assert scene.notes == ("two-sided lamps shine from their front alone: lamp",)


def test_one_sided_lamp_follows_its_file():
    scene = lit(up(2.99), lamp(10.0))
    np.testing.assert_allclose(normals_of_lamp(scene), [[0, 1, 0]] * 2, atol=1e-12)
    assert scene.notes == ()


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_bulb_shines_outwards(inside_out):
    bulb = sphere((1.5, 2, 1.5), 0.1, 1, material=1)
    if inside_out:
        bulb = bulb._replace(faces=bulb.faces[:, ::-1].copy())
    scene = lit(bulb)
    faces = scene.static.faces[scene.static.face_material == 1]
    outwards = scene.static.vertices[faces].mean(axis=1) - (1.5, 2, 1.5)
    assert ((normals_of_lamp(scene) * outwards).sum(axis=1) > 0).all()


def test_each_lamp_is_oriented_separately():
    other = quad((0.2, 2.99, 0.2), (0, 0, 0.5), (0.5, 0, 0), material=1)
    scene = lit(merge(down(2.99), other))
    np.testing.assert_allclose(normals_of_lamp(scene), [[0, -1, 0]] * 4, atol=1e-12)


def test_obj_lamp_wound_upwards_lights_its_room(tmp_path):
    """An OBJ has no emitting side: light must reach the floor anyway."""
    lines = ["mtllib room.mtl", *(f"v {x} {y} {z}" for x, y, z in BOX), "v .4 .995 .4\nv .6 .995 .4\nv .6 .995 .6"]
    lines += ["usemtl wall", *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in BOX_FACES), "usemtl lamp", "f 11 10 9"]
    (tmp_path / "room.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "room.mtl").write_text("newmtl wall\nKd .5 .5 .5\nnewmtl lamp\nKd 0 0 0\nKe 10 10 10\n")
    scene = load_scene(tmp_path / "room.obj", max_edge=np.inf)
    shining = np.array([any(m.emission) for m in scene.materials])[scene.static.face_material]
    np.testing.assert_allclose(face_normals(scene.static)[0][shining], [[0, -1, 0]], atol=1e-12)


def test_corners_of_a_turned_lamp_keep_their_normals_and_colours(tmp_path):
    light = up(2.99)
    n = np.broadcast_to([0.0, 1.0, 0.0], (2, 3, 3))
    room_normals = np.repeat(face_normals(ROOM)[0][:, None], 3, axis=1)
    mesh = merge(ROOM, light)._replace(corner_normals=np.concatenate([room_normals, n]))
    scene, _ = facing_the_scene(Scene(mesh, (grey(0.5, two_sided=True), TWO_SIDED_LAMP)))
    rows = scene.static.face_material == 1
    np.testing.assert_allclose(scene.static.corner_normals[rows], -n)
    assert np.array_equal(scene.static.faces[rows], mesh.faces[rows][:, ::-1])
