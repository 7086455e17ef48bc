"""What exporters write: extensions and old materials of glTF, morph targets, copies; odd OBJ; polygons of any shape."""

import base64
import io
import json
import struct
import warnings

import numpy as np
import pytest
from PIL import Image

from gi_core.files.formats.gltf_buffers import COMPRESSED, LEFT_OUT, READ
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import face_normals
from gi_core.scene.errors import SceneError
from tests.support.mesh_writers import QUAD, QUAD_FACES, write_glb

UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])


def png(pixels: np.ndarray, mode: str | None = None) -> bytes:
    data = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8), mode).save(data, "png")
    return data.getvalue()


def quad(folder, material=None, **more):
    return read_mesh_file(write_glb(folder / "a.glb", QUAD, QUAD_FACES, uv=UV, material=material, **more))


def changed(path, change) -> None:
    """Change the JSON of a GLB."""
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    path.write_bytes(head + text + rest)


def area(read) -> float:
    return float(face_normals(read.mesh)[1].sum())


# glTF -----------------------------------------------------------------------------------------------


def test_required_extensions_are_read_or_refused(tmp_path):
    required = ["VENDOR_mesh_deltas", "KHR_materials_ior"]
    with pytest.raises(
        SceneError, match="requires the extension 'VENDOR_mesh_deltas', not read here; export it without"
    ):
        quad(tmp_path, extensionsUsed=required, extensionsRequired=required)
    known = sorted(READ | LEFT_OUT.keys())
    assert quad(tmp_path, extensionsUsed=known, extensionsRequired=known).notes[0].startswith("left out: ")
    assert not COMPRESSED & (READ | LEFT_OUT.keys())


def test_extensions_that_are_left_out_are_noted(tmp_path):
    names = ["KHR_materials_clearcoat", "KHR_lights_punctual", "KHR_xmp_json_ld", "VENDOR_thing"]
    assert quad(tmp_path, extensionsUsed=names).notes == ["left out: clear coats, VENDOR_thing"]


def test_later_versions_are_refused(tmp_path):
    path = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES)
    changed(path, lambda document: document["asset"].update(minVersion="2.1"))
    with pytest.raises(SceneError, match="glTF must be of version 2.0, got minVersion '2.1'"):
        read_mesh_file(path)


def old(**values):
    return {"name": "old", "extensions": {"KHR_materials_pbrSpecularGlossiness": values}}


def test_specular_glossiness_is_read(tmp_path):
    (matte,) = quad(
        tmp_path, old(diffuseFactor=[0.1, 0.05, 0.02, 1], specularFactor=[0.04] * 3, glossinessFactor=0)
    ).materials
    assert matte.reflectance == (0.1, 0.05, 0.02) and matte.gloss is None
    (shiny,) = quad(
        tmp_path, old(diffuseFactor=[0.5, 0.5, 0.5, 1], specularFactor=[0.1] * 3, glossinessFactor=0.8)
    ).materials
    assert shiny.gloss.f0 == pytest.approx((0.1,) * 3) and shiny.gloss.alpha == pytest.approx(0.04)
    (metal,) = quad(
        tmp_path, old(diffuseFactor=[0, 0, 0, 1], specularFactor=[0.9, 0.6, 0.3], glossinessFactor=0.2)
    ).materials
    assert metal.gloss.f0 == pytest.approx((0.9, 0.6, 0.3)) and metal.gloss.alpha == pytest.approx(0.64)


def test_textures_of_specular_glossiness(tmp_path):
    """Its picture colours the faces; colour and glossiness of the other one are means."""
    image = png(np.full((2, 2, 4), (255, 255, 255, 204)))
    material = old(diffuseTexture={"index": 0}, specularGlossinessTexture={"index": 0}, specularFactor=[0.1] * 3)
    read = quad(tmp_path, material, image=image)
    assert read.mesh.paint is not None and (read.mesh.paint.face_texture == 0).all()
    assert read.materials[0].gloss.alpha == pytest.approx(0.04)
    assert read.notes == ['material "old": its gloss is the mean of its specular-glossiness texture']


def test_invisible_nodes_are_left_out(tmp_path):
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    path = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, nodes=[{"mesh": 0, "children": [2], **hidden}, {"mesh": 0}])
    changed(path, lambda document: document["scenes"][0].update(nodes=[0, 1]))
    read = read_mesh_file(path)
    assert area(read) == pytest.approx(1)
    assert read.notes == ["left out 1 nodes that are invisible in the file, with all that hangs on them"]


def placed(node: dict) -> np.ndarray:
    """Return the matrix (4, 4) of a node, written by the specification alone."""
    if "matrix" in node:
        return np.reshape(node["matrix"], (4, 4)).T
    x, y, z, w = node["rotation"]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out = np.eye(4)
    out[:3, :3] = (np.eye(3) + 2 * w * cross + 2 * cross @ cross) * node["scale"]
    out[:3, 3] = node["translation"]
    return out


