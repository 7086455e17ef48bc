"""Scene files by grammar, one per seed: TOML 1.0, OBJ and MTL, PLY 1.0, glTF 2.0, and the images that they name.

Every production follows the public specification of its format or `docs/scene-format.md`, not the loaders. `oddity` is
the share of leaves that keep the syntax but leave the meaning: another type, an extreme number, an index out of range,
a list too short. A document of oddity 0 is valid.
"""

from __future__ import annotations

import base64
import functools
import io
import json
import math
import os
import random
import string
import struct
import zlib
from pathlib import Path

import numpy as np
from PIL import Image

KINDS = ("toml", "obj", "ply", "glb", "gltf")
ODDITIES = (0.0, 0.01, 0.04, 0.2)
Files = dict[str, bytes]  # by name

NUMBERS = [0, -1, 1, 2, -0.0, 0.5, 1e-45, 1e-300, 1e-12, 1e7, 1e15, 1e30, 1e300, 1.7e308, math.inf, -math.inf, math.nan]
WHOLES = [0, -1, 1, 2, 3, 7, 255, 256, 65535, 65536, 10**6, 2**31 - 1, 2**31, 2**32, 2**63 - 1, 2**63, 10**30, -(2**63)]
TEXTS = [
    "",
    " ",
    ".",
    "..",
    "/",
    "~",
    "a/b",
    "../room.obj",
    "/dev/zero",
    "/etc/passwd",
    "C:\\a",
    "a\x00b",
    "\x1b[31m",
    "é\u202e\U0001f600",
]
TEXTS += [
    "x" * 300,
    "x" * 70000,
    "pipe",
    "folder",
    "loop",
    "%2e%2e/x",
    "http://localhost:9/a",
    "file:///etc/passwd",
    "data:,",
    "None",
    "-0",
]


class Grammar:
    """A source of random choices that all productions share."""

    def __init__(self, seed: int, oddity: float) -> None:
        self.rng = random.Random(seed)
        self.oddity = oddity
        self.dark = False  # materials must not emit: they are those of a mobile

    def chance(self, share: float) -> bool:
        return self.rng.random() < share

    def pick(self, *options):
        return self.rng.choice(options)

    def leaf(self, value):
        """`value`, or with the probability of oddity a value that the place does not expect."""
        return self.odd(value) if self.chance(self.oddity) else value

    def odd(self, value):
        if self.chance(0.25):
            value = self.pick(0, 1.5, "text", True, [], {}, [[1]], {"a": {}}, [value], [1, 2, 3])
        if isinstance(value, bool):
            return self.pick(not value, 1, "true", [])
        if isinstance(value, int):
            return self.pick(*WHOLES, value + 1, value - 1, float(value), *NUMBERS)
        if isinstance(value, float):
            return self.pick(*NUMBERS, *WHOLES)
        if isinstance(value, str):
            return self.pick(*TEXTS, value * 2, value.upper(), value[:-1])
        if isinstance(value, list) and value:
            odd = [self.odd(v) if self.chance(0.5) else v for v in value]
            return self.pick(value[:-1], [*value, value[-1]], odd, [value, value], [0 for _ in value], value * 50, [])
        return self.pick({}, [], 0, "text", {"x": 1})

    def real(self, low: float = -2.0, high: float = 2.0) -> float:
        return round(self.rng.uniform(low, high), self.pick(0, 1, 3, 7))

    def reals(self, count: int, low: float = -2.0, high: float = 2.0) -> list[float]:
        return [self.real(low, high) for _ in range(count)]

    def name(self) -> str:
        """A name of letters; often one that was given before."""
        return self.pick("a", "wall", "lamp", "default", "oak", "m 1", "ünï", "0", "x" * self.rng.randint(1, 20))


# -- shapes ---------------------------------------------------------------------------------------


