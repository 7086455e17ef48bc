"""PLY: vertices with colours, polygons, triangle strips.

Read here and not by trimesh 5.2, which refuses binary files whose polygons differ in size, and cuts them into fans.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.file_parts import FileParts, Part, without_overlaps
from gi_core.geometry.texture_filter import srgb_to_linear
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.types import Material

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
COLOUR = ("red", "green", "blue")


class _Property(NamedTuple):
    name: str
    type: np.dtype  # of the value, or of the entries of a list
    length: np.dtype | None  # of the number of entries; None: no list


class _Element(NamedTuple):
    name: str
    count: int
    properties: list[_Property]


class _Lists(NamedTuple):
    """Lists of an element, one after the other."""

    counts: np.ndarray  # (n,) int64
    values: np.ndarray  # (sum,) int64


def read_ply(path: Path, data: bytes, where: str, boundary: Boundary) -> FileParts:
    """Read triangles and colours; a file has one material, called like the file. Raises SceneError."""
    boundary.take(where, "lines of text", data.count(b"\n"))
    try:
        order, elements, body = _header(data)
        columns = _ascii(elements, body) if order is None else _binary(elements, body)
        part = _part(elements, columns, where, boundary)
    except (LookupError, ValueError, TypeError, OverflowError) as error:
        why = f"{error} is missing" if isinstance(error, KeyError) else error
        raise SceneError(f"{where}: not a readable PLY file: {why}; export it again, as triangles") from None
    return FileParts([part], [Material(path.stem, two_sided=True)], [], None, "z", [])


def _header(data: bytes) -> tuple[str | None, list[_Element], bytes]:
    """Return the order of bytes, None for text, the elements, and what follows the header."""
    head, end, body = data.partition(b"end_header")
    lines = head.decode("ascii", "replace").split("\n")
    if not end or lines[0].strip() != "ply":
        raise ValueError("it must begin with `ply` and have a line `end_header`")
    order, elements = "", list[_Element]()
    for line in lines[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format":
            order = words[1]
        elif words[0] == "element":
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[0] == "property" and words[1] == "list":
            elements[-1].properties.append(_Property(words[4], np.dtype(TYPES[words[3]]), np.dtype(TYPES[words[2]])))
        elif words[0] == "property":
            elements[-1].properties.append(_Property(words[2], np.dtype(TYPES[words[1]]), None))
        else:
            raise ValueError(f"its header has a line {shown(line.strip())}")
    if order not in ORDERS:
        raise ValueError(f"its format must be one of {', '.join(ORDERS)}, got {shown(order)}")
    if any(e.count < 0 for e in elements):
        raise ValueError("it has an element of a negative count")
    sign = ORDERS[order]
    if sign is None:
        return None, elements, body
    for e in elements:
        e.properties[:] = [
            p._replace(type=p.type.newbyteorder(sign), length=p.length and p.length.newbyteorder(sign))
            for p in e.properties
        ]
    return order, elements, body[body.index(b"\n") + 1 :]


def _ascii(elements: list[_Element], body: bytes) -> list[dict[str, Any]]:
    words, at, result = body.split(), 0, []
    for e in elements:
        if e.count * len(e.properties) > len(words) - at:
            raise ValueError("it ends early")
        if all(p.length is None for p in e.properties):
            n = e.count * len(e.properties)
            table = np.array(words[at : at + n], np.float64).reshape(e.count, len(e.properties))
            result.append({p.name: table[:, k] for k, p in enumerate(e.properties)})
            at += n
            continue
        values: dict[str, list] = {p.name: [] for p in e.properties}
        counts: dict[str, list[int]] = {p.name: [] for p in e.properties}
        for _ in range(e.count):
            for p in e.properties:
                n = 1 if p.length is None else int(words[at])
                at += p.length is not None
                if not 0 <= n <= len(words) - at:
                    raise ValueError("it ends early")
                values[p.name] += words[at : at + n]
                counts[p.name].append(n)
                at += n
        result.append(
            {
                p.name: np.array(values[p.name], np.float64)
                if p.length is None
                else _Lists(np.array(counts[p.name], np.int64), np.array(list(map(int, values[p.name])), np.int64))
                for p in e.properties
            }
        )
    return result


def _binary(elements: list[_Element], body: bytes) -> list[dict[str, Any]]:
    at, result = 0, []
    for e in elements:
        columns, size = _even(e, body, at) or _uneven(e, body, at)
        result.append(columns)
        at += size
    return result


def _even(e: _Element, body: bytes, at: int) -> tuple[dict[str, Any], int] | None:
    """Return the columns of an element whose lists are all as long as in its first row, and their bytes; else None."""
    fields, offset = list[tuple](), at
    for p in e.properties:
        if p.length is None:
            fields.append((p.name, p.type))
            offset += p.type.itemsize
        else:
            n = int(np.frombuffer(body, p.length, 1, offset)[0]) if e.count else 0
            if n < 0 or n * p.type.itemsize > len(body) - offset:
                raise ValueError("it ends early")
            fields += [(f"{p.name} count", p.length), (p.name, p.type, (n,))]
            offset += p.length.itemsize + n * p.type.itemsize
    kind = np.dtype(fields)
    if e.count * kind.itemsize > len(body) - at:
        if all(p.length is None for p in e.properties):
            raise ValueError("it ends early")
        return None
    rows = np.frombuffer(body, kind, e.count, at) if kind.itemsize else np.zeros(e.count, kind)
    columns: dict[str, Any] = {}
    for p in e.properties:
        if p.length is None:
            columns[p.name] = rows[p.name].astype(np.float64)
            continue
        counts, values = rows[f"{p.name} count"].astype(np.int64), rows[p.name]
        if (counts != values.shape[1]).any():
            return None
        columns[p.name] = _Lists(counts, values.astype(np.int64).reshape(-1))
    return columns, e.count * kind.itemsize


def _uneven(e: _Element, body: bytes, at: int) -> tuple[dict[str, Any], int]:
    """Return the columns of an element row by row, and their bytes."""
    first, values = at, {p.name: list[np.ndarray]() for p in e.properties}
    for _ in range(e.count):
        for p in e.properties:
            n = 1
            if p.length is not None:
                n = int(np.frombuffer(body, p.length, 1, at)[0])
                at += p.length.itemsize
            if n < 0 or n * p.type.itemsize > len(body) - at:
                raise ValueError("it ends early")
            values[p.name].append(np.frombuffer(body, p.type, n, at))
            at += n * p.type.itemsize
    columns: dict[str, Any] = {}
    for p in e.properties:
        joined = np.concatenate(values[p.name]) if values[p.name] else np.zeros(0)
        counts = np.array([len(v) for v in values[p.name]], np.int64)
        columns[p.name] = joined.astype(np.float64) if p.length is None else _Lists(counts, joined.astype(np.int64))
    return columns, at - first


def _part(elements: list[_Element], columns: list[dict[str, Any]], where: str, boundary: Boundary) -> Part:
    by_name = {e.name: (e, c) for e, c in zip(elements, columns, strict=True)}
    vertex, values = by_name["vertex"]
    boundary.take(where, "vertices", vertex.count)
    vertices = np.stack([values[k] for k in "xyz"], axis=1)
    parts = []
    if "face" in by_name:
        face, columns_of = by_name["face"]
        lists = next(c for c in columns_of.values() if isinstance(c, _Lists))
        boundary.take(where, "triangles", int(np.maximum(lists.counts - 2, 0).sum()))
        faces, polygon = _fans(lists, vertices, where)
        parts.append((faces, _colours(face, columns_of)[polygon]) if _has_colours(columns_of) else (faces, None))
    if "tristrips" in by_name:
        lists = next(c for c in by_name["tristrips"][1].values() if isinstance(c, _Lists))
        boundary.take(where, "triangles", len(lists.values))
        faces = _strips(lists)
        _check(faces, vertices, where)
        parts.append((faces, None))
    if not parts:
        return Part(vertices, np.zeros((0, 3), np.int64), np.zeros(0, np.int64))
    faces = np.concatenate([f for f, _ in parts])
    colours = None
    if len(parts) == 1 and parts[0][1] is not None:
        colours = srgb_to_linear(parts[0][1])[:, None].repeat(3, axis=1)
    elif _has_colours(values) and len(faces):
        colours = srgb_to_linear(_colours(vertex, values))[faces]
    return Part(vertices, faces, np.zeros(len(faces), np.int64), None, colours)


def _fans(lists: _Lists, vertices: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles (F, 3) of polygons, and the polygon (F,) of each."""
    _check(lists.values, vertices, where)
    first, cut = np.cumsum(lists.counts) - lists.counts, np.maximum(lists.counts - 2, 0)
    polygon = np.repeat(np.arange(len(cut)), cut)
    k = np.arange(len(polygon)) - (np.cumsum(cut) - cut)[polygon]
    start = first[polygon]
    faces = lists.values[np.stack([start, start + k + 1, start + k + 2], axis=1)]
    return (without_overlaps(faces, vertices, cut[cut > 0]) if len(faces) else faces), polygon


