"""Inputs of the fuzzer: small files of every format, and mutations that damage them."""

import io
import json
import random
import re
import struct
import tempfile
from pathlib import Path

import numpy as np

from tests.support.mesh_writers import (
    BOX,
    BOX_FACES,
    QUAD,
    QUAD_FACES,
    SCENE,
    gltf_lights,
    write_glb,
    write_obj,
    write_room,
)
from tests.support.photometry import write_ies, write_ldt

NUMBERS = """0 -1 1 2 3 255 256 65535 -2147483648 4294967295 99999999999999999999 1e30 1e-30 1e308 1e999 nan inf
-inf""".split()
WORDS = "v f vn vt usemtl mtllib newmtl Kd Ke map_Kd map_Ke -s -clamp solid facet vertex property list element".split()
BYTES = [bytes.fromhex(h) for h in "00 ff 7f 00000000 ffffffff ffffff7f 0000c07f 0000807f".split()]
VALUES = [None, True, 0, -1, 1, 7, 1 << 31, 1 << 40, 1e308, -1e-308, "", "x", "data:,", "../up", [], {}, [0], [[]]]
KEYS = """mesh nodes children scale matrix rotation translation skin camera material indices mode sparse count type uri
byteOffset byteStride byteLength bufferView componentType source sampler texCoord extensions light name
normalized""".split()

MTL = """newmtl wall
Kd 0.5 0.6 0.7
map_Kd -s 2 2 1 -o 0 0 -clamp on dot.png
Pr 0.4
Pm 0.2
newmtl lamp
Kd 0 0 0
Ks 0.2 0.2 0.2
Ns 50
Ke 9 9 9
map_Ke dot.png
"""
FULL_OBJ = (
    "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl wall\n"
    "f 1/1/1 2/2/1 3/3/1 4/1/1\nf -1//1 -2//1 -3//1\nusemtl lamp\nf 1 2 5\n"
)
EVERY_KEY = """
up = "y"
units = "radiometric"
[static]
mesh = ["room.obj", "cube.obj"]
scale = 1.0
max_edge = 0.5
[camera]
position = [0.5, 0.5, 0.1]
target = [0.5, 0.5, 0.9]
fov = 40
[[mobile]]
name = "cube"
mesh = "cube.obj"
scale = 0.5
max_edge = 0.2
material = "oak"
axis = [0, 1, 0]
angle = 20
[mobile.path]
times = [0, 1, 2]
positions = [[0.1, 0, 0.1], [0.5, 0, 0.5], [0.1, 0, 0.1]]
spin = 90
[[mobile]]
name = "other"
mesh = "cube.obj"
[[light]]
type = "point"
name = "bulb"
position = [0.5, 0.5, 0.5]
flux = [3, 2, 1]
[[light]]
type = "spot"
position = [0.5, 0.8, 0.5]
direction = [0, -1, 0]
intensity = [1, 1, 1]
inner_degrees = 10
outer_degrees = 30
[[light]]
type = "directional"
direction = [0, -1, 0]
irradiance = [1, 1, 1]
[[light]]
type = "sky"
radiance = [1, 1, 1]
[materials.oak]
reflectance = [0.4, 0.3, 0.2]
two_sided = true
[materials.lamp]
emission = [5, 5, 5]
[materials.wall]
roughness = 0.3
metallic = 0.5
ior = 1.6
[[mobile]]
name = "metal"
mesh = "cube.obj"
material = "metal"
[materials.metal]
brdf = [{ model = "ward", factor = 0.5, ks = [0.3, 0.2, 0.1], ax = 0.3 }, { model = "lewis" }]
scale = true
grain = [0, 0, 1]
[[mobile]]
name = "paper"
mesh = "cube.obj"
material = "paper"
[materials.paper]
brdf = "oren_nayar"
sigma = 0.4
[[probe]]
name = "desk"
position = [0.5, 0.1, 0.5]
normal = [0, 1, 0]
[defaults]
photons = 1000
radius = 0.1
neighbours = 10
estimator = "photon_map"
exposure = 0.5
scene_size = 1.0
"""


def surroundings(folder: Path) -> None:
    """Write files that mutated files may refer to: meshes, a library, an image, a buffer."""
    from PIL import Image

    write_room(folder)
    (folder / "room.mtl").write_text(MTL)
    Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3)).save(folder / "dot.png")
    (folder / "quad.bin").write_bytes(QUAD.astype("<f4").tobytes() + QUAD_FACES.astype("<u4").tobytes())