def shape(g: Grammar) -> tuple[list[list[float]], list[list[int]]]:
    """Vertices and polygons: box, pyramid, plane of squares, fan, loose triangles, one polygon of many corners."""
    kind = g.pick("box", "pyramid", "plane", "fan", "loose", "polygon")
    if kind == "box":
        size = g.reals(3, 0.5, 4.0)
        corners = [[x * size[0], y * size[1], z * size[2]] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        return corners, [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    if kind == "pyramid":
        corners = [[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1], [0.5, g.real(0.5, 2.0), 0.5]]
        return corners, [[0, 1, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]]
    if kind == "plane":
        n = g.rng.randint(1, 12)
        points = [[float(i), g.pick(0.0, 0.0, g.real()), float(j)] for i in range(n + 1) for j in range(n + 1)]
        return points, [[k, k + 1, k + n + 2, k + n + 1] for k in range(n * (n + 1)) if k % (n + 1) < n]
    n = g.rng.randint(3, 40) if g.chance(0.95) else g.rng.randint(300, 9000)
    ring = [[math.cos(2 * math.pi * i / n), 0.0, math.sin(2 * math.pi * i / n)] for i in range(n)]
    if kind == "fan":
        return [*ring, [0.0, 1.0, 0.0]], [[i, (i + 1) % n, n] for i in range(n)]
    if kind == "polygon":
        return ring, [list(range(n))]
    count = g.rng.randint(3, 60)
    return [g.reals(3) for _ in range(count)], [g.rng.sample(range(count), 3) for _ in range(g.rng.randint(1, 80))]


# -- images ---------------------------------------------------------------------------------------


def _png_header(width: int, height: int) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = zlib.compress(bytes(1000))
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
        + chunk(b"IDAT", rows)
        + chunk(b"IEND", b"")
    )


@functools.cache
def images() -> tuple[list[bytes], list[bytes]]:
    """Images that every viewer reads, and files that are none or not quite."""
    rng = np.random.default_rng(0)
    good, odd = [], []
    for mode, kinds in {
        "RGB": ("PNG", "JPEG"),
        "RGBA": ("PNG",),
        "L": ("PNG", "JPEG"),
        "LA": ("PNG",),
        "P": ("PNG",),
    }.items():
        for kind in kinds:
            for size in ((4, 4), (1, 1), (7, 3)):
                picture = Image.fromarray(rng.integers(0, 256, (size[1], size[0], 4), dtype=np.uint8), "RGBA").convert(
                    mode
                )
                picture.save(stream := io.BytesIO(), kind)
                good.append(stream.getvalue())
    colour = Image.fromarray(rng.integers(0, 256, (8, 8, 3), dtype=np.uint8))
    forms = [
        ("1", "PNG"),
        ("I;16", "PNG"),
        ("CMYK", "JPEG"),
        ("RGB", "BMP"),
        ("RGB", "TIFF"),
        ("RGB", "TGA"),
        ("RGB", "PPM"),
    ]
    for mode, kind in [
        *forms,
        ("P", "GIF"),
        ("RGB", "WEBP"),
        ("RGB", "EPS"),
        ("RGB", "PDF"),
        ("RGB", "ICO"),
        ("RGB", "PCX"),
    ]:
        (colour.convert("L") if mode == "I;16" else colour).convert(mode).save(stream := io.BytesIO(), kind)
        odd.append(stream.getvalue())
    odd += [
        b"",
        b"\x89PNG\r\n\x1a\n",
        good[0][:40],
        good[3][: len(good[3]) // 2],
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\nshowpage\n",
    ]
    odd += [
        _png_header(20000, 20000),
        _png_header(2**31 - 1, 1),
        _png_header(0, 4),
        _png_header(70000, 4),
        b"<svg/>",
        b"#?RADIANCE\n\n-Y 4 +X 4\n",
    ]
    odd += [
        b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80),
        b"DDS " + bytes(124),
        b"P6 9999999 9999999 255\n",
        b"newmtl a\nKd 1 1 1\n",
    ]
    return good, odd


def image(g: Grammar) -> bytes:
    good, odd = images()
    return g.pick(*odd) if g.chance(g.oddity * 3) else g.pick(*good)


# -- OBJ and MTL ----------------------------------------------------------------------------------


def _number(g: Grammar, value: float) -> str:
    if g.chance(g.oddity / 4):
        return g.pick(
            "nan", "inf", "-inf", "1e999", "1e-999", "0x10", "1,5", "--1", "1_0", "", "#", "\u0661", "9" * 5000, "1e30"
        )
    return g.pick(f"{value:g}", f"{value:.6f}", f"{value:+.3e}", f"{value:.9E}", repr(float(value)))


def _line(g: Grammar, *words: object) -> str:
    text = g.pick(" ", " ", " ", "\t", "  ").join(map(str, words))
    if g.chance(0.01):
        at = text.find(" ") + 1
        text = text[:at] + "\\\n" + text[at:]
    return g.pick("", "", "", " ") + text + g.pick("", "", "", " ", " # comment" if g.chance(0.2) else "")


def _index(g: Grammar, index: int, count: int) -> str:
    if g.chance(g.oddity / 4):
        return g.pick("0", "-0", str(count + 1), str(-count - 1), str(10**12), "1.0", "a", str(-(2**63)), "")
    return str(index - count if g.chance(0.1) else index + 1)


def obj(g: Grammar, files: Files, stem: str) -> str:
    """One OBJ with its libraries and images, added to `files`; its name."""
    lines, points, coordinates, normals, materials = [], 0, 0, 0, []
    if g.chance(0.7):
        libraries = [f"{stem}{i}.mtl" for i in range(g.pick(1, 1, 1, 2))]
        for library in libraries:
            materials += mtl(g, files, library)
        named = [g.leaf(library) for library in libraries]
        lines += (
            [_line(g, "mtllib", *map(str, named))] if g.chance(0.5) else [_line(g, "mtllib", str(n)) for n in named]
        )
    for _ in range(g.pick(1, 1, 2, 4)):
        vertices, faces = shape(g)
        offset = g.reals(3)
        tail = g.pick(0, 0, 0, 1, 3)
        for vertex in vertices:
            values = (
                [a + b for a, b in zip(vertex, offset, strict=True)] + [1.0] * (tail == 1) + [0.5] * 3 * (tail == 3)
            )
            lines.append(_line(g, "v", *(_number(g, v) for v in values)))
        first, points = points, points + len(vertices)
        count_t = g.pick(0, 0, len(vertices), 4)
        count_n = g.pick(0, 0, len(vertices), 1)
        lines += [_line(g, "vt", *(_number(g, v) for v in g.reals(g.pick(1, 2, 2, 2, 3)))) for _ in range(count_t)]
        lines += [_line(g, "vn", *(_number(g, v) for v in g.reals(3))) for _ in range(count_n)]
        first_t, coordinates = coordinates, coordinates + count_t
        first_n, normals = normals, normals + count_n
        for face in faces:
            if g.chance(0.05):
                lines.append(_statement(g, materials))
            corners = []
            for corner in face:
                text = _index(g, first + corner, points)
                if count_t or count_n:
                    text += "/" + (_index(g, first_t + corner % count_t, coordinates) if count_t else "")
                if count_n:
                    text += "/" + _index(g, first_n + corner % count_n, normals)
                corners.append(text)
            lines.append(_line(g, g.leaf("f") if g.chance(0.1) else "f", *corners))
    ending = g.pick("\n", "\n", "\r\n")
    files[f"{stem}.obj"] = (
        g.pick("", "# made by a grammar\n", "\ufeff") + ending.join(map(str, lines)) + g.pick("", ending)
    ).encode(g.pick("utf-8", "utf-8", "utf-16") if g.chance(g.oddity) else "utf-8", "replace")
    return f"{stem}.obj"


def _statement(g: Grammar, materials: list[str]) -> str:
    known = g.pick(*materials) if materials else "none"
    others = [
        "g",
        "s off",
        "s 1",
        "mg 1 0.5",
        "l 1 2 3",
        "p 1",
        "usemap off",
        "lod 1",
        "bevel on",
        "c_interp off",
        "end",
    ]
    others += ["d_interp on", "shadow_obj a.obj", "trace_obj a.obj", "cstype rat bspline", "deg 3", "curv 0 1 1 2 3 1"]
    others += [
        "surf 0 1 0 1 1 2 3",
        "parm u 0 0 1 1",
        "vp 0.5 0.5",
        "call a.obj 1",
        "csh -touch nothing",
        "maplib a.map",
    ]
    named = [f"usemtl {g.leaf(known)}", f"o {g.name()}", f"g {g.name()} {g.name()}"]
    return g.pick(*named * 4, *others, "", "# comment", "unknown 1 2 3")


def mtl(g: Grammar, files: Files, name: str) -> list[str]:
    """One material library, added to `files`; the names of its materials."""
    lines, names = [], []
    for _ in range(g.rng.randint(1, 5)):
        names.append(g.name())
        lines.append(_line(g, "newmtl", names[-1]))
        for _ in range(g.rng.randint(0, 6)):
            lines.append(_property(g, files))
    files[name] = "\n".join(lines).encode("utf-8", "replace")
    return names


def _property(g: Grammar, files: Files) -> str:
    def colour(top: float) -> list[str]:
        return [_number(g, v) for v in g.reals(g.pick(3, 3, 3, 1), 0.0, top)]

    def picture() -> str:
        name = g.pick("wood.png", "brick.jpg", "a b.png", "mask.png")
        files.setdefault(name, image(g))
        return str(g.leaf(name))

    options = [
        "-s 2 2 1",
        "-s 3",
        "-o 0.5 0.5",
        "-t 0.1",
        "-mm 0 1",
        "-bm 0.5",
        "-clamp on",
        "-clamp off",
        "-blendu on",
        "-blendv off",
    ]
    options += ["-texres 64", "-imfchan l", "-boost 2", "-type sphere", "-cc on"]
    some = g.rng.sample(options, g.pick(0, 0, 0, 1, 2))
    glow, glowing = (0.0, "map_Kd") if g.dark else (20.0, "map_Ke")
    maps = ["map_Kd", "map_Kd", glowing, "map_d", "map_Ka", "bump", "map_Bump", "disp", "decal", "refl", "norm"]
    lines = [
        ["Kd", *colour(1.0)],
        ["Ka", *colour(1.0)],
        ["Tf", *colour(1.0)],
        ["Ke", *colour(glow)],
        ["Ns", _number(g, 10.0)],
    ]
    lines += [
        ["Kd", "xyz", *colour(1.0)],
        ["Kd", "spectral", "wood.rfl", 1],
        ["Ni", _number(g, 1.5)],
        ["sharpness", 60],
    ]
    lines += [["d", _number(g, 0.7)], ["d", "-halo", 0.5], ["Tr", _number(g, 0.2)], ["illum", g.pick(0, 1, 2, 10, 99)]]
    lines += [["Pr", _number(g, 0.5)], ["map_aat", "on"], ["#", "comment"], [""]]
    return _line(g, g.pick(*maps), *some, picture()) if g.chance(0.3) else _line(g, *g.pick(*lines))


# -- PLY ------------------------------------------------------------------------------------------

PLY_TYPES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
}
PLY_TYPES |= {
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "float64": "d",
}
WHOLE_TYPES = [name for name, code in PLY_TYPES.items() if code not in "fd"]
REAL_TYPES = ["float", "double", "float32", "float64"]