@pytest.mark.parametrize("seed", range(20))
def test_random_scenes_have_the_triangles_of_a_reader_of_the_tests(tmp_path, seed):
    """Trees of nodes with morph weights, copies (EXT_mesh_gpu_instancing) and hidden branches (KHR_node_visibility)."""
    random, arrays = np.random.default_rng(seed), [np.eye(3), np.random.default_rng(seed).normal(size=(3, 3))]
    nodes: list[dict] = []

    def motions(count):
        turns = random.normal(size=(count, 4))
        turns /= np.linalg.norm(turns, axis=1)[:, None]
        return {"translation": random.normal(size=(count, 3)) * 5, "rotation": turns,
                "scale": random.choice([-1, 1], (count, 3)) * random.uniform(0.5, 2, (count, 3))}  # fmt: skip

    def node(depth):
        number, one = len(nodes), {key: rows[0].tolist() for key, rows in motions(1).items()}
        nodes.append(one if random.random() < 0.5 else {"matrix": placed(one).T.ravel().tolist()})
        made, copies = nodes[number], motions(random.integers(1, 4)) if random.random() < 0.3 else {}
        made |= {"mesh": 0, "extensions": {}}
        if random.random() < 0.4:
            made["weights"] = [float(random.normal())]
        if copies:
            first = len(arrays)
            arrays.extend(copies.values())
            names = {key.upper(): first + k for k, key in enumerate(copies)}
            made["extensions"]["EXT_mesh_gpu_instancing"] = {"attributes": names}
        if (is_hidden := depth > 0 and random.random() < 0.15) or random.random() < 0.2:
            made["extensions"]["KHR_node_visibility"] = {"visible": not is_hidden}
        below = [node(depth + 1) for _ in range(random.integers(0, 3) if depth < 3 else 0)]
        made |= {"children": [k for k, _ in below]} if below else {}
        weight = made.get("weights", [0.5])[0]
        corners = np.c_[(arrays[0] + weight * arrays[1]).astype(np.float32), np.ones(3)]
        each = [placed({key: rows[k] for key, rows in copies.items()}) for k in range(len(copies.get("scale", ())))]
        shown = [corners @ copy.T for copy in each or [np.eye(4)]] + [c for _, more in below for c in more]
        return number, [] if is_hidden else [c @ placed(made).T for c in shown]

    roots = [node(0) for _ in range(2)]
    expected = np.array([c[:, :3] for _, more in roots for c in more]).reshape(-1, 9)
    data, views, accessors = b"", [], []
    for k, rows in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": rows.astype(np.float32).nbytes})
        accessors.append({"bufferView": k, "componentType": 5126, "count": len(rows), "type": f"VEC{rows.shape[1]}"})
        data += rows.astype(np.float32).tobytes()
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 0}, "targets": [{"POSITION": 1}]}
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [k for k, _ in roots]}], "nodes": nodes,
        "meshes": [{"primitives": [primitive], "weights": [0.5]}], "bufferViews": views, "accessors": accessors,
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
    }  # fmt: skip
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    read, middles = read_mesh_file(tmp_path / "a.gltf").mesh, expected.reshape(-1, 3, 3).mean(axis=1)
    apart = np.linalg.norm(middles[:, None] - read.vertices[read.faces].mean(axis=1), axis=2)
    assert apart.shape[0] == apart.shape[1] and max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-3


def test_metal_that_varies_is_not_refused_by_rounding(tmp_path):
    """Shares of area sum to 1 + 7e-16 for some numbers of triangles."""
    n = 12
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1, 1)
    faces = np.concatenate([corner + [0, 1, n + 1], corner + [0, n + 1, n]])
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) ** [1.3, 1.1, 1]
    pbr = {"metallicRoughnessTexture": {"index": 0}, "metallicFactor": 1.0, "roughnessFactor": 1.0}
    noise = np.random.default_rng(1).integers(100, 156, (32, 32, 1))
    image = png(np.concatenate([noise, noise, np.full((32, 32, 1), 255)], axis=2))
    path = tmp_path / "plate.glb"
    write_glb(path, vertices, faces, uv=vertices[:, :2], material={"pbrMetallicRoughness": pbr}, image=image)
    for m in load_scene(path).materials:
        assert m.gloss is None or m.gloss.f90 <= 1


def test_pictures_with_a_transparent_palette_say_nothing(tmp_path):
    image = Image.fromarray(np.array([[0, 1], [1, 0]], np.uint8), "P")
    image.putpalette([255, 0, 0, 0, 0, 255])
    data = io.BytesIO()
    image.save(data, "png", transparency=b"\x00\xff")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = quad(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, image=data.getvalue())
    assert read.mesh.paint.textures[0].pixels.tolist() == [[[255, 0, 0], [0, 0, 255]], [[0, 0, 255], [255, 0, 0]]]


