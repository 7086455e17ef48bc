"""Small files that ask for much: each stands for more triangles, pixels, files or nesting than its bytes hold."""

import base64
import io
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from tests.support.mesh_writers import write_obj, write_room

ALL: dict[str, Callable[[Path], Path]] = {}  # by name: writes a bomb into an empty folder, returns the file to open


def bomb(write):
    ALL[write.__name__] = write
    return write


def gltf(
    folder: Path, points: int, order: list[int] | None, nodes: int = 1, primitives: int = 1, stored=False, **extra
) -> Path:
    """Primitives that share one accessor of positions, zeros or stored, on any number of nodes."""
    accessors = [{"componentType": 5126, "count": points, "type": "VEC3"}]
    primitive: dict = {"attributes": {"POSITION": 0}} | extra.pop("primitive", {})
    views, blob = [], b""
    if stored:
        blob = np.random.default_rng(0).random((points, 3)).astype("<f4").tobytes()
        accessors[0]["bufferView"] = 0
        views.append({"buffer": 0, "byteLength": len(blob)})
    if order is not None:
        body = np.asarray(order, "<u4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(body)})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5125, "count": len(order), "type": "SCALAR"})
        primitive["indices"] = 1
        blob += body
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": list(range(nodes))}], "nodes": [{"mesh": 0}] * nodes,
        "meshes": [{"primitives": [primitive] * primitives}], "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(blob), "uri": "data:;base64," + base64.b64encode(blob).decode()}], **extra,
    }  # fmt: skip
    (folder / "bomb.gltf").write_text(json.dumps(document))
    return folder / "bomb.gltf"


def png(side: int, mode: str = "L", shade: int = 1) -> bytes:
    Image.new(mode, (side, side), shade if mode == "L" else (shade, 9, 9, 0)).save(stream := io.BytesIO(), "PNG")
    return stream.getvalue()


def _uri(data: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(data).decode()


@bomb
def zeros_without_data(folder):
    return gltf(folder, 9_999_999, None)


@bomb
def zeros_a_hundred_times(folder):
    return gltf(folder, 9_999_999, [0, 1, 2], primitives=100)


@bomb
def instances_of_a_mesh(folder):
    order = np.random.default_rng(0).integers(0, 3000, 15000)
    path = gltf(folder, 3000, order.tolist(), nodes=3990, stored=True)
    nodes = [{"mesh": 0, "translation": [i, 0, 0]} for i in range(3990)]
    path.write_text(json.dumps(json.loads(path.read_text()) | {"nodes": nodes}))
    return path


@bomb
def vertices_without_faces(folder):
    return gltf(folder, 100_000, [0, 1, 2], nodes=5000, stored=True)


@bomb
def primitives_by_nodes(folder):
    return gltf(folder, 3, [0, 1, 2], nodes=2000, primitives=2000, stored=True)


@bomb
def images_of_8000(folder):
    images = [{"uri": _uri(png(8000, shade=i))} for i in range(16)]
    materials = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(16)]
    path = gltf(
        folder,
        3,
        [0, 1, 2],
        primitives=16,
        stored=True,
        images=images,
        materials=materials,
        textures=[{"source": i} for i in range(16)],
    )
    document = json.loads(path.read_text())
    uv = {"TEXCOORD_0": 0}
    document["accessors"].append({"componentType": 5126, "count": 3, "type": "VEC2"})
    uv = {"POSITION": 0, "TEXCOORD_0": 2}
    document["meshes"][0]["primitives"] = [{"attributes": uv, "indices": 1, "material": i} for i in range(16)]
    path.write_text(json.dumps(document))
    return path


@bomb
def images_of_20000(folder):
    for i in range(2):
        (folder / f"{i}.png").write_bytes(png(20000, shade=i))
    library = "".join(f"newmtl m{i}\nmap_Kd {i % 2}.png\n" for i in range(16))
    return write_obj(folder / "bomb.obj", before="mtllib bomb.mtl\nusemtl m0", library=library)


