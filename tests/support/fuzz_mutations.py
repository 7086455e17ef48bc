"""Inputs of the fuzzer: small files of every format, and mutations that damage them."""

import functools
import json
import random
import re
import struct
import tempfile
from pathlib import Path

import numpy as np

from tests.support.grammar.choices import Files, Grammar
from tests.support.grammar.gltf import gltf
from tests.support.grammar.obj import obj
from tests.support.grammar.photometry import photometry
from tests.support.grammar.ply import ply
from tests.support.grammar.toml import toml
from tests.support.mesh_writers import BOX, BOX_FACES, LIBRARY
from tests.support.photometry import write_ies

NUMBERS = """0 -1 1 2 3 255 256 65535 -2147483648 4294967295 99999999999999999999 1e30 1e-30 1e308 1e999 nan inf
-inf""".split()
WORDS = "v f vn vt usemtl mtllib newmtl Kd Ke map_Kd map_Ke -s -clamp solid facet vertex property list element".split()
BYTES = [bytes.fromhex(h) for h in "00 ff 7f 00000000 ffffffff ffffff7f 0000c07f 0000807f".split()]
VALUES = [None, True, 0, -1, 1, 7, 1 << 31, 1 << 40, 1e308, -1e-308, "", "x", "data:,", "../up", [], {}, [0], [[]]]
KEYS = """mesh nodes children scale matrix rotation translation skin camera material indices mode sparse count type uri
byteOffset byteStride byteLength bufferView componentType source sampler texCoord extensions light name
normalized""".split()

WRITERS = {"toml": toml, "obj": obj, "ply": ply, "glb": functools.partial(gltf, binary=True)}
WRITERS["gltf"] = functools.partial(gltf, binary=False)
SEEDS = range(12)  # of valid files by grammar
SMALL = 20_000  # bytes of a file to damage


@functools.cache
def _written() -> tuple[dict[str, list[bytes]], Files]:
    """Return whole files by format, and by name the files that they refer to."""
    import trimesh

    files: Files = {}
    for kind, write in WRITERS.items():
        for seed in SEEDS:
            write(Grammar(seed, 0.0), files, f"{kind}{seed}")
    whole = {
        kind: [b for name, b in files.items() if name.endswith("." + kind) and len(b) < SMALL]
        for kind in (*WRITERS, "mtl")
    }
    lamps = [photometry(Grammar(seed, 0.0)) for seed in SEEDS]
    whole |= {kind: [lamp.body for lamp in lamps if lamp.name.lower().endswith(kind)] for kind in ("ies", "ldt")}
    with tempfile.TemporaryDirectory() as folder:
        tilt, table = "TILT=INCLUDE\n1\n2\n0 90\n1 0.5", np.array([[90.0, 50.0, 0.0]] * 3)
        whole["ies"].append(write_ies(Path(folder) / "a", [0, 45, 90], [0, 60, 90], table, tilt=tilt).read_bytes())
    mesh = trimesh.Trimesh(BOX, BOX_FACES, process=False)
    whole["stl"] = [mesh.export(file_type="stl"), mesh.export(file_type="stl_ascii").encode()]
    whole["mtl"].append(LIBRARY.encode())
    return whole, files


def seeds() -> dict[str, list[bytes]]:
    """Return whole files by format, to begin with."""
    return _written()[0]


def surroundings(folder: Path) -> None:
    """Write files that mutated files may refer to: meshes, libraries, images, buffers."""
    for name, body in _written()[1].items():
        (folder / name).write_bytes(body)


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