# Emission -------------------------------------------------------------------------------------------

ATLAS = np.zeros((8, 8, 3), np.uint8)
ATLAS[:4, :4] = 255  # u, v below one half


def test_faces_emit_their_part_of_a_texture(tmp_path):
    black = {"baseColorFactor": [0, 0, 0, 1]}
    material = {"name": "panel", "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}
    material["pbrMetallicRoughness"] = black
    vertices, faces = np.vstack([QUAD, QUAD + [2, 0, 0]]), np.vstack([QUAD_FACES, QUAD_FACES + 4])
    uv = np.vstack([0.25 * UV + 0.1, 0.25 * UV + 0.6])
    path = write_glb(tmp_path / "a.glb", vertices, faces, uv=uv, material=material, image=png(ATLAS))
    read = read_mesh_file(path)
    emitted = [read.materials[k].emission for k in read.mesh.face_material]
    assert emitted == [pytest.approx((1, 1, 1))] * 2 + [(0, 0, 0)] * 2 and {m.name for m in read.materials} == {"panel"}
    assert read.notes == ['material "panel": each triangle emits the mean of its emissive texture']


def test_faces_without_coordinates_emit_the_mean(tmp_path):
    material = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}
    read = read_mesh_file(write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, material=material, image=png(ATLAS)))
    assert [m.emission for m in read.materials] == [pytest.approx((0.25,) * 3)]


def test_obj_faces_emit_their_part_of_a_texture(tmp_path):
    (tmp_path / "glow.png").write_bytes(png(ATLAS))
    lines = ["newmtl lamp", "Ke 8 8 8", "map_Ke glow.png"]
    square = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0"]
    for corner, expected in (((0.1, 0.9), 8.0), ((0.6, 0.4), 0.0)):  # v runs upwards
        vt = [f"vt {corner[0] + 0.2 * x} {corner[1] - 0.2 * y}" for x, y in ((0, 1), (1, 1), (1, 0), (0, 0))]
        read = obj(tmp_path, [*square, *vt, "usemtl lamp", "f 1/1 2/2 3/3 4/4"], lines)
        assert [m.emission for m in read.materials] == [pytest.approx((expected,) * 3, abs=1e-6)]


# OBJ ------------------------------------------------------------------------------------------------

SQUARE = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0"]


def obj(folder, lines, library=(), name="a.mtl", mention="mtllib a.mtl", encoding="utf-8"):
    (folder / name).write_text("\n".join(library))
    (folder / "a.obj").write_bytes("\n".join([mention, *lines, ""]).encode(encoding))
    return read_mesh_file(folder / "a.obj")


def test_a_line_may_name_several_libraries(tmp_path):
    (tmp_path / "b.mtl").write_text("newmtl blue\nKd 0.1 0.1 0.8\n")
    lines = [*SQUARE, "usemtl red", "f 1 2 3", "usemtl blue", "f 1 3 4"]
    read = obj(tmp_path, lines, ["newmtl red", "Kd 0.8 0.1 0.1"], mention="mtllib a.mtl b.mtl")
    assert [m.reflectance for m in read.materials] == [(0.8, 0.1, 0.1), (0.1, 0.1, 0.8)] and read.notes == []
    read = obj(tmp_path, lines[:6], ["newmtl red", "Kd 0.8 0.1 0.1"], "old oak.mtl", "mtllib old oak.mtl")
    assert read.materials[0].reflectance == (0.8, 0.1, 0.1)


def test_names_and_words_in_other_cases_and_slashes(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "Wood.PNG").write_bytes(png(np.full((2, 2, 3), 99)))
    library = ["NEWMTL red", "kd 0.8 0.1 0.1", "Map_Kd maps\\wood.png"]
    lines = [*SQUARE, "vt 0 0", "usemtl red", "f 1/1 2/1 3/1"]
    read = obj(tmp_path, lines, library, "A.MTL", "mtllib .\\a.mtl")
    assert read.mesh.paint.textures[0].pixels.max() == 99 and read.notes == []


def test_coordinates_and_normals_that_are_missing_are_left_out(tmp_path):
    read = obj(tmp_path, [*SQUARE, "vn 0 0 1", "f 1/1/1 2/2/1 3/3/1 4/4/1"])
    assert len(read.mesh.faces) == 2 and read.mesh.corner_normals is not None
    assert "texture coordinates that corners name but the file does not hold are left out" in read.notes
    read = obj(tmp_path, [*SQUARE, "f 1//1 2//2 3//3"])
    assert read.mesh.corner_normals is None
    assert "normals that corners name but the file does not hold are left out" in read.notes
    with pytest.raises(SceneError, match=r"line 6 is not OBJ \(index 5 of 4\)"):
        obj(tmp_path, [*SQUARE, "f 1 2 5"])


