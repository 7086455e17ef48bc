"""Mesh files: correct geometry, materials and normals from difficult files."""

import io
import json

import numpy as np
import pytest
from PIL import Image

from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import mean_colours
from gi_core.scene import SceneError
from tests.support.mesh_writers import BOX, BOX_FACES, QUAD, QUAD_FACES, gltf_lights, write_glb, write_obj

RELATIVE = """mtllib elsewhere/room.mtl
v 0 0 0
v\t1 0 0
v 1 1 0
v 0 1 0
usemtl red
f -4 -3 -2 -1
v 0 0 2
v 2 0 2
v 2 2 2
usemtl lamp
f -3 -2 -1   # counted back from here
v 9 9 9
f 1/1/1 \\
  2/2/2 7//3
vt 0 0
"""


def area(mesh) -> float:
    return float(face_normals(mesh)[1].sum())


def test_relative_indices_count_back_from_their_line(tmp_path):
    """Two triangles of a unit square, one of area 2, and one that names vertices 1, 2, 7."""
    text = RELATIVE.replace("f 1/1/1 \\\n  2/2/2 7//3\nvt 0 0\n", "f 1 \\\n 2 7\n")
    (tmp_path / "a.obj").write_text(text)
    (tmp_path / "room.mtl").write_text("newmtl red\nKd 0.6 0.1 0.1\nnewmtl lamp\nKd 1 1 1\nKe 17 12 4\n")
    read = read_mesh_file(tmp_path / "a.obj")
    last = np.sqrt((np.cross([1, 0, 0], [2.0, 2, 2]) ** 2).sum()) / 2
    assert area(read.mesh) == pytest.approx(1 + 2 + last)
    materials = {m.name: m for m in read.materials}
    assert materials["red"].reflectance == (0.6, 0.1, 0.1) and materials["red"].two_sided
    assert materials["lamp"].emission == (17, 12, 4) and materials["lamp"].reflectance == (0.98,) * 3
    assert "reflectance limited to 0.98: lamp" in read.notes


def test_materials_without_faces_are_left_out(tmp_path):
    """A million of them took 48 CPU seconds."""
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl b\nusemtl a\nf 1 2 3\nusemtl c\n")
    read = read_mesh_file(tmp_path / "a.obj")
    assert [m.name for m in read.materials] == ["a"] and read.notes == [
        "no definition of material a: taken as grey 0.7"
    ]


@pytest.mark.parametrize("line", ["f 1 2 9", "f -9 1 2", "f 0 1 2", "f a b c", "v 1 2"])
def test_bad_line_is_named(tmp_path, line):
    write_obj(tmp_path / "a.obj", before="")
    with open(tmp_path / "a.obj", "a") as f:
        f.write(line + "\n")
    with pytest.raises(SceneError, match=r"a.obj: line \d+ is not OBJ") as caught:
        read_mesh_file(tmp_path / "a.obj")
    assert str(caught.value).startswith(str(tmp_path / "a.obj"))


def test_obj_texture_replaces_kd(tmp_path):
    """Left half red, right half blue; v upwards: the lower triangle of the quad lies over the lower row."""
    pixels = np.array([[[0, 255, 0], [0, 255, 0]], [[255, 0, 0], [0, 0, 255]]], np.uint8)
    Image.fromarray(pixels).save(tmp_path / "t.png")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\n"
        "vt 0.249 0.249\nvt 0.251 0.249\nvt 0.25 0.252\nusemtl m\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 0 0 0\nmap_Kd t.png\n")
    np.testing.assert_allclose(mean_colours(read_mesh_file(tmp_path / "a.obj").mesh.paint), [[0.98, 0, 0]], atol=5e-3)


def test_gltf_material(tmp_path):
    material = {
        "name": "m",
        "doubleSided": True,
        "pbrMetallicRoughness": {"baseColorFactor": [0.123456789, 0.5, 1.0, 1.0]},
        "emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 100}},
    }
    read = read_mesh_file(write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, material=material))
    (m,) = read.materials
    assert m.reflectance == (0.123456789, 0.5, 0.98) and m.emission == (100, 50, 0) and m.two_sided
    plain = read_mesh_file(write_glb(tmp_path / "b.glb", QUAD, QUAD_FACES))
    assert plain.materials[0].two_sided is False


def test_gltf_texture_is_averaged_a_face(tmp_path):
    """A flat sRGB 188 decodes to 0.503; times the factor 0.5."""
    data = io.BytesIO()
    Image.fromarray(np.full((4, 4, 3), 188, np.uint8)).save(data, "png")
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 1, 1, 1]}}
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, uv=QUAD[:, :2], material=material, image=data.getvalue())
    np.testing.assert_allclose(mean_colours(read_mesh_file(file).mesh.paint), [[0.2515, 0.503, 0.503]] * 2, atol=1e-3)