def _strips(lists: _Lists) -> np.ndarray:
    """Return the triangles (F, 3) of strips; -1 begins a new one, every other triangle runs the other way round."""
    out = [np.zeros((0, 3), np.int64)]
    for strip in np.split(lists.values, np.cumsum(lists.counts)[:-1]):
        for run in np.split(strip, np.flatnonzero(strip < 0)):
            run = run[run >= 0]
            k = np.arange(max(len(run) - 2, 0))
            out.append(np.stack([run[k], run[k + 1 + k % 2], run[k + 2 - k % 2]], axis=1))
    return np.concatenate(out)


def _check(named: np.ndarray, vertices: np.ndarray, where: str) -> None:
    if named.size and not (0 <= named.min() and named.max() < len(vertices)):
        raise SceneError(
            f"{where}: faces must name vertices 0 to {len(vertices) - 1}, got {named.min()} to {named.max()}"
        )


def _has_colours(columns: dict[str, Any]) -> bool:
    return all(k in columns for k in COLOUR)


def _colours(e: _Element, columns: dict[str, Any]) -> np.ndarray:
    """Return sRGB colours (n, 3) from 0 to 1."""
    kind = next(p.type for p in e.properties if p.name == "red")
    most = 1.0 if kind.kind == "f" else float(np.iinfo(kind).max)
    return np.clip(np.stack([columns[k] for k in COLOUR], axis=1) / most, 0.0, 1.0)
