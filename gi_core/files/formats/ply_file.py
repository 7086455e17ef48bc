"""PLY: vertices with colours, and polygons.

Read here and not by trimesh 5.2, which refuses binary files whose polygons differ in size, and cuts them into fans.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.file_parts import FileParts, without_overlaps
from gi_core.geometry.mesh_parts import untextured
from gi_core.geometry.texture_filter import srgb_to_linear
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.types import Material, Mesh

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
COLOUR = ("red", "green", "blue")


class _Property(NamedTuple):
    name: str
    declared: np.dtype  # of the value, or of the entries of a list
    type: np.dtype  # the same, as it is stored: a text is stored as float64
    length: np.dtype | None  # of the number of entries; None: no list


class _Element(NamedTuple):
    name: str
    count: int
    properties: list[_Property]


class _Lists(NamedTuple):
    """Lists of an element, one after the other."""

    counts: np.ndarray  # (n,) int64
    values: np.ndarray  # (sum,)


def read_ply(path: Path, data: bytes, where: str, boundary: Boundary) -> FileParts:
    """Read triangles and colours; a file has one material, called like the file. Raises SceneError."""
    boundary.take(where, "lines of text", data.count(b"\n"))
    try:
        elements, body = _header(data)
        columns, at = list[dict[str, Any]](), 0
        for e in elements:
            boundary.take(where, "vertices", e.count)
            read, at = _columns(e, body, at)
            columns.append(read)
        part = _part(elements, columns, where, boundary)
    except (LookupError, ValueError, TypeError, OverflowError) as error:
        why = f"{error} is missing" if isinstance(error, KeyError) else error
        raise SceneError(f"{where}: not a readable PLY file: {why}; export it again, as triangles") from None
    return FileParts([part], [Material(path.stem, two_sided=True)], [], None, "z", [])


def _header(data: bytes) -> tuple[list[_Element], bytes]:
    """Return the elements, and the data after the header; numbers of a text as float64."""
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
        elif words[0] == "property":
            *length, kind, name = words[2:5] if words[1] == "list" else words[1:3]
            types = [np.dtype(TYPES[k]) for k in (kind, kind, *length)]
            elements[-1].properties.append(_Property(name, types[0], types[1], types[2] if length else None))
        else:
            raise ValueError(f"its header has a line {shown(line.strip())}")
    if order not in ORDERS:
        raise ValueError(f"its format must be one of {', '.join(ORDERS)}, got {shown(order)}")
    if any(e.count < 0 for e in elements):
        raise ValueError("it has an element of a negative count")
    sign = ORDERS[order]

    def stored(kind: np.dtype) -> np.dtype:
        return np.dtype(np.float64) if sign is None else kind.newbyteorder(sign)

    for e in elements:
        e.properties[:] = [p._replace(type=stored(p.type), length=p.length and stored(p.length)) for p in e.properties]
    if sign is None:
        return elements, np.array(body.split(), np.float64).tobytes()
    return elements, body[body.index(b"\n") + 1 :]


def _columns(e: _Element, body: bytes, at: int) -> tuple[dict[str, Any], int]:
    """Return the columns of an element, and where it ends; rows of lists of equal lengths are read at once."""
    parts, left, most = list[np.ndarray](), e.count, e.count if all(p.length is None for p in e.properties) else 64
    while left:
        row, counts = _row(e, body, at)
        rows = _values(body, row, min(left, most, max((len(body) - at) // max(row.itemsize, 1), 1)), at)
        alike = np.ones(len(rows), bool)
        for name, count in counts.items():
            alike &= np.trunc(rows[f"{name} count"]) == count
        n = len(rows) if alike.all() else int(alike.argmin())
        parts.append(rows[:n])
        at, left, most = at + n * row.itemsize, left - n, 2 * most if n == len(rows) else 64
    columns: dict[str, Any] = {}
    for p in e.properties:
        values = np.concatenate([rows[p.name].reshape(-1) for rows in parts] or [np.zeros(0)])
        if p.length is not None:
            counts = np.repeat([rows[p.name].shape[1] for rows in parts], [len(rows) for rows in parts])
            columns[p.name] = _Lists(counts.astype(np.int64), values)
        else:
            columns[p.name] = values.astype(np.float64)
    return columns, at


def _row(e: _Element, body: bytes, at: int) -> tuple[np.dtype, dict[str, int]]:
    """Return the type of an element's row at a place, and the lengths of its lists by name."""
    fields, counts = list[tuple](), dict[str, int]()
    for p in e.properties:
        if p.length is None:
            fields.append((p.name, p.type))
            at += p.type.itemsize
        else:
            counts[p.name] = n = int(_values(body, p.length, 1, at)[0])
            fields += [(f"{p.name} count", p.length), (p.name, p.type, (n,))]
            at += p.length.itemsize + len(_values(body, p.type, n, at + p.length.itemsize)) * p.type.itemsize
    return np.dtype(fields), counts