def ply(g: Grammar, files: Files, stem: str) -> str:
    """One PLY, ASCII or binary of either order, added to `files`; its name."""
    form = g.pick("ascii", "binary_little_endian", "binary_big_endian")
    vertices, faces = shape(g)
    kind = g.pick(*REAL_TYPES)
    columns: list[tuple[str, str, list]] = [(kind, axis, [v[i] for v in vertices]) for i, axis in enumerate("xyz")]
    if g.chance(0.4):
        columns += [(g.pick("float", "double"), axis, g.reals(len(vertices))) for axis in ("nx", "ny", "nz")]
    if g.chance(0.4):
        names = g.pick(
            ("red", "green", "blue"),
            ("red", "green", "blue", "alpha"),
            ("diffuse_red", "diffuse_green", "diffuse_blue"),
        )
        columns += [(g.pick("uchar", "uint8"), c, [g.rng.randint(0, 255) for _ in vertices]) for c in names]
    if g.chance(0.3):
        columns += [
            ("float", c, g.reals(len(vertices))) for c in g.pick(("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
        ]
    if g.chance(0.2):
        columns.append((g.pick(*PLY_TYPES), "quality", [1] * len(vertices)))
    if g.chance(0.1):
        g.rng.shuffle(columns)
    rows = [[(t, g.leaf(v[i]) if g.chance(0.05) else v[i]) for t, _, v in columns] for i in range(len(vertices))]
    vertex = ("vertex", [f"property {g.leaf(t) if g.chance(0.1) else t} {c}" for t, c, _ in columns], rows)

    count_type = g.pick("uchar", "uint8", "int", "ushort", "uint")
    if max(map(len, faces)) > 255:
        count_type = g.pick("int", "uint")
    index_type = g.pick("int", "uint", "int32", "uint32", *(["ushort"] if len(vertices) < 60000 else []))
    face_rows = [[(count_type, len(f)), *((index_type, g.leaf(i) if g.chance(0.05) else i) for i in f)] for f in faces]
    lists = [f"property list {count_type} {index_type} {g.pick('vertex_indices', 'vertex_indices', 'vertex_index')}"]
    if g.chance(0.2):
        lists.append("property uchar red")
        face_rows = [[*row, ("uchar", 200)] for row in face_rows]
    if g.chance(0.2):
        lists.append("property list uchar float texcoord")
        face_rows = [
            [*row, ("uchar", min(2 * len(f), 254)), *[("float", 0.5)] * min(2 * len(f), 254)]
            for row, f in zip(face_rows, faces, strict=True)
        ]
    elements = [vertex, ("face", lists, face_rows)]
    if g.chance(0.2):
        elements.insert(
            g.rng.randint(0, 2),
            ("edge", ["property int vertex1", "property int vertex2"], [[("int", 0), ("int", 1)]] * 3),
        )
    if g.chance(0.1):
        elements.append(
            (
                "tristrips",
                ["property list int int vertex_indices"],
                [[("int", 4), ("int", 0), ("int", 1), ("int", 2), ("int", -1)]],
            )
        )
    if g.chance(g.oddity):
        g.rng.shuffle(elements)
    head = ["ply", f"format {form} {g.leaf('1.0')}"]
    if g.chance(0.3):
        files.setdefault("wood.png", image(g))
        head.append(f"comment TextureFile {g.leaf('wood.png')}")
    for name, properties, rows in elements:
        head += [f"element {name} {g.leaf(len(rows))}", *properties]
        if g.chance(0.2):
            head.append(g.pick("comment made by a grammar", "obj_info 1 2 3", "comment"))
    head.append("end_header")
    body = b"".join(_ply_row(g, row, form) for _, _, rows in elements for row in rows)
    ending = g.pick("\n", "\n", "\r\n") if form == "ascii" else "\n"
    files[f"{stem}.ply"] = (
        (ending.join(map(str, head)) + ending).encode("utf-8", "replace")
        + body
        + g.pick(b"", b"", b"\n", b"tail" if g.chance(g.oddity) else b"")
    )
    return f"{stem}.ply"


def _ply_row(g: Grammar, row: list[tuple[str, object]], form: str) -> bytes:
    if form == "ascii":
        return (" ".join(str(v).replace("\n", "") for _, v in row) + "\n").encode("utf-8", "replace")
    order = ">" if "big" in form else "<"
    out = b""
    for kind, value in row:
        code = PLY_TYPES[kind]
        try:
            out += struct.pack(order + code, float(value) if code in "fd" else int(value))
        except (TypeError, ValueError, OverflowError, struct.error):
            out += g.pick(b"", b"\xff" * struct.calcsize(code))
    return out


# -- glTF -----------------------------------------------------------------------------------------

COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Document:
    """A glTF document under construction: its JSON, and the bytes of its one buffer."""

    def __init__(self, g: Grammar, files: Files) -> None:
        self.g, self.files, self.data = g, files, bytearray()
        self.json: dict = {"asset": {"version": g.leaf("2.0")}}
        self.extensions: set[str] = set()

    def add(self, table: str, entry: dict) -> int:
        """Append an entry to a table of the document; its index, seldom another."""
        self.json.setdefault(table, []).append(entry)
        index = len(self.json[table]) - 1
        return self.g.leaf(index) if self.g.chance(0.3) else index

    def view(self, body: bytes, stride: int = 0) -> int:
        self.data += bytes(-len(self.data) % 4)
        entry = {"buffer": self.g.leaf(0), "byteLength": self.g.leaf(len(body))}
        if self.data or self.g.chance(0.5):
            entry["byteOffset"] = self.g.leaf(len(self.data))
        if stride:
            entry["byteStride"] = self.g.leaf(stride)
        if self.g.chance(0.3):
            entry["target"] = self.g.pick(34962, 34963)
        self.data += body
        return self.add("bufferViews", entry)

    def accessor(self, array: np.ndarray, component: int = 5126, normalized: bool = False) -> int:
        """An accessor of an array (N, C): packed, interleaved, sparse, or of zeros without a view."""
        g = self.g
        array = np.atleast_2d(np.asarray(array).T).T
        kind = COMPONENTS[component]
        values = array.astype(kind)
        entry: dict = {
            "componentType": g.leaf(component),
            "count": g.leaf(len(values)),
            "type": g.leaf(SHAPES[array.shape[1]]),
        }
        if len(values) and g.chance(0.8):
            entry |= {"min": [float(v) for v in array.min(axis=0)], "max": [float(v) for v in array.max(axis=0)]}
        if normalized:
            entry["normalized"] = g.leaf(True)
        way = g.pick("packed", "packed", "packed", "padded", "sparse", "sparse zeros")
        size = values.dtype.itemsize * values.shape[1]
        if way == "padded" or (size % 4 and array.shape[1] > 1):
            stride = -(-size // 4) * 4 + g.pick(0, 4, 12) * (way == "padded")
            body = b"".join(row.tobytes().ljust(stride, b"\0") for row in values)
            entry["bufferView"] = self.view(body, stride)
        elif way != "sparse zeros":
            entry["bufferView"] = self.view(values.tobytes())
        if way == "sparse zeros" or (way == "sparse" and len(values)):
            chosen = (
                np.arange(len(values))
                if way == "sparse zeros"
                else np.sort(g.rng.sample(range(len(values)), g.rng.randint(1, len(values))))
            )
            entry["sparse"] = {
                "count": g.leaf(len(chosen)),
                "indices": {
                    "bufferView": self.view(np.asarray(chosen, np.uint32).tobytes()),
                    "componentType": g.leaf(5125),
                },
                "values": {"bufferView": self.view(values[chosen].tobytes())},
            }
            if not len(chosen):
                del entry["sparse"]
        return self.add("accessors", entry)


def gltf(g: Grammar, files: Files, stem: str, binary: bool) -> str:
    """One glTF, as .glb or .gltf with or without an external buffer, added to `files`; its name."""
    d = Document(g, files)
    materials = [d.add("materials", _gltf_material(d)) for _ in range(g.rng.randint(0, 3))]
    meshes = [d.add("meshes", _gltf_mesh(d, materials)) for _ in range(g.rng.randint(1, 3))]
    nodes = _gltf_nodes(d, meshes)
    if g.chance(0.9):
        d.add("scenes", {"nodes": g.leaf(nodes)} | ({"name": g.name()} if g.chance(0.3) else {}))
        if g.chance(0.8):
            d.json["scene"] = g.leaf(0)
    if g.chance(0.1):
        times, values = d.accessor(np.array([0.0, 1.0])), d.accessor(np.zeros((2, 3)))
        channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
        d.add("animations", {"channels": [channel], "samplers": [{"input": times, "output": values}]})
    if d.extensions:
        d.json["extensionsUsed"] = sorted(d.extensions)
        if g.chance(0.2):
            d.json["extensionsRequired"] = sorted(d.extensions)
    if g.chance(g.oddity):
        d.json["extensionsRequired"] = [
            g.pick("KHR_draco_mesh_compression", "EXT_meshopt_compression", "VENDOR_unknown", "KHR_texture_basisu")
        ]
    if g.chance(0.1):
        d.json |= {"extras": {"a": [1, {"b": None}]}, "extensions": d.json.get("extensions", {}) | {"VENDOR_x": {}}}
    name = f"{stem}.{'glb' if binary else 'gltf'}"
    if binary and g.chance(0.8):
        d.json["buffers"] = [{"byteLength": g.leaf(len(d.data))}]
        files[name] = _glb(g, d)
        return name
    if g.chance(0.5):
        uri = (
            "data:"
            + g.pick("application/octet-stream", "application/gltf-buffer", "")
            + ";base64,"
            + base64.b64encode(d.data).decode()
        )
    else:
        uri = g.pick(f"{stem}.bin", f"{stem}%20b.bin")
        files[uri.replace("%20", " ")] = bytes(d.data)
    d.json["buffers"] = [{"byteLength": g.leaf(len(d.data)), "uri": g.leaf(uri)}]
    d.data = bytearray()
    files[name] = _glb(g, d) if binary else _json(g, d)
    return name


def _json(g: Grammar, d: Document) -> bytes:
    return json.dumps(d.json, indent=g.pick(None, None, 2), ensure_ascii=g.chance(0.5)).encode("utf-8", "surrogatepass")


def _glb(g: Grammar, d: Document) -> bytes:
    text = _json(g, d)
    chunks = [(g.leaf(0x4E4F534A), text + b" " * (-len(text) % 4))]
    if d.data:
        chunks.append((g.leaf(0x004E4942), bytes(d.data) + bytes(-len(d.data) % 4)))
    if g.chance(0.1):
        chunks.append((0x12345678, b"abcd"))
    if g.chance(g.oddity):
        g.rng.shuffle(chunks)

    def word(value: object) -> bytes:
        return struct.pack("<I", int(value) % 2**32) if isinstance(value, int) else b"\xff\xff\xff\xff"

    body = b"".join(word(g.leaf(len(c))) + word(kind) + c for kind, c in chunks)
    return b"glTF" + word(g.leaf(2)) + word(g.leaf(12 + len(body))) + body


def _texture(d: Document) -> dict:
    g = d.g
    body = image(g)
    entry: dict = {}
    if g.chance(0.4):
        entry = {"bufferView": d.view(body), "mimeType": g.leaf(g.pick("image/png", "image/jpeg"))}
    elif g.chance(0.5):
        entry = {"uri": g.leaf("data:image/png;base64," + base64.b64encode(body).decode())}
    else:
        name = g.pick("wood.png", "brick.jpg")
        d.files.setdefault(name, body)
        entry = {"uri": g.leaf(name)}
    texture = {"source": d.add("images", entry)}
    if g.chance(0.5):
        wrap = {"wrapS": g.leaf(g.pick(33071, 33648, 10497)), "wrapT": g.leaf(g.pick(33071, 33648, 10497))}
        texture["sampler"] = d.add("samplers", wrap | ({"magFilter": 9728, "minFilter": 9987} if g.chance(0.5) else {}))
    use: dict = {"index": d.add("textures", texture)}
    if g.chance(0.3):
        use["texCoord"] = g.leaf(g.pick(0, 1))
    if g.chance(0.3):
        d.extensions.add("KHR_texture_transform")
        use["extensions"] = {
            "KHR_texture_transform": {
                "offset": g.leaf(g.reals(2)),
                "rotation": g.leaf(g.real()),
                "scale": g.leaf(g.reals(2)),
            }
        }
    return use


def _gltf_material(d: Document) -> dict:
    g = d.g
    material: dict = {"name": g.leaf(g.name())} if g.chance(0.7) else {}
    if g.chance(0.8):
        rough = {"baseColorFactor": g.leaf(g.reals(4, 0.0, 1.0)), "metallicFactor": g.leaf(0.0), "roughnessFactor": 0.5}
        material["pbrMetallicRoughness"] = {k: v for k, v in rough.items() if g.chance(0.7)}
        for key in ("baseColorTexture", "metallicRoughnessTexture"):
            if g.chance(0.3):
                material["pbrMetallicRoughness"][key] = _texture(d)
    if g.chance(0.0 if g.dark else 0.4):
        material["emissiveFactor"] = g.leaf(g.reals(3, 0.0, 1.0))
        if g.chance(0.5):
            d.extensions.add("KHR_materials_emissive_strength")
            material["extensions"] = {
                "KHR_materials_emissive_strength": {"emissiveStrength": g.leaf(g.real(0.0, 50.0))}
            }
    for key in ("normalTexture", "occlusionTexture", "emissiveTexture"):
        if g.chance(0.15):
            material[key] = _texture(d)
    if g.chance(0.3):
        material |= {"alphaMode": g.leaf(g.pick("OPAQUE", "MASK", "BLEND")), "doubleSided": g.leaf(g.chance(0.5))}
        if material["alphaMode"] == "MASK":
            material["alphaCutoff"] = g.leaf(g.real(0.0, 1.0))
    return material


def _gltf_mesh(d: Document, materials: list[int]) -> dict:
    g = d.g
    primitives = []
    for k in range(g.pick(1, 1, 2)):
        vertices, faces = shape(g)
        triangles = np.array([[f[0], f[i], f[i + 1]] for f in faces for i in range(1, len(f) - 1)])
        points = np.array(vertices, dtype=np.float64)
        n = len(points)
        attributes = {"POSITION": d.accessor(points)}
        if g.chance(0.1):
            d.extensions.add("KHR_mesh_quantization")
            span = max(1e-9, np.abs(points).max())
            attributes["POSITION"] = d.accessor(np.round(points / span * 30000), 5122, normalized=True)
        if g.chance(0.5):
            normal = np.array([g.reals(3, 0.1, 1.0) for _ in range(n)]) + 0.01
            attributes["NORMAL"] = d.accessor(normal / np.linalg.norm(normal, axis=1, keepdims=True))
        for key in ("TEXCOORD_0", "TEXCOORD_1"):
            if g.chance(0.5):
                part = g.pick((5126, 1.0), (5121, 255.0), (5123, 65535.0))
                attributes[key] = d.accessor(
                    np.array([g.reals(2, 0.0, 1.0) for _ in range(n)]) * part[1], part[0], part[0] != 5126
                )
        if g.chance(0.3):
            width, part = g.pick(3, 4), g.pick((5126, 1.0), (5121, 255.0), (5123, 65535.0))
            colours = np.array([g.reals(width, 0.0, 1.0) for _ in range(n)])
            attributes["COLOR_0"] = d.accessor(colours * part[1], part[0], part[0] != 5126)
        if g.chance(0.1):
            attributes |= {"TANGENT": d.accessor(np.ones((n, 4))), "_CUSTOM": d.accessor(np.ones(n))}
        if g.chance(0.2):
            joints = d.accessor(np.zeros((n, 4)), g.pick(5121, 5123))
            attributes |= {"JOINTS_0": joints, "WEIGHTS_0": d.accessor(np.tile([1.0, 0, 0, 0], (n, 1)))}
        primitive: dict = {"attributes": attributes}
        mode = g.pick(4, 4, 5, 6, *([0, 1, 2, 3] if k else []))
        if mode != 4 or g.chance(0.5):
            primitive["mode"] = g.leaf(mode)
        if mode == 4 or g.chance(0.5):
            order = triangles.reshape(-1) if mode == 4 else np.arange(n)
            primitive["indices"] = d.accessor(
                order, g.pick(5125, *([5123] if n < 65535 else []), *([5121] if n < 255 else []))
            )
        if materials and g.chance(0.8):
            primitive["material"] = g.pick(*materials)
        if g.chance(0.1):
            primitive["targets"] = [{"POSITION": d.accessor(np.zeros((n, 3)))}]
        if g.chance(g.oddity / 2):
            primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
        primitives.append({k: v for k, v in primitive.items() if not g.chance(g.oddity / 4)})
    return {"primitives": g.leaf(primitives)} | ({"name": g.name()} if g.chance(0.5) else {})


def _gltf_nodes(d: Document, meshes: list[int]) -> list[int]:
    g = d.g
    count = g.rng.randint(len(meshes), len(meshes) + 4)
    first_skin = None
    for i in range(count):
        node: dict = {"mesh": meshes[i]} if i < len(meshes) else {}
        if g.chance(0.3):
            node["matrix"] = g.leaf([1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *g.reals(3), 1.0])
        elif g.chance(0.6):
            angle = g.real(0.0, 3.0)
            placed = {
                "translation": g.reals(3),
                "rotation": [0.0, math.sin(angle), 0.0, math.cos(angle)],
                "scale": g.reals(3, 0.6, 2.0),
            }
            node |= {k: g.leaf(v) for k, v in placed.items() if g.chance(0.6)}
        if i >= len(meshes) and g.chance(0.3):
            kind = g.pick("perspective", "perspective", "orthographic")
            lens = (
                {"yfov": g.leaf(0.8), "znear": g.leaf(0.1)}
                if kind == "perspective"
                else {"xmag": 1.0, "ymag": 1.0, "znear": 0.1, "zfar": 9.0}
            )
            node["camera"] = d.add("cameras", {"type": g.leaf(kind), kind: lens})
        if g.chance(0.3):
            d.extensions.add("KHR_lights_punctual")
            lights = d.json.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
            kind = g.pick("point", "spot", "directional")
            light: dict = {
                "type": g.leaf(kind),
                "intensity": g.leaf(g.real(0.0, 500.0)),
                "color": g.leaf(g.reals(3, 0.0, 1.0)),
            }
            if kind == "spot":
                light["spot"] = g.leaf({"innerConeAngle": g.leaf(0.2), "outerConeAngle": g.leaf(0.6)})
            lights.append({k: v for k, v in light.items() if k == "type" or g.chance(0.9)})
            node["extensions"] = {"KHR_lights_punctual": {"light": g.leaf(len(lights) - 1)}}
        if g.chance(0.1) and "mesh" in node:
            d.extensions.add("EXT_mesh_gpu_instancing")
            moves = d.accessor(np.array([g.reals(3) for _ in range(g.pick(1, 3, 50))]))
            node.setdefault("extensions", {})["EXT_mesh_gpu_instancing"] = {"attributes": {"TRANSLATION": moves}}
        if first_skin is None and g.chance(0.1) and "mesh" in node:
            inverse = d.accessor(np.tile(np.eye(4).reshape(-1), (1, 1)))
            node["skin"] = first_skin = d.add("skins", {"joints": g.leaf([count - 1]), "inverseBindMatrices": inverse})
        if g.chance(0.3):
            node["name"] = g.leaf(g.name())
        d.add("nodes", node)
    roots = []
    for i in range(count):
        if i and g.chance(0.4):
            parent = d.json["nodes"][g.rng.randrange(i)]
            parent.setdefault("children", []).append(i)
        else:
            roots.append(i)
    if g.chance(g.oddity):
        d.json["nodes"][g.rng.randrange(count)]["children"] = [g.rng.randrange(count)]
    return roots


# -- TOML -----------------------------------------------------------------------------------------


def _toml_text(g: Grammar, text: str) -> str:
    plain = all(c.isprintable() for c in text)
    if plain and "'" not in text and g.chance(0.3):
        return g.pick(f"'{text}'", f"'''{text}'''", f"'''\n{text}'''")
    body = json.dumps(text, ensure_ascii=g.chance(0.5) and text.isascii())[1:-1].replace("\x7f", "\\u007f")
    return g.pick(f'"{body}"', f'"{body}"', f'"""{body}"""', f'"""\\\n   {body}"""')


def _toml_value(g: Grammar, value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _toml_text(g, value)
    if isinstance(value, int):
        return g.pick(
            str(value), str(value), f"{value:_}", *([hex(value), oct(value), bin(value)] if value >= 0 else [])
        )
    if isinstance(value, float):
        if not math.isfinite(value):
            return g.pick("", "+") * (value > 0) + str(value)
        return g.pick(repr(value), f"{value:.6e}", f"{value:+.4f}" if abs(value) < 1e15 else repr(value))
    if isinstance(value, list):
        gap = g.pick("", " ", "\n  ", " # a comment\n")
        return (
            "["
            + gap
            + ("," + gap).join(_toml_value(g, v) for v in value)
            + (g.pick("", ",") if value else "")
            + gap
            + "]"
        )
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_toml_key(g, k)} = {_toml_value(g, v)}" for k, v in value.items()) + "}"
    return g.pick(
        "1979-05-27T07:32:00Z", "1979-05-27", "07:32:00", "2000-02-30" if g.chance(0.1) else "1979-05-27 07:32:00.5"
    )


def _toml_key(g: Grammar, key: str) -> str:
    if key and all(c in string.ascii_letters + string.digits + "_-" for c in key) and g.chance(0.9):
        return key
    return g.pick(json.dumps(key, ensure_ascii=False).replace("\x7f", "\\u007f"), json.dumps(key))


def _toml_table(g: Grammar, path: str, table: dict, many: bool = False) -> list[str]:
    """A table in one of its spellings: a header with keys, dotted keys within it, or sub-tables after it."""
    lines, later = [f"[[{path}]]" if many else f"[{path}]"], []
    for key, value in table.items():
        if isinstance(value, dict) and value and g.chance(0.7):
            if g.chance(0.5):
                later += _toml_table(g, f"{path}.{_toml_key(g, key)}", value)
            else:
                lines += [
                    f"{_toml_key(g, key)}{g.pick('.', ' . ')}{_toml_key(g, k)} = {_toml_value(g, v)}"
                    for k, v in value.items()
                ]
        else:
            written = f"{_toml_key(g, key)}{g.pick(' = ', '=')}{_toml_value(g, value)}"
            lines.append(g.pick("", "", "  ") + written + g.pick("", "", " # why"))
    return [*lines, *g.pick([], [""]), *later]


def _some(g: Grammar, must: dict, may: dict) -> dict:
    """All keys of `must`, some of `may`, in any order; seldom one is absent, misspelt or odd."""
    entries = list(must.items()) + [item for item in may.items() if g.chance(0.5)]
    g.rng.shuffle(entries)
    table = {}
    for key, value in entries:
        if g.chance(g.oddity / 4):
            continue
        table[g.pick(key + "s", key[1:], key.upper()) if g.chance(g.oddity / 4) else key] = g.leaf(value)
    if g.chance(g.oddity / 4):
        table[g.name()] = g.odd(1)
    return table


def mesh(g: Grammar, files: Files, stem: str) -> tuple[str, list[str]]:
    """Any mesh file, added to `files`: its name, and names of materials that it may have."""
    kind = g.pick("obj", "obj", "ply", "glb", "gltf")
    if kind == "obj":
        name = obj(g, files, stem)
        used = [
            line.split(None, 1)[1]
            for line in files[name].decode("utf-8", "replace").splitlines()
            if line.strip().startswith("usemtl ")
        ]
        return name, used or ["default"]
    return (ply(g, files, stem), [stem]) if kind == "ply" else (gltf(g, files, stem, kind == "glb"), ["default"])


def toml(g: Grammar, files: Files, stem: str) -> str:
    """One scene file and the meshes that it names, added to `files`; its name."""
    room, materials = mesh(g, files, "room")
    g.dark = True
    stool, _ = mesh(g, files, "stool")
    g.dark = False
    direction = g.reals(3, 0.2, 1.0)
    static = _some(
        g,
        {"mesh": g.pick(room, [room], [room, room], [room, stool])},
        {"scale": g.real(0.5, 2.0), "max_edge": g.real(0.5, 2.0)},
    )
    half = math.sqrt(0.5)
    mobiles, lights = [], []
    for i in range(g.pick(0, 1, 1, 2)):
        place = g.pick(
            {},
            {"position": g.reals(3)},
            {"axis": direction},
            {"rotation": [half, 0, half, 0]},
        )
        path = _some(
            g, {"times": [0, 1.5, 4], "positions": [g.reals(3) for _ in range(3)]}, {"spin": 90, "spin_axis": direction}
        )
        extra = (
            place
            | {"scale": g.real(0.5, 1.5), "max_edge": g.real(0.5, 1.0)}
            | ({"path": path} if g.chance(0.3) else {})
        )
        mobile = _some(g, {"name": f"stool {i}", "mesh": stool}, extra)
        mobiles.append(mobile | ({"angle": g.leaf(g.real(0.0, 90.0))} if "axis" in mobile else {}))
    for i in range(g.pick(0, 1, 1, 3)):
        colour = g.reals(3, 0.0, 50.0)
        kinds = {
            "point": {"position": g.reals(3), "flux": colour},
            "directional": {"direction": direction, "irradiance": colour},
        }
        kinds |= {
            "spot": {
                "position": g.reals(3),
                "direction": direction,
                "intensity": colour,
                "outer_degrees": g.real(10.0, 80.0),
            }
        }
        kinds |= {"sky": {"radiance": colour}}
        kind = g.pick(*kinds)
        lights.append(
            _some(
                g,
                {"type": kind} | kinds[kind],
                {"name": f"lamp {i}"} | ({"inner_degrees": 5} if kind == "spot" else {}),
            )
        )
    top = {"title": g.name(), "up": g.pick("x", "y", "z", direction), "units": g.pick("radiometric", "photometric")}
    lines = [f"{_toml_key(g, k)} = {_toml_value(g, v)}" for k, v in _some(g, {}, top).items()]
    parts = [_toml_table(g, "static", static)] + [_toml_table(g, "mobile", m, many=True) for m in mobiles]
    parts += [_toml_table(g, "light", light, many=True) for light in lights]
    if g.chance(0.4):
        name = g.pick(*materials)
        reflectance = [min(v, 0.9) for v in g.reals(3, 0.0, 0.9)]
        colours = {
            "reflectance": reflectance,
            "emission": g.reals(3, 0.0, 0.0 if mobiles else 20.0),
            "two_sided": g.chance(0.5),
        }
        parts.append(_toml_table(g, f"materials.{_toml_key(g, str(name))}", _some(g, {}, colours)))
    if g.chance(0.4):
        parts.append(
            _toml_table(
                g,
                "camera",
                _some(g, {"position": g.reals(3), "target": g.reals(3, 3.0, 4.0)}, {"fov": g.real(20.0, 90.0)}),
            )
        )
    if g.chance(0.3):
        parts.append(
            _toml_table(
                g, "probe", _some(g, {"name": "desk", "position": g.reals(3), "normal": direction}, {}), many=True
            )
        )
    if g.chance(0.3):
        settings = {
            "photons": 1000,
            "radius": 0.1,
            "neighbours": 20,
            "estimator": g.pick("tangent_plane", "photon_map", "impact_count"),
        }
        parts.append(
            _toml_table(g, "defaults", _some(g, {}, settings | {"exposure": g.real(), "scene_size": g.real(1.0, 5.0)}))
        )
    g.rng.shuffle(parts)
    if g.chance(g.oddity):
        lines += g.pick(
            ["a." * 300 + "b = 1"],
            ["a = " + "[" * 150 + "]" * 150],
            ["a = " + "{b=" * 90 + "1" + "}" * 90],
            ["a = 1", "a.b = 2"],
            ["= 1"],
        )
    text = "\n".join([*lines, *(line for part in parts for line in part)])
    files[f"{stem}.toml"] = (g.pick("", "", "# a scene\n") + text.replace("\n", g.pick("\n", "\n", "\r\n"))).encode(
        "utf-8", "surrogatepass"
    )
    return f"{stem}.toml"


def case(seed: int) -> tuple[str, Files, float]:
    """The file to open, all files beside it, and the oddity of one seed; the kinds follow each other."""
    oddity = ODDITIES[seed // len(KINDS) % len(ODDITIES)]
    g, kind, files = Grammar(seed, oddity), KINDS[seed % len(KINDS)], {}
    if kind in ("glb", "gltf"):
        return gltf(g, files, "case", kind == "glb"), files, oddity
    return {"toml": toml, "obj": obj, "ply": ply}[kind](g, files, "case"), files, oddity


def write(folder: Path, seed: int) -> Path:
    """Write the files of one seed, and what odd names lead to; the file to open."""
    folder.mkdir()
    name, files, _ = case(seed)
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "loop").symlink_to("loop")
    for file, body in files.items():
        (folder / file).write_bytes(body)
    return folder / name
