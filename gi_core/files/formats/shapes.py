"""Tables [[shape]] of scene files: solids by type and size, made into meshes with exact normals.

A generator makes parts in a frame whose axes lead right, up and to the front, standing on the origin. A new type is one
generator and one line of SHAPES.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from gi_core.base.vectors import cross, length
from gi_core.files.formats.file_parts import clipped
from gi_core.files.formats.toml_fields import Schema, Table
from gi_core.geometry.mesh_parts import compact, join
from gi_core.scene.errors import SceneError, named, nearest
from gi_core.scene.pose import to_world, to_world_directions
from gi_core.scene.rules import LENGTH, LEVEL, NAME, TINIEST, Rule, is_array, numbers, vector, word
from gi_core.scene.types import Material, Mesh, Pose

ROUND = 32  # edges round a circle at least: its area is 0.6 % too small
SAME = 1e-9  # of a side: cuts nearer to each other are one
# Right, up and front as columns, if the axis of coordinates nearest to the scene's `up` is x, y or z.
FRAMES = np.array(
    [[[0, 1, 0], [1, 0, 0], [0, 0, -1]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[1, 0, 0], [0, 0, -1], [0, 1, 0]]]
)
SIDES = ("left", "right", "floor", "ceiling", "back", "front")  # of a room: low and high along right, up, front


class Part(NamedTuple):
    """Faces of one side."""

    vertices: np.ndarray  # (V, 3) [m]
    faces: np.ndarray  # (F, 3)
    normals: np.ndarray  # (F, 3, 3) unit, at corners
    side: str = ""  # of a room


class Shape(NamedTuple):
    """A table [[shape]], checked."""

    name: str
    where: str
    type: str
    values: dict[str, Any]  # by key of its type; sizes along x, y, z
    up: int  # axis of coordinates that it stands along
    material: str | None  # None: plain, named after the shape
    max_edge: float | None  # [m]
    pose: Pose = Pose()  # in the static part


# Flat sides -----------------------------------------------------------------------------------------


def _flat(vertices: np.ndarray, faces: np.ndarray, side: str = "") -> Part:
    p = vertices[faces]
    n = cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return Part(vertices, faces, np.repeat((n / length(n)[:, None])[:, None], 3, axis=1), side)


def _steps(span: float, step: float) -> int:
    """Return the number of equal parts of a length, each up to `step` [m]."""
    # Longer edges that remain are split, or refused, as those of any mesh.
    return int(min(max(np.ceil(span / step - SAME), 1), 500))


def _cuts(stops: Sequence[float], step: float) -> np.ndarray:
    """Return increasing coordinates: the stops, and places between them at distances up to `step` [m]."""
    stops = np.unique(stops)
    stops = stops[np.append(True, np.diff(stops) > SAME * (stops[-1] - stops[0]))]
    between = [np.linspace(a, b, _steps(b - a, step), endpoint=False) for a, b in zip(stops, stops[1:], strict=False)]
    return np.concatenate([*between, stops[-1:]])


def _grid(n: int, m: int) -> np.ndarray:
    """Return the triangles (F, 3) of n x m vertices, two by two; they face along first x second direction."""
    a = (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).reshape(-1)
    b, c, d = a + m, a + m + 1, a + 1
    return np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)


def _sheet(cuts, axis: int, at: float, facing: int, side: str = "", holes: Sequence[np.ndarray] = ()) -> Part:
    """Return the rectangle between cuts that is perpendicular to an axis, without holes (2, 3) [m].

    facing: 1 or -1, along the axis or against it.
    """
    i, j = (axis + 1) % 3, (axis + 2) % 3
    u, v = cuts[i], cuts[j]
    vertices = np.empty((len(u), len(v), 3))
    vertices[..., axis], vertices[..., i], vertices[..., j] = at, u[:, None], v
    middle = (vertices[1:, 1:] + vertices[:-1, :-1]) / 2
    whole = np.ones(middle.shape[:2], bool)
    for low, high in holes:
        whole &= ~((middle > low) & (middle < high))[..., [i, j]].all(axis=2)
    faces = _grid(len(u), len(v))[np.repeat(whole.reshape(-1), 2)]
    return _flat(vertices.reshape(-1, 3), faces if facing > 0 else faces[:, ::-1], side)


def _plane(step: float, size) -> list[Part]:
    cuts = [_cuts(ends, step) for ends in _corners(size).T]
    return [_sheet(cuts, 1, 0.0, 1)]


def _corners(size) -> np.ndarray:
    """Return the corners low and high (2, 3) of a box that stands on the origin."""
    return np.array([[-size[0] / 2, 0.0, -size[2] / 2], [size[0] / 2, size[1], size[2] / 2]])


def _box(step: float, size) -> list[Part]:
    ends = _corners(size)
    cuts = [_cuts(ends[:, k], step) for k in range(3)]
    return [_sheet(cuts, k, ends[end, k], 2 * end - 1) for k in range(3) for end in (0, 1)]


def _room(step: float, size, thickness: float, openings: list[tuple[str, np.ndarray]]) -> list[Part]:
    """Return a box seen from inside, with openings, and their reveals where walls have a thickness."""
    ends, parts = _corners(size), []
    openings = [(side, _within(side, hole, ends)) for side, hole in openings]
    # All sides share their cuts, so that no corner lies within an edge.
    cuts = [_cuts(np.concatenate([ends, *(hole for _, hole in openings)])[:, k], step) for k in range(3)]
    for number, side in enumerate(SIDES):
        axis, end = divmod(number, 2)
        at, i, j = ends[end, axis], (axis + 1) % 3, (axis + 2) % 3
        holes = [hole for name, hole in openings if name == side]
        for k, (low, high) in enumerate(holes):
            if any((low < b - SAME)[[i, j]].all() and (a < high - SAME)[[i, j]].all() for a, b in holes[:k]):
                raise SceneError(f"openings of the {side} overlap; move one, or write one larger opening")
        parts.append(_sheet(cuts, axis, at, 1 - 2 * end, side, holes))
        for low, high in holes if thickness else ():
            reveal = [c[(c >= a - SAME) & (c <= b + SAME)] for c, a, b in zip(cuts, low, high, strict=True)]
            reveal[axis] = _cuts((at, at + (2 * end - 1) * thickness), step)
            parts += [_sheet(reveal, m, reveal[m][-k], 1 - 2 * k, side) for m in (i, j) for k in (0, 1)]
    return parts


def _within(side: str, hole: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return an opening (2, 3) in the plane of its side. Raises SceneError if it leaves that side."""
    axis, end = divmod(SIDES.index(side), 2)
    hole[:, axis] = ends[end, axis]
    if (np.maximum(ends[0] - hole[0], hole[1] - ends[1]) > SAME * (ends[1] - ends[0])).any():
        raise SceneError(f"an opening must lie within its wall, got one that leaves the {side}; move it")
    return hole