def test_node_transform_moves_points_and_normals(tmp_path):
    """Scaled 2, 1, 1 along a slope: normals go with the inverse transpose; a mirror keeps them outside."""
    slope = np.array([[0.0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 1, 0]])
    n = np.array([[-(0.5**0.5), 0, 0.5**0.5]] * 4)
    for sx in (2, -2):
        file = write_glb(tmp_path / "a.glb", slope, QUAD_FACES, n, node={"scale": [sx, 1, 1], "translation": [5, 0, 0]})
        mesh = read_mesh_file(file).mesh
        geometric, _ = face_normals(mesh)
        np.testing.assert_allclose(geometric[0], np.array([-np.sign(sx), 0, 2]) / 5**0.5, atol=1e-6)
        np.testing.assert_allclose(mesh.corner_normals[0, 0], geometric[0], atol=1e-6)
        assert mesh.vertices[:, 0].min() == min(5, 5 + sx)


def test_normals_are_normalized_or_ignored(tmp_path):
    up = np.array([[0.0, 0, 6.28]] * 4)
    mesh = read_mesh_file(write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, up)).mesh
    np.testing.assert_allclose(mesh.corner_normals, np.broadcast_to([0, 0, 1.0], (2, 3, 3)))
    read = read_mesh_file(write_glb(tmp_path / "b.glb", QUAD, QUAD_FACES, -up))
    assert read.mesh.corner_normals is None
    assert "normals of 1 of 1 parts oppose their faces: taken from crease angles" in read.notes
    zero = np.array([[0.0, 0, 0]] * 4)
    assert read_mesh_file(write_glb(tmp_path / "c.glb", QUAD, QUAD_FACES, zero)).mesh.corner_normals is not None
    assert read_mesh_file(write_glb(tmp_path / "d.glb", QUAD, QUAD_FACES)).mesh.corner_normals is None


def test_zero_area_and_duplicate_faces_are_dropped_with_a_note(tmp_path):
    faces = np.concatenate([BOX_FACES, [[0, 0, 1], [0, 1, 1]], BOX_FACES[:3, [1, 2, 0]]])
    read = read_mesh_file(write_obj(tmp_path / "a.obj", BOX, faces))
    assert len(read.mesh.faces) == 12
    assert "left out 2 triangles of zero area and 3 duplicates of 17" in read.notes
    for more, note in ((faces[12:13], "1 triangle of zero area of 13"), (faces[14:16], "2 duplicates of 14")):
        notes = read_mesh_file(write_obj(tmp_path / "b.obj", BOX, np.concatenate([BOX_FACES, more]))).notes
        assert f"left out {note}" in notes


def test_sheets_back_to_back_become_two_sided(tmp_path):
    faces = np.concatenate([QUAD_FACES, QUAD_FACES[:, ::-1]])
    read = read_mesh_file(write_glb(tmp_path / "a.glb", QUAD, faces))
    assert len(read.mesh.faces) == 2
    assert all(read.materials[i].two_sided for i in read.mesh.face_material)


