"""Small mesh and scene files written by the tests themselves."""

import json
import struct
from pathlib import Path

import numpy as np
from PIL import Image

QUAD = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
QUAD_FACES = np.array([[0, 1, 2], [0, 2, 3]])
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip

ROOM = """mtllib room.mtl
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v -0.3 2 -0.3
v 0.3 2 -0.3
v 0.3 2 0.3
v -0.3 2 0.3
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl floor
f 4/4 3/3 2/2 1/1
usemtl lamp
f 5 6 7 8
"""
LIBRARY = "newmtl floor\nKd 0.5 0.5 0.5\nmap_Kd wood.png\nnewmtl lamp\nKe 9 9 9\n"


def write_textured_room(folder: Path) -> None:
    """Write room.obj, room.mtl and wood.png: a floor with a texture under a lamp."""
    (folder / "room.obj").write_text(ROOM)
    (folder / "room.mtl").write_text(LIBRARY)
    Image.fromarray(np.full((4, 4, 3), 180, np.uint8)).save(folder / "wood.png")


def gltf_lights(*lights: tuple[dict, dict], nodes=()) -> dict:
    """Return the JSON of lights, each with the keys of its node, and of further nodes."""
    key = "KHR_lights_punctual"
    held = [node | {"extensions": {key: {"light": k}}} for k, (_, node) in enumerate(lights)]
    return {"nodes": [*held, *nodes], "extensions": {key: {"lights": [light for light, _ in lights]}}}


def write_glb(path, vertices, faces, normals=None, uv=None, material=None, node=None, uv1=None, colours=None, **extra):
    """Write one primitive; `material`, `node` and `extra` go into the JSON as they are."""
    blob, views, accessors = b"", [], []

    def store(array, component, kind):
        nonlocal blob
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": kind})
        blob += array.tobytes()
        return len(accessors) - 1

    attributes = {"POSITION": store(np.asarray(vertices, "<f4"), 5126, "VEC3")}
    if normals is not None:
        attributes["NORMAL"] = store(np.asarray(normals, "<f4"), 5126, "VEC3")
    if uv is not None:
        attributes["TEXCOORD_0"] = store(np.asarray(uv, "<f4"), 5126, "VEC2")
    if uv1 is not None:
        attributes["TEXCOORD_1"] = store(np.asarray(uv1, "<f4"), 5126, "VEC2")
    if colours is not None:
        attributes["COLOR_0"] = store(np.asarray(colours, "<f4"), 5126, f"VEC{np.shape(colours)[1]}")
    primitive = {"attributes": attributes, "indices": store(np.asarray(faces, "<u4").reshape(-1), 5125, "SCALAR")}
    image = extra.pop("image", None)
    if image is not None:
        blob += b"\0" * (-len(blob) % 4)
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(image)})
        blob += image
        extra = {"textures": [{"source": 0}], **extra}
        extra["images"] = [{"bufferView": len(views) - 1, "mimeType": "image/png"}]
    if material is not None:
        primitive["material"] = 0
        extra["materials"] = [material]
    nodes = [{"mesh": 0, **(node or {})}, *extra.pop("nodes", [])]
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
        "meshes": [{"primitives": [primitive]}], "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}], **extra,
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(blob))
    path.write_bytes(
        head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    )
    return path


def write_obj(path, vertices=BOX, faces=BOX_FACES, before="", library=None):
    """Write an OBJ with absolute indices, and its MTL if given."""
    lines = [before, *(f"v {x} {y} {z}" for x, y, z in vertices), *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces)]
    path.write_text("\n".join(lines) + "\n")
    if library is not None:
        path.with_suffix(".mtl").write_text(library)
    return path


def write_room(folder):
    """Write room.obj, a unit box seen from inside with a lamp, and cube.obj, a cube of 0.2."""
    lamp = np.array([[0.4, 0.99, 0.4], [0.6, 0.99, 0.4], [0.6, 0.99, 0.6], [0.4, 0.99, 0.6]])
    vertices = np.concatenate([BOX, lamp])
    lines = ["mtllib room.mtl", *(f"v {x} {y} {z}" for x, y, z in vertices), "usemtl wall"]
    lines += [f"f {c + 1} {b + 1} {a + 1}" for a, b, c in BOX_FACES] + ["usemtl lamp", "f 9 10 11 12"]
    (folder / "room.obj").write_text("\n".join(lines) + "\n")
    (folder / "room.mtl").write_text("newmtl wall\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 10 10 10\n")
    write_obj(folder / "cube.obj", BOX * 0.2)
    return folder


SCENE = """
title = "test"
[static]
mesh = "room.obj"
max_edge = 10
[camera]
position = [0.5, 0.5, 0.1]
target = [0.5, 0.5, 0.9]
[[mobile]]
name = "cube"
mesh = "cube.obj"
position = [0.3, 0.0, 0.3]
"""


def write_scene(folder, text=SCENE, name="scene.toml"):
    """Write the room and a scene file about it; return the scene file."""
    write_room(folder)
    (folder / name).write_text(text)
    return folder / name
