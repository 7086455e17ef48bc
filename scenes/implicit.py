"""Bodies given by a function that is negative inside: blended limbs, drilled holes, and their triangles.

The triangles are those of surface nets (Gibson 1998): a vertex in every grid cell that the surface passes,
a quad across every grid edge that it cuts, and the vertices then drawn onto the surface.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scenes.modelling import Shape

Field = Callable[[np.ndarray], np.ndarray]  # points (..., 3) [m] -> signed distance (...) [m], roughly
PULLS = 4  # Newton steps onto the surface, evened out between them but for the last two

FOLDED = 0.12  # cosine between a triangle and its vertex normals: less, and the file's normals would be disbelieved


def limb(a, b, radius_a: float, radius_b: float) -> Field:
    """Return a capsule from a to b whose radius runs from one to the other."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    d = b - a

    def field(p):
        t = np.clip(((p - a) * d).sum(axis=-1) / (d @ d), 0, 1)
        off = p - a - t[..., None] * d
        return np.sqrt((off * off).sum(axis=-1)) - (radius_a + t * (radius_b - radius_a))

    return field


def ellipsoid(centre, radii) -> Field:
    """Return an ellipsoid, its distance to first order."""
    centre, radii = np.asarray(centre, float), np.asarray(radii, float)

    def field(p):
        q = (p - centre) / radii
        g = q / radii
        length = np.sqrt((q * q).sum(axis=-1))
        return length * (length - 1) / np.maximum(np.sqrt((g * g).sum(axis=-1)), 1e-9)

    return field


def blend(fields, width: float) -> Field:
    """Return the union, its seams filled over `width` [m]."""

    def field(p):
        total = fields[0](p)
        for other in fields[1:]:
            total = smooth_least(total, other(p), width)
        return total

    return field


def smooth_least(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Return the smaller value, rounded off where the two are nearer than `width`."""
    h = np.maximum(width - np.abs(a - b), 0) / width
    return np.minimum(a, b) - 0.25 * width * h * h


def polygonised(field: Field, low, high, cell: float) -> Shape:
    """Return the surface in a box as triangles of edges about `cell` [m]; uv is zero.

    Raises ValueError if the surface reaches the edge of the box, or has features too fine for the cell.
    """
    # Off the round numbers that bodies are made of: a grid node on the surface would make slivers.
    low, high = np.asarray(low, float) - cell * np.array([0.31, 0.37, 0.43]), np.asarray(high, float)
    counts = np.ceil((high - low) / cell).astype(int) + 1
    axes = [low[k] + cell * np.arange(counts[k]) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    value = field(nodes)
    inside = value < 0
    rim = np.ones_like(inside)
    rim[1:-1, 1:-1, 1:-1] = False
    if (inside & rim).any():
        raise ValueError(f"the body reaches out of its box {low.tolist()} to {high.tolist()}; widen it")
    # A cell holds a vertex if its eight nodes disagree.
    corners = [inside[x : x + s[0], y : y + s[1], z : z + s[2]] for x, y, z, s in _offsets(inside.shape)]
    filled = np.sum(corners, axis=0)
    mixed = (filled > 0) & (filled < 8)
    number = np.where(mixed, np.cumsum(mixed.reshape(-1)).reshape(mixed.shape) - 1, -1)
    points = low + cell * _middles_of_crossings(value, inside, number)
    faces = np.concatenate([_quads(inside, number, axis) for axis in range(3)])
    for pull in range(PULLS):
        value, slope = field(points), gradient(field, points, cell)
        step = value[:, None] * slope / np.maximum((slope * slope).sum(axis=1), 0.25)[:, None]
        points = points - np.clip(step, -0.3 * cell, 0.3 * cell)
        if pull < PULLS - 2:
            points = 0.5 * (points + _neighbours_mean(points, faces))
    slope = gradient(field, points, cell)
    normals = slope / np.sqrt((slope * slope).sum(axis=1))[:, None]
    triangles, facing = _cut(points, normals, faces)
    if facing < FOLDED:
        raise ValueError(f"the body folds over at cells of {cell:g} m; take another cell, or rounder limbs")
    return Shape(points, triangles, np.zeros((len(points), 2)), normals)


def gradient(field: Field, points: np.ndarray, cell: float) -> np.ndarray:
    """Return the field's slope (n, 3) by central differences."""
    h = 1e-3 * cell
    return np.stack([(field(points + h * e) - field(points - h * e)) / (2 * h) for e in np.eye(3)], axis=-1)


def _offsets(shape):
    s = tuple(n - 1 for n in shape)
    return [(x, y, z, s) for x in (0, 1) for y in (0, 1) for z in (0, 1)]


def _middles_of_crossings(value, inside, number) -> np.ndarray:
    """Return for each vertex (n, 3) the mean of where the surface crosses its cell's edges, in cells."""
    total, count = np.zeros((int(number.max()) + 1, 3)), np.zeros(int(number.max()) + 1)
    for axis in range(3):
        v, a, cells = (np.moveaxis(array, axis, 0) for array in (value, inside, number))
        at = np.argwhere(a[:-1] != a[1:])
        i, j, k = at.T
        place = np.empty((len(at), 3))
        others = [b for b in range(3) if b != axis]
        place[:, axis] = i + v[i, j, k] / (v[i, j, k] - v[i + 1, j, k])
        place[:, others[0]], place[:, others[1]] = j, k
        for dj in (0, 1):
            for dk in (0, 1):
                owner = cells[i, j - dj, k - dk]
                np.add.at(total, owner, place)
                np.add.at(count, owner, 1)
    return total / count[:, None]


def _quads(inside, number, axis: int) -> np.ndarray:
    """Return a quad for each grid edge along an axis whose ends disagree, facing from inside to outside."""
    a = np.moveaxis(inside, axis, 0)
    n = np.moveaxis(number, axis, 0)
    first, second = a[:-1, 1:-1, 1:-1], a[1:, 1:-1, 1:-1]
    i, j, k = np.nonzero(first != second)
    quad = np.stack([n[i, j, k], n[i, j + 1, k], n[i, j + 1, k + 1], n[i, j, k + 1]], axis=1)
    leaving = first[i, j, k]
    # moveaxis keeps the other two axes in order, which for the middle axis is the odd order.
    odd = axis == 1
    return np.where((leaving ^ odd)[:, None], quad, quad[:, ::-1])


def _cut(points, normals, quads) -> tuple[np.ndarray, float]:
    """Return two triangles a quad, cut so that both face outwards, and the worst cosine to a vertex normal."""
    ways, worst = [], []
    for order in (([0, 1, 2], [0, 2, 3]), ([0, 1, 3], [1, 2, 3])):
        triangles = [quads[:, k] for k in order]
        least = np.full(len(quads), np.inf)
        for t in triangles:
            p = points[t]
            n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
            n /= np.maximum(np.sqrt((n * n).sum(axis=1)), 1e-30)[:, None]
            least = np.minimum(least, (n[:, None] * normals[t]).sum(axis=2).min(axis=1))
        ways.append(triangles)
        worst.append(least)
    first = (worst[0] >= worst[1])[:, None]
    triangles = np.concatenate([np.where(first, a, b) for a, b in zip(*ways, strict=True)])
    return triangles, float(np.maximum(*worst).min())


def _neighbours_mean(points, quads) -> np.ndarray:
    total, count = np.zeros_like(points), np.zeros(len(points))
    for k in range(4):
        for other in (1, 3):
            np.add.at(total, quads[:, k], points[quads[:, (k + other) % 4]])
            np.add.at(count, quads[:, k], 1)
    return total / np.maximum(count, 1)[:, None]
