"""Shapes for the generators: walls, boxes sharp and round, cushions; how they are placed, textured and joined.

Every shape has texture coordinates in metres (rounded boxes, sheets, boxes) or once round (turned bodies,
tubes), so that one texture scale suits a whole piece of furniture. y is up. Shapes without normals get
them from crease angles when they are loaded; rounded boxes bring exact ones, so that their flats stay flat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scenes.glb import Part

DECIMALS = 6  # micrometres: the same float32 whatever the platform's sine
FINE = 0.13  # [m] longest side of the cells of boxes: their diagonals stay below a max_edge of 0.19 (of strips cut
# lengthwise by max_edge itself three quarters would be wasted: it trebles them with every halving)
X, Y, Z = np.eye(3)


class Shape(NamedTuple):
    """Triangles that share a material."""

    vertices: np.ndarray  # (V, 3) [m]
    faces: np.ndarray  # (F, 3)
    uv: np.ndarray  # (V, 2)
    normals: np.ndarray | None = None  # (V, 3) unit

    def at(self, x: float, y: float, z: float) -> Shape:
        """Return the shape moved."""
        return self._replace(vertices=self.vertices + np.array([x, y, z], float))

    def turned(self, degrees: float, axis=Y) -> Shape:
        """Return the shape turned about an axis through the origin, counter-clockwise seen against it."""
        R = rotation(degrees, axis)
        normals = None if self.normals is None else self.normals @ R.T
        return self._replace(vertices=self.vertices @ R.T, normals=normals)

    def flipped(self) -> Shape:
        """Return the shape with fronts and backs exchanged."""
        return self._replace(faces=self.faces[:, ::-1], normals=None if self.normals is None else -self.normals)

    def painted(self, u0: float, v0: float, u1: float, v1: float) -> Shape:
        """Return the shape with its texture coordinates stretched over a part of the image."""
        low, high = self.uv.min(axis=0), self.uv.max(axis=0)
        share = (self.uv - low) / np.where(high > low, high - low, 1)
        return self._replace(uv=np.array([u0, v0]) + share * np.array([u1 - u0, v1 - v0]))

    def tiled(self, width: float, height: float) -> Shape:
        """Return the shape with the image repeated every width x height [m]."""
        return self._replace(uv=self.uv / np.array([width, height]))

    def tinted(self, u: float, v: float) -> Shape:
        """Return the shape with one point of the image all over: a plain colour out of a palette."""
        return self._replace(uv=np.tile([u, v], (len(self.vertices), 1)))


def part(material: str, *shapes: Shape) -> Part:
    """Return shapes as one part of a mesh file; they must agree on having normals."""
    shape = joined(*shapes)
    normals = None if shape.normals is None else np.round(shape.normals, DECIMALS)
    return Part(material, np.round(shape.vertices, DECIMALS), shape.faces, normals, np.round(shape.uv, DECIMALS))


def radiance(flux: np.ndarray, parts: list[Part], material: str) -> np.ndarray:
    """Return the radiance [W/m2/sr] at which all faces of a material together give a flux [W]: Phi = pi L A."""
    area = 0.0
    for p in parts:
        if p.material == material:
            corner = p.vertices[p.faces]
            cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            area += float(np.sqrt((cross * cross).sum(axis=1)).sum()) / 2
    return np.round(flux / (np.pi * area), 4)


def joined(*shapes: Shape) -> Shape:
    """Return several shapes as one."""
    first = np.cumsum([0, *(len(s.vertices) for s in shapes)])
    bare = [s.normals is None for s in shapes]
    if any(bare) and not all(bare):
        raise ValueError("shapes with and without normals cannot be joined; make two parts of them")
    return Shape(
        np.concatenate([s.vertices for s in shapes]),
        np.concatenate([s.faces + o for s, o in zip(shapes, first, strict=False)]),
        np.concatenate([s.uv for s in shapes]),
        None if any(bare) else np.concatenate([s.normals for s in shapes]),
    )


def rotation(degrees: float, axis=Y) -> np.ndarray:
    """Return the matrix (3, 3) of a turn (Rodrigues)."""
    a = np.asarray(axis, float) / np.sqrt(np.dot(axis, axis))
    K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    t = np.radians(degrees)
    return np.eye(3) + np.sin(t) * K + (1 - np.cos(t)) * (K @ K)


def sheet(corner, along, across, cells=(1, 1)) -> Shape:
    """Return a rectangle from a corner, seen from the side of along x across; uv in metres."""
    corner, along, across = (np.asarray(v, float) for v in (corner, along, across))
    s, t = np.meshgrid(np.linspace(0, 1, cells[0] + 1), np.linspace(0, 1, cells[1] + 1), indexing="ij")
    s, t = s.reshape(-1, 1), t.reshape(-1, 1)
    n = np.cross(along, across)
    n = np.tile(n / np.sqrt(n @ n), (len(s), 1))
    uv = np.concatenate([s * np.sqrt(along @ along), t * np.sqrt(across @ across)], axis=1)
    return Shape(corner + s * along + t * across, grid_faces(cells[0] + 1, cells[1] + 1), uv, n)


def wall(corner, along, across, cell: float, hole=None) -> Shape:
    """Return a rectangle as sheet() in cells of at most `cell` [m].

    hole: (low, high), corners of a rectangle to be left out, [m] along and across from the corner.
    """
    corner, along, across = (np.asarray(v, float) for v in (corner, along, across))
    long, wide = np.sqrt(along @ along), np.sqrt(across @ across)
    u, v = (
        ([0, long], [0, wide])
        if hole is None
        else ([0, hole[0][0], hole[1][0], long], [0, hole[0][1], hole[1][1], wide])
    )
    pieces = []
    for i in range(len(u) - 1):
        for j in range(len(v) - 1):
            if hole is not None and (i, j) == (1, 1):
                continue
            du, dv = u[i + 1] - u[i], v[j + 1] - v[j]
            cells = (int(np.ceil(du / cell - 0.01)), int(np.ceil(dv / cell - 0.01)))
            first = corner + u[i] / long * along + v[j] / wide * across
            piece = sheet(first, du / long * along, dv / wide * across, cells)
            pieces.append(piece._replace(uv=piece.uv + [u[i], v[j]]))
    return joined(*pieces)


def box(size, open_sides: str = "", cell: float = FINE) -> Shape:
    """Return a box with sharp edges standing on y = 0, in cells of at most `cell` [m].

    open_sides: those left out, as in "-y+z".
    """
    w, h, d = (float(s) for s in size)
    sides = {
        "-x": ((-w / 2, 0, -d / 2), (0, 0, d), (0, h, 0)),
        "+x": ((w / 2, 0, d / 2), (0, 0, -d), (0, h, 0)),
        "-z": ((w / 2, 0, -d / 2), (-w, 0, 0), (0, h, 0)),
        "+z": ((-w / 2, 0, d / 2), (w, 0, 0), (0, h, 0)),
        "-y": ((-w / 2, 0, -d / 2), (w, 0, 0), (0, 0, d)),
        "+y": ((-w / 2, h, d / 2), (w, 0, 0), (0, 0, -d)),
    }
    return joined(*(wall(*sides[k], cell) for k in sides if k not in open_sides))


def rounded_box(size, radius: float, steps: int = 1) -> Shape:
    """Return a box with round edges standing on y = 0; a quarter round has 2 `steps` facets."""
    half = np.asarray(size, float) / 2
    inner = half - radius
    if (inner < 0).any():
        raise ValueError(f"a box of {tuple(size)} cannot have edges rounded by {radius}")
    bend = np.tan(np.radians(45 * np.arange(steps + 1) / steps))
    rows = []  # along each axis: how far the normal leans, and where the rounding's centre is
    for k in range(3):
        flat = np.linspace(-inner[k], inner[k], int(np.ceil(2 * inner[k] / FINE - 0.01)) + 1)[1:-1]
        lean = np.concatenate([-bend[::-1], 0 * flat, bend])
        rows.append((lean, np.concatenate([np.full(steps + 1, -inner[k]), flat, np.full(steps + 1, inner[k])])))
    pieces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            n, m = len(rows[i][0]), len(rows[j][0])
            a, b = (k.reshape(-1) for k in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
            normals, centre = np.zeros((n * m, 3)), np.zeros((n * m, 3))
            normals[:, i], normals[:, j], normals[:, axis] = rows[i][0][a], rows[j][0][b], sign
            centre[:, i], centre[:, j], centre[:, axis] = rows[i][1][a], rows[j][1][b], inner[axis] * sign
            normals /= np.sqrt((normals * normals).sum(axis=1))[:, None]
            vertices = centre + radius * normals
            faces = grid_faces(n, m)
            # Wood grain and weave run along the longer side of each face.
            flat = vertices[:, [i, j]] if half[i] >= half[j] else vertices[:, [j, i]]
            pieces.append(Shape(vertices, faces if sign > 0 else faces[:, ::-1], flat, normals))
    shape = joined(*pieces)
    return without_lines(shape).at(0, half[1], 0)


def cushion(size, swell: float, cells: int = 8) -> Shape:
    """Return a pillow lying at y = 0: two square sheets that meet in a seam, `swell` [0..1] the fullness of its rim."""
    w, h, d = (float(s) for s in size)
    t = np.sin(np.pi / 2 * np.linspace(-1, 1, cells + 1))  # closer rows where it curves
    x, z = np.meshgrid(t, t, indexing="ij")
    rise = (np.clip((1 - x**4) * (1 - z**4), 0, 1)) ** (1 - 0.6 * swell)
    pinch = 1 - 0.09 * (1 - (x * z) ** 2) * (np.maximum(abs(x), abs(z)) ** 6)  # corners stick out
    top = np.stack([x * pinch * w / 2, rise * h / 2, z * pinch * d / 2], axis=2).reshape(-1, 3)
    uv = np.stack([x * w / 2, z * d / 2], axis=2).reshape(-1, 2)
    faces = grid_faces(cells + 1, cells + 1)[:, ::-1]
    faces = faces[(top[faces][:, :, 1] > 0).any(axis=1)]  # in the corners both sheets lie in the seam
    up = Shape(top, faces, uv)
    return joined(up, Shape(top * [1, -1, 1], up.faces[:, ::-1], uv))


def grid_faces(n: int, m: int) -> np.ndarray:
    """Return the triangles (F, 3) of n x m vertices; they face along first x second direction."""
    i, j = np.meshgrid(np.arange(n - 1), np.arange(m - 1), indexing="ij")
    a = (i * m + j).reshape(-1)
    b, c, d = a + m, a + m + 1, a + 1
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def without_lines(shape: Shape) -> Shape:
    """Return the shape without triangles that have no area."""
    p = shape.vertices[shape.faces]
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    edge = np.abs(p - np.roll(p, 1, axis=1)).max()
    return shape._replace(faces=shape.faces[np.sqrt((cross * cross).sum(axis=1)) > 1e-7 * edge * edge])