@bomb
def masks_of_one_image(folder):
    materials = [
        {"alphaMode": "MASK", "alphaCutoff": 0.3 + i / 1000, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        for i in range(40)
    ]
    images = [{"uri": _uri(png(6000, "RGBA"))}]
    path = gltf(folder, 3, [0, 1, 2], stored=True, images=images, materials=materials, textures=[{"source": 0}])
    document = json.loads(path.read_text())
    document["accessors"].append({"componentType": 5126, "count": 3, "type": "VEC2"})
    uv = {"POSITION": 0, "TEXCOORD_0": 2}
    document["meshes"][0]["primitives"] = [{"attributes": uv, "indices": 1, "material": i} for i in range(40)]
    path.write_text(json.dumps(document))
    return path


@bomb
def emissive_image_of_many_materials(folder):
    (folder / "a.png").write_bytes(png(4000))
    library = "".join(f"newmtl m{i}\nKe 1 1 1\nmap_Ke a.png\n" for i in range(2000))
    return write_obj(folder / "bomb.obj", before="mtllib bomb.mtl", library=library)


@bomb
def library_named_often(folder):
    library = "".join(f"newmtl m{i}\nKd 1 1 1\n" for i in range(1000))
    return write_obj(folder / "bomb.obj", before="mtllib bomb.mtl\n" * 10_000, library=library)


@bomb
def libraries_that_are_missing(folder):
    return write_obj(folder / "bomb.obj", before="".join(f"mtllib {i}.mtl\n" for i in range(100_000)))


@bomb
def mesh_named_by_many_objects(folder):
    write_room(folder)
    points = np.random.default_rng(0).random((3000, 3))
    write_obj(folder / "soup.obj", points, np.arange(3000).reshape(-1, 3))
    mobiles = "".join(f'[[mobile]]\nname = "{i}"\nmesh = "soup.obj"\nposition = [0, 0, 0]\n' for i in range(3000))
    (folder / "bomb.toml").write_text('[static]\nmesh = "room.obj"\n' + mobiles)
    return folder / "bomb.toml"


@bomb
def mesh_joined_often(folder):
    points = np.random.default_rng(0).random((30000, 3))
    write_obj(folder / "soup.obj", points, np.arange(30000).reshape(-1, 3))
    (folder / "bomb.toml").write_text("[static]\nmesh = " + json.dumps(["soup.obj"] * 1000))
    return folder / "bomb.toml"


@bomb
def polygon_of_a_million_corners(folder):
    angle = np.linspace(0, 6.28, 1_000_000)
    lines = [f"v {x:.5f} {y:.5f} 0" for x, y in zip(np.cos(angle), np.sin(angle), strict=True)]
    (folder / "bomb.obj").write_text("\n".join(lines) + "\nf " + " ".join(map(str, range(1, 1_000_001))))
    return folder / "bomb.obj"


@bomb
def polygon_of_repeated_corners(folder):
    (folder / "bomb.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 2_000_000)
    return folder / "bomb.obj"


@bomb
def polygon_of_a_ply(folder):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\n"
    body = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n1000000 " + "0 1 2 1 " * 250_000
    (folder / "bomb.ply").write_text(head + "property list int int vertex_indices\nend_header\n" + body)
    return folder / "bomb.ply"


@bomb
def file_of_holes(folder):
    (folder / "bomb.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    os.truncate(folder / "bomb.obj", 6 << 30)
    return folder / "bomb.obj"


@bomb
def key_of_many_dots(folder):
    write_room(folder)
    (folder / "bomb.toml").write_text("a." * 50_000 + 'b = 1\n[static]\nmesh = "room.obj"\n')
    return folder / "bomb.toml"


@bomb
def header_of_many_dots(folder):
    write_room(folder)
    (folder / "bomb.toml").write_text('[static]\nmesh = "room.obj"\n[' + '"a" . ' * 50_000 + "b]\nc = 1\n")
    return folder / "bomb.toml"


@bomb
def lights_of_a_scene_file(folder):
    write_room(folder)
    lights = "".join(
        f'[[light]]\ntype="point"\nname="{i}"\nposition=[0.5,0.5,0.5]\nflux=[1,1,1]\n' for i in range(3_000)
    )
    (folder / "bomb.toml").write_text('[static]\nmesh = "room.obj"\n' + lights)
    return folder / "bomb.toml"


@bomb
def turns_of_many_mobiles(folder):
    write_room(folder)
    spin = "path = {times = [0, 100], positions = [[0,0,0],[0,0,0]], spin = 46000}\n"
    mobiles = "".join(f'[[mobile]]\nname = "{i}"\nmesh = "cube.obj"\n{spin}' for i in range(300))
    (folder / "bomb.toml").write_text('[static]\nmesh = "room.obj"\n' + mobiles)
    return folder / "bomb.toml"