def seeds() -> dict[str, list[bytes]]:
    """Return whole files by format, to begin with."""
    import trimesh

    mesh = trimesh.Trimesh(BOX, BOX_FACES, process=False)
    painted = trimesh.Trimesh(BOX, BOX_FACES, process=False, vertex_colors=np.full((8, 4), 200, np.uint8))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        image = io.BytesIO()
        _dot(image)
        textured = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveFactor": [1, 0, 0]}
        extra = gltf_lights(({"type": "spot", "spot": {"outerConeAngle": 0.5}}, {"children": []}))
        extra |= {"cameras": [{"type": "perspective", "perspective": {"yfov": 0.7}}]}
        glb = write_glb(
            folder / "a.glb", BOX, BOX_FACES, BOX - 0.5, BOX[:, :2], textured, {"scale": [1, 2, 1]},
            colours=BOX, image=image.getvalue(), **extra,
        ).read_bytes()  # fmt: skip
        plain = write_glb(folder / "b.glb", QUAD, QUAD_FACES).read_bytes()
        obj = write_obj(folder / "c.obj").read_bytes()
        table, tilt = np.array([[90.0, 50.0, 0.0]] * 4), "TILT=INCLUDE\n1\n2\n0 90\n1 0.5"
        ies = [
            write_ies(folder / "d.ies", [0, 45, 90], [0, 60, 90], table[:3], tilt=tilt).read_bytes(),
            write_ies(folder / "d.ies", [0, 45, 180], [0], table[:1], "of 1986").read_bytes(),
        ]
        ldt = [write_ldt(folder / "e.ldt", k, [0, 45, 90], [0, 90, 180, 270], table).read_bytes() for k in (0, 1, 3)]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR",
         "sparse": {"count": 1, "indices": {"bufferView": 1, "componentType": 5125},
                    "values": {"bufferView": 1}}},
    ]  # fmt: skip
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "children": [1], "rotation": [0, 0, 0, 1]}, {"mesh": 0, "skin": 0}],
        "skins": [{"joints": [0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 0, "WEIGHTS_0": 0}, "indices": 1}]}],
        "accessors": accessors,
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "buffers": [{"byteLength": 72, "uri": "quad.bin"}],
    }
    return {
        "toml": [SCENE.encode(), EVERY_KEY.encode()],
        "ies": ies,
        "ldt": ldt,
        "obj": [obj, FULL_OBJ.encode()],
        "mtl": [MTL.encode()],
        "glb": [glb, plain],
        "gltf": [json.dumps(gltf).encode()],
        "ply": [mesh.export(file_type="ply"), painted.export(file_type="ply", encoding="ascii")],
        "stl": [mesh.export(file_type="stl"), mesh.export(file_type="stl_ascii").encode()],
    }


def _dot(file) -> None:
    from PIL import Image

    Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(file, "PNG")


def mutate(random: random.Random, kind: str, data: bytes, other: bytes) -> bytes:
    """Return a file with one to four kinds of damage; `other` is a file of the same kind to cross it with."""
    for _ in range(random.choice((1, 1, 1, 2, 2, 4))):
        ways = [_bytes, _splice]
        if kind in ("toml", "obj", "mtl", "gltf", "stl", "ply", "ies", "ldt"):
            ways += [_number, _number, _line, _word]
        if kind in ("glb", "gltf"):
            ways += [_json] * 6
        data = random.choice(ways)(random, data, other)[: 1 << 20]
    return data


def _bytes(random, data, other):
    at = random.randrange(len(data) + 1)
    what = random.choice([*BYTES, random.randbytes(random.randint(1, 8)), data[at : at + random.randint(1, 64)]])
    skipped = random.choice((0, len(what), random.randint(0, 64)))
    return data[:at] + what + data[at + skipped :]


def _splice(random, data, other):
    if random.random() < 0.3:
        return data[: random.randrange(len(data) + 1)]
    return data[: random.randrange(len(data) + 1)] + other[random.randrange(len(other) + 1) :]


def _number(random, data, other):
    found = list(re.finditer(rb"-?\d+(\.\d*)?(e[-+]?\d+)?", data))
    if not found:
        return data
    m = random.choice(found)
    return data[: m.start()] + random.choice(NUMBERS).encode() + data[m.end() :]


def _line(random, data, other):
    lines = data.split(b"\n")
    k, line = random.randrange(len(lines)), random.choice(other.split(b"\n"))
    way = random.randrange(4)
    if way == 0:
        del lines[k]
    elif way == 1:
        lines.insert(k, line)
    elif way == 2:
        lines[k:k] = [lines[k]] * random.choice((1, 2, 50))
    else:
        lines[k] = lines[k] + b" " + line
    return b"\n".join(lines)


def _word(random, data, other):
    words = re.findall(rb"[A-Za-z_]+", other) or [b"x"]
    found = list(re.finditer(rb"[A-Za-z_]+|\[|\]|\"|=", data))
    if not found:
        return data
    m = random.choice(found)
    deep = random.choice((b"[", b"{", b"[[", b'{"a":')) * random.choice((1, 500, 5000))
    word = random.choice((random.choice(words), random.choice(WORDS).encode(), deep))
    return data[: m.start()] + word + data[m.end() :]


def _json(random, data, other):
    """Damage one value of a glTF's JSON, so that the rest of it stays readable."""
    text, rest = data, None
    if data[:4] == b"glTF" and len(data) >= 20:
        (length,) = struct.unpack_from("<I", data, 12)
        text, rest = data[20 : 20 + length], data[20 + length :]
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return _bytes(random, data, other)
    holders = []
    stack = [document]
    while stack:
        value = stack.pop()
        if isinstance(value, dict | list) and value:
            holders.append(value)
            stack += value.values() if isinstance(value, dict) else value
    if not holders:
        return _bytes(random, data, other)
    holder = random.choice(holders)
    key = random.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
    way = random.randrange(5)
    if way == 0:
        del holder[key]
    elif way == 1 and isinstance(holder, dict):
        holder[random.choice(KEYS)] = random.choice(VALUES)
    elif way == 2:
        donor = random.choice(holders)
        holder[key] = json.loads(json.dumps(donor))
    elif way == 3 and isinstance(holder, list):
        holder += [json.loads(json.dumps(holder[key]))] * random.choice((1, 3, 300))
    else:
        holder[key] = random.choice(VALUES)
    text = json.dumps(document).encode()
    if rest is None:
        return text
    text += b" " * (-len(text) % 4)
    return data[:8] + struct.pack("<II4s", 20 + len(text) + len(rest), len(text), b"JSON") + text + rest