def _values(body: bytes, kind: np.dtype, count: int, at: int) -> np.ndarray:
    if not 0 <= count * kind.itemsize <= len(body) - at:
        raise ValueError("it ends early")
    return np.frombuffer(body, kind, count, at) if kind.itemsize else np.zeros(count, kind)


def _part(elements: list[_Element], columns: list[dict[str, Any]], where: str, boundary: Boundary) -> Mesh:
    by_name = {e.name: (e, c) for e, c in zip(elements, columns, strict=True)}
    if "tristrips" in by_name:
        raise ValueError("it holds triangle strips")
    vertex, values = by_name["vertex"]
    vertices = np.stack([values[k] for k in "xyz"], axis=1)
    face, of_faces = by_name.get("face") or (vertex, {})
    lists = next((c for c in of_faces.values() if isinstance(c, _Lists)), None)
    if lists is None:
        return Mesh(vertices, np.zeros((0, 3), np.int64), np.zeros(0, np.int64))
    boundary.take(where, "triangles", int(np.maximum(lists.counts - 2, 0).sum()))
    faces, polygon = _fans(lists, vertices, where)
    paint = None
    if all(k in of_faces for k in COLOUR):
        paint = untextured(srgb_to_linear(_colours(face, of_faces)[polygon])[:, None].repeat(3, axis=1))
    elif all(k in values for k in COLOUR):
        paint = untextured(srgb_to_linear(_colours(vertex, values))[faces])
    return Mesh(vertices, faces, np.zeros(len(faces), np.int64), paint=paint)


def _fans(lists: _Lists, vertices: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles (F, 3) of polygons, and the polygon (F,) of each."""
    named = lists.values.astype(np.int64)
    if (named != lists.values).any() or (named.size and not 0 <= named.min() <= named.max() < len(vertices)):
        raise SceneError(
            f"{where}: faces must name vertices 0 to {len(vertices) - 1}, "
            f"got {lists.values.min():.10g} to {lists.values.max():.10g}"
        )
    first, cut = np.cumsum(lists.counts) - lists.counts, np.maximum(lists.counts - 2, 0)
    polygon = np.repeat(np.arange(len(cut)), cut)
    k = np.arange(len(polygon)) - (np.cumsum(cut) - cut)[polygon]
    start = first[polygon]
    faces = named[np.stack([start, start + k + 1, start + k + 2], axis=1)]
    return (without_overlaps(faces, vertices, cut[cut > 0]) if len(faces) else faces), polygon


def _colours(e: _Element, columns: dict[str, Any]) -> np.ndarray:
    """Return sRGB colours (n, 3) from 0 to 1."""
    kind = next(p.declared for p in e.properties if p.name == "red")
    most = 1.0 if kind.kind == "f" else float(np.iinfo(kind).max)
    return np.clip(np.stack([columns[k] for k in COLOUR], axis=1) / most, 0.0, 1.0)
