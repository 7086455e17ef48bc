"""Files in the manner of other programs: fans, skins, nested nodes with lights, several of each."""

import json

import numpy as np
import pytest

from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import face_normals
from gi_core.scene import DirectionalLight, PointLight, SceneError, SpotLight
from tests.support.mesh_writers import BOX, BOX_FACES, QUAD, QUAD_FACES, gltf_lights, write_glb, write_obj


def area(mesh) -> float:
    return float(face_normals(mesh)[1].sum())


def write_gltf(path, views: list[bytes], accessors: list[tuple], **document):
    """Write a .gltf and its buffer file; accessors are (view, component type, count, kind)."""
    offsets = np.cumsum([0, *(len(v) for v in views)])
    path.with_suffix(".bin").write_bytes(b"".join(views))
    document |= {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": int(offsets[-1]), "uri": path.with_suffix(".bin").name}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(o), "byteLength": len(v)} for o, v in zip(offsets, views, strict=False)
        ],
        "accessors": [{"bufferView": v, "componentType": c, "count": n, "type": kind} for v, c, n, kind in accessors],
    }
    path.write_text(json.dumps(document))
    return path


def test_triangle_fan(tmp_path):
    """A hexagon as a fan about its centre, closed: area 3 sqrt(3) / 2, all fronts up."""
    a = np.arange(7) * np.pi / 3
    points = np.concatenate([[[0, 0, 0]], np.stack([np.cos(a), np.sin(a), 0 * a], 1)]).astype("<f4")
    file = write_gltf(
        tmp_path / "fan.gltf",
        [points.tobytes()],
        [(0, 5126, 8, "VEC3")],
        nodes=[{"mesh": 0}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 6}]}],
    )
    mesh = read_mesh_file(file).mesh
    assert area(mesh) == pytest.approx(1.5 * 3**0.5, rel=1e-6)
    assert (face_normals(mesh)[0][:, 2] > 0).all()


def test_skinned_mesh_is_loaded_in_its_rest_pose(tmp_path):
    """Two joints, the second moved up by 2 in the file: its vertices move up; the node's own transform is ignored."""
    identity = np.eye(4, dtype="<f4")
    joints = np.array([[0, 0, 0, 0]] * 4 + [[1, 0, 0, 0]] * 4, "<u1")
    weights = np.array([[1, 0, 0, 0]] * 8, "<f4")
    order = np.argsort(BOX[:, 1], kind="stable")  # the lower four first
    back = np.argsort(order)
    file = write_gltf(
        tmp_path / "skin.gltf",
        [
            BOX[order].astype("<f4").tobytes(),
            back[BOX_FACES].astype("<u4").tobytes(),
            joints.tobytes(),
            weights.tobytes(),
            np.concatenate([identity, identity]).tobytes(),
        ],
        [
            (0, 5126, 8, "VEC3"),
            (1, 5125, 36, "SCALAR"),
            (2, 5121, 8, "VEC4"),
            (3, 5126, 8, "VEC4"),
            (4, 5126, 2, "MAT4"),
        ],
        scenes=[{"nodes": [0, 1]}],
        nodes=[{"mesh": 0, "skin": 0, "translation": [50, 0, 0]}, {"children": [2]}, {"translation": [0, 2, 0]}],
        skins=[{"joints": [1, 2], "inverseBindMatrices": 4}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}],
    )
    v = read_mesh_file(file).mesh.vertices
    assert v.min(axis=0).tolist() == [0, 0, 0] and v.max(axis=0).tolist() == [1, 3, 1]


def test_lights_below_nested_nodes(tmp_path):
    """A node turned by 90 degrees about y holds one turned by -90 about x: the light looks down, and stands aside."""
    s = 0.5**0.5
    extra = {
        "extensions": {
            "KHR_lights_punctual": {
                "lights": [
                    {"type": "directional", "intensity": 3, "color": [1, 0.5, 0]},
                    {"type": "spot", "intensity": 10, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.3}},
                    {"type": "point", "intensity": 5},
                ]
            }
        },
        "nodes": [
            {"rotation": [0, s, 0, s], "translation": [1, 0, 0], "scale": [2, 2, 2], "children": [2, 3, 4]},
            {"rotation": [-s, 0, 0, s], "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"translation": [0, 0, 1], "extensions": {"KHR_lights_punctual": {"light": 1}}},
            {"translation": [0, 1, 0], "extensions": {"KHR_lights_punctual": {"light": 2}}},
        ],
        "scenes": [{"nodes": [0, 1]}],
    }
    sun, spot, point = read_mesh_file(write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, **extra)).lights
    assert isinstance(sun, DirectionalLight) and sun.irradiance == (3, 1.5, 0)
    np.testing.assert_allclose(sun.direction, [0, -1, 0], atol=1e-12)
    assert isinstance(spot, SpotLight) and spot.intensity == (10, 10, 10)
    np.testing.assert_allclose(spot.direction, [-1, 0, 0], atol=1e-12)  # -z turned about y
    np.testing.assert_allclose(spot.position, [3, 0, 0], atol=1e-12)  # 1 + 2 along x
    np.testing.assert_allclose([spot.inner_degrees, spot.outer_degrees], np.degrees([0.2, 0.3]))
    assert isinstance(point, PointLight)
    np.testing.assert_allclose(point.position, [1, 2, 0], atol=1e-12)