def test_utf_16(tmp_path):
    assert area(obj(tmp_path, [*SQUARE, "f 1 2 3 4"], encoding="utf-16")) == pytest.approx(1)


def test_colours_of_vertices(tmp_path):
    """sRGB after the place; they scale Kd where there is one."""
    lines = [f"{v} 1 0.5 0" for v in SQUARE]
    grey = ((0.5 + 0.055) / 1.055) ** 2.4
    read = obj(tmp_path, [*lines, "f 1 2 3 4"])
    assert read.mesh.paint.corner_colour == pytest.approx(np.broadcast_to([0.98, grey, 0], (2, 3, 3)))
    read = obj(tmp_path, [*lines, "usemtl half", "f 1 2 3 4"], ["newmtl half", "Kd 0.5 0.5 0.5"])
    assert read.mesh.paint.corner_colour == pytest.approx(np.broadcast_to([0.5, grey / 2, 0], (2, 3, 3)))


# Polygons -------------------------------------------------------------------------------------------

L_SHAPE = np.array([[2.0, 0], [2, 1], [1, 1], [1, 2], [0, 2], [0, 0]])
ARROW = np.array([[0.0, 0], [2, -1], [0.5, 0], [2, 1]])  # a quad, from a corner whose fan is right
PLANES = {"floor": np.array([[1.0, 0, 0], [0, 0, -1]]), "wall": np.array([[0.0, 1, 0], [0, 0, 1]])}


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("start", range(6))
@pytest.mark.parametrize("turned", [1, -1])
@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_concave_polygons_keep_their_outline(tmp_path, plane, start, turned, suffix):
    outline = np.roll(L_SHAPE, start, axis=0)[::turned] @ PLANES[plane]
    if suffix == "obj":
        read = obj(tmp_path, [*(f"v {x} {y} {z}" for x, y, z in outline), "f 1 2 3 4 5 6"])
    else:
        read = read_mesh_file(write_ply(tmp_path, outline, [range(6)], "ascii"))
    normals, areas = face_normals(read.mesh)
    assert areas.sum() == pytest.approx(3) and len(areas) == 4
    assert normals == pytest.approx(np.tile(turned * np.cross(*PLANES[plane]), (4, 1)))
    middles = read.mesh.vertices[read.mesh.faces].mean(axis=1) @ PLANES[plane].T
    assert not (middles > 1).all(axis=1).any()  # the notch


@pytest.mark.parametrize("start", range(4))
def test_concave_quads(tmp_path, start):
    outline = np.roll(ARROW, start, axis=0)
    read = obj(tmp_path, [*(f"v {x} {y} 0" for x, y in outline), "f 1 2 3 4"])
    assert area(read) == pytest.approx(0.5) and (face_normals(read.mesh)[0][:, 2] > 0).all()


def write_ply(folder, vertices, polygons, kind, name="face"):
    """Write a PLY of polygons."""
    lines = [f"format {kind} 1.0", f"element vertex {len(vertices)}", *(f"property float {k}" for k in "xyz")]
    lines += [f"element {name} {len(polygons)}", "property list uchar int vertex_indices", "end_header"]
    body = "\n".join(["ply", *lines, ""]).encode()
    rows = [*map(list, vertices), *([len(p), *p] for p in polygons)]
    if kind == "ascii":
        body += "\n".join(" ".join(map(str, row)) for row in rows).encode() + b"\n"
    else:
        order = "<" if "little" in kind else ">"
        body += b"".join(struct.pack(f"{order}3f", *v) for v in vertices)
        body += b"".join(struct.pack(f"{order}B{len(p)}i", len(p), *p) for p in polygons)
    (folder / "a.ply").write_bytes(body)
    return folder / "a.ply"


PYRAMID = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 1]])
SIDES = [(3, 2, 1, 0), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_of_polygons_that_differ(tmp_path, kind):
    read = read_mesh_file(write_ply(tmp_path, PYRAMID, SIDES, kind))
    assert len(read.mesh.faces) == 6 and area(read) == pytest.approx(4 + 4 * np.sqrt(2)) and read.notes == []
    cut = (tmp_path / "a.ply").read_bytes()[:-2]
    (tmp_path / "a.ply").write_bytes(cut)
    if kind != "ascii":
        with pytest.raises(SceneError, match="not a readable PLY file: it ends early; export it again"):
            read_mesh_file(tmp_path / "a.ply")


def test_ply_of_strips_is_refused(tmp_path):
    with pytest.raises(SceneError, match="not a readable PLY file: it holds triangle strips; export it again, as tri"):
        read_mesh_file(write_ply(tmp_path, PYRAMID, [[0, 1, 3, 2]], "ascii", "tristrips"))