def test_external_buffer_and_strip(tmp_path):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], "<f4")
    (tmp_path / "my data.bin").write_bytes(positions.tobytes())
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 60}],
        "buffers": [{"byteLength": 60, "uri": "my%20data.bin"}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    mesh = read_mesh_file(tmp_path / "a.gltf").mesh
    assert area(mesh) == pytest.approx(1.5)
    assert (face_normals(mesh)[0][:, 2] > 0).all()
    (tmp_path / "my data.bin").unlink()
    with pytest.raises(SceneError, match="its buffer my%20data.bin: there is no such file"):
        read_mesh_file(tmp_path / "a.gltf")


@pytest.mark.parametrize("suffix", ["stl", "ply"])
def test_stl_and_ply(tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh")
    trimesh.Trimesh(BOX, BOX_FACES, process=False).export(tmp_path / f"a.{suffix}")
    read = read_mesh_file(tmp_path / f"a.{suffix}")
    assert area(read.mesh) == pytest.approx(6) and read.materials[0].two_sided and read.up == "z"
    assert read.mesh.corner_normals is None


BROKEN = {
    "no bytes.glb": (b"", "the file is empty, 0 bytes long"),
    "no bytes.ply": (b"", "the file is empty, 0 bytes long"),
    "text.glb": (b"glTFnonsense", "must hold glTF JSON, which this does not; export it again"),
    "text.gltf": (b"{\nhello", "must hold glTF JSON, which this does not in line 2; export it again"),
    "one.gltf": (b'{"asset": {"version": "1.0"}}', "glTF must be of version 2"),
    "nothing.gltf": (b'{"asset": {"version": "2.0"}}', "the mesh has no triangles"),
    "dangling.gltf": (b'{"asset": {"version": "2.0"}, "nodes": [{"mesh": 7}]}', "the glTF is damaged"),
    "nameless.obj": (
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 //1\n",
        "line 5 is not OBJ .a corner must name",
    ),
    "meshopt.gltf": (
        b'{"asset": {"version": "2.0"}, "extensionsRequired": ["EXT_meshopt_compression"]}',
        "compressed meshes are not read, got EXT_meshopt_compression; export it without compression",
    ),
    "noise.stl": (bytes(range(256)) * 3, "not a readable STL file"),
    "cut.ply": (b"ply\nformat ascii 1.0\nelement vertex 3\n", "not a readable PLY file"),
    "empty.stl": (b"x" * 80 + b"\0" * 4, "the mesh has no triangles"),
    "text.ply": (b"hello", "not a readable PLY file|the mesh has no triangles"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_unreadable_files_are_refused(tmp_path, name):
    content, sentence = BROKEN[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=sentence) as caught:
        read_mesh_file(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))


def test_a_folder_is_no_mesh(tmp_path):
    (tmp_path / "a.obj").mkdir()
    with pytest.raises(SceneError, match="a.obj: this is a folder"):
        read_mesh_file(tmp_path / "a.obj")


def test_truncated_glb(tmp_path):
    file = write_glb(tmp_path / "a.glb", BOX, BOX_FACES)
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(SceneError, match="the file ends early, 40 bytes are missing"):
        read_mesh_file(file)


def test_obj_comments_and_a_mark_at_the_front(tmp_path):
    """Comments end any line; Windows editors write a byte order mark and their own line ends."""
    lines = [
        "v 0 0 0 # first",
        "v 1 0 0",
        "v 0 1 0",
        "vt 0.5 # u alone",
        "vn 0 0 1 # up",
        "f 1/1/1 2/1/1 \\",
        "3/1/1 # all",
    ]
    (tmp_path / "a.obj").write_bytes(b"\xef\xbb\xbf" + "\r\n".join(lines).encode())
    assert len(read_mesh_file(tmp_path / "a.obj").mesh.faces) == 1


def test_a_lamp_on_a_node_of_no_size(tmp_path):
    lights = gltf_lights(({"type": "directional", "intensity": 3}, {"scale": [0, 0, 0]}))
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, **lights)
    assert load_scene(file, max_edge=1.0).lights[0].direction == (0.0, 0.0, -1.0)


def test_what_a_loaded_scene_breaks_is_named_by_its_file(tmp_path):
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, **gltf_lights(({"type": "point", "intensity": -3}, {})))
    with pytest.raises(SceneError, match='a.glb: .*light "light 1": flux must be three numbers >= 0'):
        load_scene(file)


def test_an_unknown_kind_of_gltf_light(tmp_path):
    """It became a spot."""
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, **gltf_lights(({"type": "area", "intensity": 3}, {})))
    with pytest.raises(SceneError, match="a.glb: .* a light must be point, spot or directional, got 'area'"):
        read_mesh_file(file)


@pytest.mark.parametrize("yfov", [0.0, -1.0, 4.0, float("inf")])
def test_a_gltf_camera_of_no_view(tmp_path, yfov):
    """An infinite angle ended in a traceback where photons are chosen."""
    camera = {"type": "perspective", "perspective": {"yfov": yfov}}
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, nodes=[{"camera": 0}], cameras=[camera])
    with pytest.raises(SceneError, match="a.glb: .* yfov of a camera must be > 0 and < pi, got"):
        read_mesh_file(file)


SHEET = {  # two faces of the unit square, each of its material, wound to its front
    "the same triangles": (QUAD_FACES, QUAD_FACES[:, ::-1]),
    "another diagonal": (QUAD_FACES, np.array([[3, 1, 0], [3, 2, 1]])),
    "a fan from the middle": (np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]), QUAD_FACES[:, ::-1]),
}


