"""Two-sided lamps shine into the scene, for any winding in their file.

Winding is made consistent if possible, else two-sided; a few wrong normals do not affect the others.
"""

import numpy as np
import pytest

from gi_core.files.completion.sides import facing_the_scene
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.formats.winding import consistent_winding
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import face_normals
from gi_core.scene import Scene
from tests.support.mesh_writers import BOX, BOX_FACES, QUAD, QUAD_FACES, write_glb
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


def signed_volume(mesh) -> float:
    """Return the volume inside a closed mesh, negative if its fronts look inwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum()) / 6


def test_larger_area_of_a_body_decides_its_winding():
    faces = BOX_FACES.copy()
    faces[[1, 4, 9]] = faces[[1, 4, 9]][:, ::-1]
    found = consistent_winding(faces, np.ones(12))
    assert np.flatnonzero(found.turned).tolist() == [1, 4, 9] and found.orientable.all()


def test_each_body_is_oriented_separately():
    two = np.concatenate([BOX_FACES, BOX_FACES + 8])
    two[3] = two[3][::-1]
    two[13:] = two[13:][:, ::-1]
    found = consistent_winding(two, np.ones(24))
    assert np.flatnonzero(found.turned).tolist() == [3, 12]
    assert len(found.orientable) == 2 and (found.body[:12] == found.body[0]).all() and found.body[0] != found.body[12]


def test_box_of_mixed_winding_is_whole_again(tmp_path):
    """No normals in the file, one-sided: three of twelve faces would be holes that swallow light."""
    faces = BOX_FACES.copy()
    faces[[0, 5, 7]] = faces[[0, 5, 7]][:, ::-1]
    read = read_mesh_file(write_glb(tmp_path / "a.glb", BOX, faces))
    assert abs(signed_volume(read.mesh)) == 1.0
    assert not any(m.two_sided for m in read.materials)
    assert "3 triangles were wound against their neighbours or normals: turned" in read.notes


def test_edge_of_three_faces_is_ignored():
    """A fin on a sheet: the sheet's two faces and the fin meet in one edge; each stays unchanged."""
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    found = consistent_winding(faces, np.ones(3))
    assert not found.turned.any() and len(found.orientable) == 3


def moebius(n: int = 12):
    """Return vertices and faces of a strip with half a twist."""
    a = np.arange(n) * 2 * np.pi / n
    rim = [
        np.stack([(2 + s * np.cos(a / 2)) * np.cos(a), (2 + s * np.cos(a / 2)) * np.sin(a), s * np.sin(a / 2)], 1)
        for s in (-0.5, 0.5)
    ]
    faces = []
    for i in range(n):
        j, (p, q) = (i + 1) % n, (n, 0) if i + 1 == n else (0, n)
        faces += [[i, j + p, j + q], [i, j + q, i + n]]
    return np.concatenate(rim), np.array(faces)


def test_a_body_without_two_sides_becomes_two_sided(tmp_path):
    vertices, faces = moebius()
    assert not consistent_winding(faces, np.ones(len(faces))).orientable.any()
    read = read_mesh_file(write_glb(tmp_path / "a.glb", vertices, faces))
    assert all(read.materials[i].two_sided for i in read.mesh.face_material)


def test_file_normals_decide_turned_faces(tmp_path):
    """One triangle of the sheet is wound against normals that all point up: it is turned, and keeps them."""
    faces = QUAD_FACES.copy()
    faces[1] = faces[1][::-1]
    up = np.array([[0.0, 0, 1]] * 5)
    vertices = np.concatenate([QUAD, [[2.0, 0.5, 0]]])
    faces = np.concatenate([faces, [[1, 4, 2]]])
    read = read_mesh_file(write_glb(tmp_path / "a.glb", vertices, faces, up))
    np.testing.assert_allclose(face_normals(read.mesh)[0], [[0, 0, 1]] * 3)
    np.testing.assert_allclose(read.mesh.corner_normals, np.broadcast_to([0, 0, 1.0], (3, 3, 3)))


def test_few_wrong_normals_do_not_affect_the_others(tmp_path):
    """A smooth ball with one inward normal in its file: its faces are flat, all others smooth."""
    ball = sphere((0, 0, 0), 1.0, 2)
    n = ball.vertices.copy()
    n[0] = -n[0]
    read = read_mesh_file(write_glb(tmp_path / "a.glb", ball.vertices, ball.faces, n))
    geometric, _ = face_normals(read.mesh)
    wrong = (ball.faces == 0).any(axis=1)
    np.testing.assert_allclose(read.mesh.corner_normals[wrong], np.repeat(geometric[wrong][:, None], 3, 1), atol=1e-6)
    right = read.mesh.corner_normals[~wrong]
    np.testing.assert_allclose(right, read.mesh.vertices[read.mesh.faces[~wrong]], atol=1e-6)