# Round sides ----------------------------------------------------------------------------------------


def _around(turns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cosine and sine of shares of a circle, alike on all platforms."""
    return np.round(np.cos(2 * np.pi * turns), 12), np.round(np.sin(2 * np.pi * turns), 12)


def _edges_of(radius: float, step: float) -> int:
    """Return the number of edges round a circle, each up to `step` [m], four times a whole one; 0: a point."""
    return max(4 * _steps(np.pi * radius / 2, step), ROUND) if radius else 0


def _turned(profile: np.ndarray, edges: np.ndarray) -> Part:
    """Return a profile turned about the vertical; its rows (k, 4) [m], from below: radius, height, normal out and up.

    edges (k,): of the circle of a row, 6 or more; a point has none. The front is outside where the profile rises.
    """
    counts = np.where(profile[:, 0] > 0, np.maximum(np.ceil(edges - SAME), 6), 1).astype(int)
    circles = [_around(np.arange(n) / n) for n in counts]
    rows = [(r * c, np.full(len(c), h), -r * s) for (r, h, *_), (c, s) in zip(profile, circles, strict=True)]
    first = np.cumsum([0, *counts])
    faces, normals = [], []
    for i, (n, m) in enumerate(zip(counts, counts[1:], strict=False)):
        j, k = np.arange(n * (n > 1)), np.arange(m * (m > 1))
        # Edges of both circles in the order of their middles: each forms a triangle with the other circle's corner.
        above = np.searchsorted((2 * np.arange(m) + 1) * n, (2 * j + 1) * m)
        below = np.searchsorted((2 * np.arange(n) + 1) * m, (2 * k + 1) * n, side="right")
        low = np.stack([j, j + 1, above], axis=1), np.array([n, n, m]), np.array([0, 0, 1])
        high = np.stack([below, k + 1, k], axis=1), np.array([n, m, m]), np.array([0, 1, 1])
        for corner, count, row in (low, high):
            turn = corner / count
            pole = count == 1  # its normal leans as the triangle does
            turn[:, pole] = turn[:, ~pole].mean(axis=1, keepdims=True)
            out, up = profile[i + row, 2], profile[i + row, 3]
            c, s = _around(turn)
            normals.append(np.stack([out * c, np.broadcast_to(up, c.shape), -out * s], axis=2))
            faces.append(first[i + row] + corner % count)
    vertices = np.concatenate([np.stack(row, axis=1) for row in rows])
    return Part(vertices, np.concatenate(faces), np.concatenate(normals))


def _sphere(step: float, radius: float) -> list[Part]:
    edges = _edges_of(radius, step)
    c, s = _around(np.linspace(0, 0.5, edges // 2 + 1))
    return [_turned(np.stack([radius * s, radius - radius * c, s, -c], axis=1), edges * s)]


def _cone(step: float, radius: float, height: float, top: float = 0.0) -> list[Part]:
    """Return a cone, or a part of one with a disc on top."""
    slant = float(np.hypot(radius - top, height))
    normal = [height / slant, (radius - top) / slant]
    corners = (
        ((0, 0), (radius, 0), (0, -1)),
        ((radius, 0), (top, height), normal),
        ((top, height), (0, height), (0, 1)),
    )
    parts = []
    for a, b, n in corners if top else corners[:2]:
        share = np.linspace(0, 1, _steps(float(np.hypot(*np.subtract(b, a))), step) + 1)
        profile = np.outer(1 - share, a) + np.outer(share, b)
        edges = (1 - share) * _edges_of(a[0], step) + share * _edges_of(b[0], step)
        parts.append(_turned(np.concatenate([profile, np.broadcast_to(n, profile.shape)], axis=1), edges))
    return parts


def _cylinder(step: float, radius: float, height: float) -> list[Part]:
    return _cone(step, radius, height, radius)


# Outlines -------------------------------------------------------------------------------------------


def _arch(step: float, size, thickness: float) -> list[Part]:
    """Return a band along two legs and a half circle."""
    (width, height, depth), radius = size, size[0] / 2
    if not (height >= radius and SAME * radius < thickness < radius):
        raise SceneError(
            f"an arch must be at least half as high as wide, with a thickness below half its width, "
            f"got {width:g} x {height:g} m and {thickness:g} m"
        )
    leg = _cuts((0.0, height - radius), step) if height > radius else np.zeros(1)
    c, s = _around(np.linspace(0.5, 0, _edges_of(radius, step) // 2 + 1))
    legs = np.ones(len(leg) - 1), 0 * leg[1:]
    normals = np.stack([np.concatenate([-legs[0], c, legs[0]]), np.concatenate([legs[1], s, legs[1]])], axis=1)
    bottom = np.concatenate([leg[:-1], np.full(len(c), leg[-1]), leg[-2::-1]])
    outer = radius * normals + np.stack([0 * bottom, bottom], axis=1)
    inner = outer - thickness * normals
    # Round the band: outside to the back, across the back, inside to the front, across the front.
    loop = [(outer, depth / 2), (outer, -depth / 2), (inner, -depth / 2), (inner, depth / 2), (outer, depth / 2)]
    points = np.stack([np.concatenate([p, np.full((len(p), 1), z)], axis=1) for p, z in loop], axis=1)
    out = np.concatenate([normals, np.zeros((len(normals), 1))], axis=1)
    parts = [_flat(points[k, :4], np.array([[0, 1, 2], [0, 2, 3]])[:, :: 1 if k == 0 else -1]) for k in (0, -1)]
    for k, normal in enumerate((out, [[0, 0, -1.0]], -out, [[0, 0, 1.0]])):
        faces = _grid(len(points), 2)
        n = np.repeat(np.broadcast_to(normal, out.shape), 2, axis=0)
        parts.append(Part(points[:, k : k + 2].reshape(-1, 3), faces, n[faces]))
    return parts


def _extrusion(step: float, outline: np.ndarray, height: float) -> list[Part]:
    """Return an outline (n, 3) on the ground, raised; repeated corners are left out."""
    outline = outline[(outline != np.roll(outline, -1, axis=0)).any(axis=1)]
    area = cross(outline, np.roll(outline, -1, axis=0))[:, 1].sum() / 2  # > 0: counter-clockwise seen from above
    outline = outline if area > 0 else outline[::-1]
    n, up = len(outline), np.array([0.0, height, 0.0])
    top = clipped(outline, np.array([0.0, 1.0, 0.0])) if n > 2 else np.zeros((0, 3), int)
    p = outline[top]
    covered = length(cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])).sum() / 2
    if len(top) != n - 2 or not abs(covered - abs(area)) < 1e-6 * covered:
        raise SceneError("outline must enclose an area and not cross itself; list its corners in order")
    vertices = np.stack([np.append(outline, outline[:1], axis=0), np.append(outline, outline[:1], axis=0) + up], axis=1)
    return [_flat(outline, top[:, ::-1]), _flat(outline + up, top), _flat(vertices.reshape(-1, 3), _grid(n + 1, 2))]


# Tables ---------------------------------------------------------------------------------------------

SIZE, AREA = (vector(f"{n} numbers > 0", lambda v, n=n: is_array(v, (n,), TINIEST), n) for n in (3, 2))
OUTLINE = Rule(
    "a list of three or more pairs of numbers",
    lambda values: is_array(values, (None, 2)) and len(values) > 2,
    example="[[0, 0], [1, 0], [0, 1]]",
)
SHAPES: dict[str, tuple[Callable[..., list[Part]], Schema]] = {  # by type: generator and keys
    "room": (_room, {"size": SIZE, "thickness": LEVEL}),
    "box": (_box, {"size": SIZE}),
    "sphere": (_sphere, {"radius": LENGTH}),
    "cylinder": (_cylinder, {"radius": LENGTH, "height": LENGTH}),
    "cone": (_cone, {"radius": LENGTH, "height": LENGTH, "top": LEVEL}),
    "plane": (_plane, {"size": AREA}),
    "arch": (_arch, {"size": SIZE, "thickness": LENGTH}),
    "extrusion": (_extrusion, {"outline": OUTLINE, "height": LENGTH}),
}
OF_ROOM = ("openings", "materials")
COMMON = {"name": NAME, "material": NAME, "max_edge": LENGTH}
LEFT_OUT = {**dict.fromkeys((*COMMON, *SIDES)), "thickness": 0.0, "top": 0.0}  # values of keys that may be missing
OPENING = {"wall": word(SIDES), "position": numbers(2), "size": AREA}


def read_shape(values: dict, where: str, number: int, up: int, more: Sequence[str] = ()) -> Shape:
    """Return the shape of a table [[shape]], its place aside; number: among shapes, from 1. Raises SceneError.

    up: 0, 1, 2, axis of coordinates that it stands along; more: keys that are not the shape's.
    """
    kind = Table(values, where, None).value("type", word(tuple(SHAPES)))
    keys = SHAPES[kind][1]
    own = OF_ROOM if kind == "room" else ()
    t = Table(values, where, COMMON | keys, ("type", *own, *more))
    fields = t.fields(LEFT_OUT)
    name, material, max_edge = (fields.pop(key) for key in COMMON)
    if kind == "room":
        entries = enumerate(t.tables("openings", "wall opening"), 1)
        fields["openings"] = [Table(v, f"{where}: opening {k}", OPENING).fields({}) for k, v in entries]
        fields["materials"] = t.section("materials", dict.fromkeys(SIDES, NAME)).fields(LEFT_OUT)
    return Shape(name or f"{kind} {number}", where, kind, fields, up, material, max_edge)


def shape_mesh(shape: Shape, max_edge: float, tabled: Collection[str]) -> tuple[Mesh, list[Material]]:
    """Return the mesh of a shape at its pose, its round sides with edges up to max_edge [m], and its materials.

    tabled: names of [materials.NAME]. Raises SceneError for values that make no such shape.
    """
    fields, frame, up = dict(shape.values), FRAMES[shape.up], shape.up
    ground = [k for k in range(3) if k != up]
    if "size" in fields:
        size = fields["size"]
        size = np.insert(size, up, 0.0) if len(size) == 2 else np.array(size)
        fields["size"] = np.abs(size @ frame)
    if "outline" in fields:
        fields["outline"] = _placed(fields["outline"], ground) @ frame
    sides = fields.pop("materials", {})
    if shape.type == "room":
        fields["openings"] = [_hole(entry, frame, [*ground, up]) for entry in fields["openings"]]
    # A triangle of a grid has two sides of a step.
    with named(shape.where):
        parts = SHAPES[shape.type][0](max_edge / np.sqrt(2), **fields)
    names = [sides.get(part.side) or shape.material or shape.name for part in parts]
    for name in (*sides.values(), shape.material):
        if name is not None and name not in tabled:
            remedy = nearest(name, tabled) if tabled else f"write [materials.{name}]"
            raise SceneError(f'{shape.where}: there is no material "{name}"; {remedy}')
    materials = [Material(name) for name in dict.fromkeys(names)]
    of_name = {m.name: k for k, m in enumerate(materials)}
    meshes = []
    for part, name in zip(parts, names, strict=True):
        vertices = to_world(shape.pose, part.vertices @ frame.T + 0.0)
        normals = to_world_directions(shape.pose, part.normals.reshape(-1, 3) @ frame.T).reshape(part.normals.shape)
        faces = part.faces.astype(np.int32)
        meshes.append(Mesh(vertices, faces, np.full(len(faces), of_name[name], np.int32), normals))
    return compact(join(meshes, materials)), materials


def _placed(pairs, axes: Sequence[int]) -> np.ndarray:
    """Return points (n, 3) with pairs of numbers at two axes of coordinates, 0 at the third."""
    points = np.zeros((len(pairs), 3))
    points[:, axes] = pairs
    return points


def _hole(entry: dict[str, Any], frame: np.ndarray, order: Sequence[int]) -> tuple[str, np.ndarray]:
    """Return the side of an opening, and its corners low and high (2, 3) there; 0 across the wall.

    order: axes of coordinates, the vertical one last.
    """
    across = int(np.argmax(np.abs(frame[:, SIDES.index(entry["wall"]) // 2])))
    position = np.array(entry["position"])
    corners = _placed([position, position + entry["size"]], [k for k in order if k != across]) @ frame
    return entry["wall"], np.sort(corners, axis=0)