@pytest.mark.parametrize("suffix", ["obj", "obj with normals", "gltf"])
@pytest.mark.parametrize("kind", SHEET)
def test_sheets_of_two_materials_stay_a_pair(tmp_path, kind, suffix):
    """The first face that a ray meets from either side is the front of that side's material."""
    vertices, (fronts, backs) = np.vstack([QUAD, [[0.5, 0.5, 0]]]), SHEET[kind]
    path = write_sheet(tmp_path, suffix, vertices, fronts, backs)
    read = read_mesh_file(path)
    mesh, names = read.mesh, [read.materials[i].name for i in read.mesh.face_material]
    normals, areas = face_normals(mesh)
    assert not any(read.materials[i].two_sided for i in mesh.face_material)
    height = mesh.vertices[mesh.faces][:, :, 2] * normals[:, 2:]
    assert (height > 1e-6).all() and (height < 1e-4).all() and areas.sum() == pytest.approx(2)
    assert [n for n, z in zip(names, normals[:, 2], strict=True) if z > 0] == ["white"] * len(fronts)
    assert [n for n, z in zip(names, normals[:, 2], strict=True) if z < 0] == ["black"] * len(backs)
    assert any(f"{len(mesh.faces)} triangles back to back are apart by" in note for note in read.notes)


def write_sheet(folder, suffix, vertices, fronts, backs):
    if suffix == "gltf":
        document = {
            "asset": {"version": "2.0"},
            "nodes": [{"mesh": 0}],
            "materials": [
                {"name": n, "pbrMetallicRoughness": {"baseColorFactor": [0.5] * 4}} for n in ("white", "black")
            ],
            "meshes": [
                {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1 + k, "material": k} for k in (0, 1)]}
            ],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"}],
            "bufferViews": [{"buffer": 0, "byteLength": 12 * len(vertices)}],
        }
        data = np.asarray(vertices, "<f4").tobytes()
        for k, faces in enumerate((fronts, backs)):
            document["accessors"].append(
                {"bufferView": 1 + k, "componentType": 5125, "count": faces.size, "type": "SCALAR"}
            )
            document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": 4 * faces.size})
            data += np.asarray(faces, "<u4").tobytes()
        document["buffers"] = [{"byteLength": len(data), "uri": "a.bin"}]
        (folder / "a.bin").write_bytes(data)
        (folder / "a.gltf").write_text(json.dumps(document))
        return folder / "a.gltf"
    (folder / "a.mtl").write_text("newmtl white\nKd 0.9 0.9 0.9\nnewmtl black\nKd 0.02 0.02 0.02\n")
    lines = ["mtllib a.mtl", *("v " + " ".join(map(str, v)) for v in vertices), "vn 0 0 1", "vn 0 0 -1"]
    for name, faces, normal in (("white", fronts, 1), ("black", backs, 2)):
        end = f"//{normal}" if "normals" in suffix else ""
        lines += [f"usemtl {name}", *("f " + " ".join(f"{i + 1}{end}" for i in face) for face in faces)]
    (folder / "a.obj").write_text("\n".join(lines) + "\n")
    return folder / "a.obj"


def test_copies_of_another_material_still_drop(tmp_path):
    """Wound the same way, with and without normals: one face, the first."""
    for suffix in ("obj", "gltf"):
        read = read_mesh_file(write_sheet(tmp_path, suffix, QUAD, QUAD_FACES, QUAD_FACES[:, [1, 2, 0]]))
        assert [read.materials[i].name for i in read.mesh.face_material] == ["white"] * 2
        assert read.notes == ["left out 2 duplicates of 4"]


def test_sheets_of_two_colours_stay_a_pair(tmp_path):
    """Colours at vertices, and places in one texture."""
    square = [*(" ".join(map(str, v)) for v in np.vstack([QUAD, QUAD]))]
    rows = [f"{v} {c} {c} {c}" for v, c in zip(square, [200] * 4 + [20] * 4, strict=True)]
    kinds = "".join(f"\nproperty float {k}" for k in "xyz") + "".join(
        f"\nproperty uchar {k}" for k in ("red", "green", "blue")
    )
    faces = ["3 0 1 2", "3 0 2 3", "3 6 5 4", "3 7 6 4"]
    head = f"ply\nformat ascii 1.0\nelement vertex 8{kinds}\nelement face 4\n"
    head += "property list uchar int vertex_indices\nend_header"
    (tmp_path / "a.ply").write_text("\n".join([head, *rows, *faces, ""]))
    mesh = read_mesh_file(tmp_path / "a.ply").mesh
    front = face_normals(mesh)[0][:, 2] > 0
    bright = mesh.paint.corner_colour.mean(axis=(1, 2)) > 0.3
    assert len(mesh.faces) == 4 and (front == bright).all() and front.sum() == 2