def test_a_spot_of_no_width_does_no_harm(tmp_path):
    lights = gltf_lights(({"type": "spot", "spot": {"outerConeAngle": 0}}, {"translation": [0.5, 0.5, 1]}))
    (spot,) = read_mesh_file(write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, **lights)).lights
    assert 0 <= spot.inner_degrees <= spot.outer_degrees and spot.outer_degrees > 0


def test_a_file_of_lights_alone_needs_a_surface(tmp_path):
    file = tmp_path / "lights.gltf"
    file.write_text(json.dumps({"asset": {"version": "2.0"}} | gltf_lights(({"type": "point"}, {}))))
    with pytest.raises(SceneError, match="the mesh has no triangles; a scene needs at least one"):
        load_scene(file)


def test_points_and_lines_are_left_out_with_a_line(tmp_path):
    points = QUAD.astype("<f4")
    file = write_gltf(
        tmp_path / "lines.gltf",
        [points.tobytes(), QUAD_FACES.astype("<u4").tobytes()],
        [(0, 5126, 4, "VEC3"), (1, 5125, 6, "SCALAR")],
        nodes=[{"mesh": 0}],
        meshes=[
            {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}, {"attributes": {"POSITION": 0}, "mode": 1}]}
        ],
    )
    read = read_mesh_file(file)
    assert area(read.mesh) == 1 and "mesh 0 primitive 1 holds points or lines: left out" in read.notes


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_units_do_not_matter(tmp_path, scale):
    """A room in millimetres, metres or kilometres opens the same: camera, mobile and lamp scale with it."""
    room = write_obj(tmp_path / "room.obj", BOX * 3 * scale, BOX_FACES[:, ::-1])
    scene = load_scene(room, mobiles=[write_obj(tmp_path / "cube.obj", BOX * 0.5 * scale)], max_edge=np.inf)
    one = load_scene(
        write_obj(tmp_path / "one.obj", BOX * 3, BOX_FACES[:, ::-1]),
        mobiles=[write_obj(tmp_path / "cube 1.obj", BOX * 0.5)],
        max_edge=np.inf,
    )
    np.testing.assert_allclose(np.array(scene.camera.position) / scale, one.camera.position, atol=1e-2)
    np.testing.assert_allclose(
        np.array(scene.mobiles[0].pose.position) / scale, one.mobiles[0].pose.position, atol=1e-2
    )
    assert not any("scaled" in n for n in scene.notes)


def test_slabs_larger_than_the_room_do_not_blur_it(tmp_path, monkeypatch):
    """A ground of 60 m under a lit room of 3 m: edges, camera and mobile are the room's."""
    ground = np.array([[-30.0, -0.01, -30], [30, -0.01, -30], [30, -0.01, 30], [-30, -0.01, 30]])
    lamp = np.array([[1.0, 2.95, 1], [2, 2.95, 1], [2, 2.95, 2], [1, 2.95, 2]])
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in np.concatenate([BOX * 3, ground, lamp]))]
    lines += ["usemtl wall", *(f"f {c + 1} {b + 1} {a + 1}" for a, b, c in BOX_FACES), "f 9 10 11 12"]
    lines += ["usemtl lamp", "f 13 14 15 16"]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "a.mtl").write_text("newmtl wall\nKd .5 .5 .5\nnewmtl lamp\nKd 0 0 0\nKe 5 5 5\n")
    monkeypatch.setattr("gi_core.files.load.MOST_RECEIVERS", 20_000)
    scene = load_scene(tmp_path / "a.obj", mobiles=[write_obj(tmp_path / "cube.obj", BOX * 0.4)])
    p = scene.static.vertices[scene.static.faces]
    longest = np.sqrt(((p - np.roll(p, 1, axis=1)) ** 2).sum(axis=2)).max(axis=1)
    inside = (np.abs(p.mean(axis=1)[:, [0, 2]] - 1.5) < 1.4).all(axis=1) & (p[..., 1].mean(axis=1) >= 0)
    assert longest[inside].max() < 0.35 and len(scene.static.faces) < 24_000
    assert all(0 < x < 3 for x in np.array(scene.mobiles[0].pose.position)[[0, 2]])
    assert np.ptp(scene.mobiles[0].mesh.vertices, axis=0).max() == pytest.approx(0.4, rel=1e-6)
