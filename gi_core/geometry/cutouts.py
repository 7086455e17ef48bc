"""Alpha cutouts: surfaces with holes from a texture's transparency, such as leaves, fences and grilles.

Rays pass the holes texel by texel (`gi_core/rays/holes.py`). Fully transparent triangles are removed.
"""

from __future__ import annotations

import numpy as np

from gi_core.geometry.mesh_parts import rows_of
from gi_core.scene.types import Mesh, Texture

HALF = 128  # threshold of `Texture.cover`: the surface exists from this byte on


def cover_of(alpha: np.ndarray, factor: float, cutoff: float) -> np.ndarray:
    """Return alpha (h, w) uint8 times `factor`, scaled so that `cutoff` becomes HALF, the common threshold."""
    if cutoff <= 0:
        return np.full(alpha.shape, 255, np.uint8)
    return np.round(np.clip(np.arange(256) * (0.5 * factor / cutoff), 0, 255)).astype(np.uint8)[alpha]


def bled(pixels: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """Return pixels (h, w, 3) with cut-out ones in the mean colour of the rest: interpolation mixes them in."""
    solid = cover >= HALF
    if solid.all() or not solid.any():
        return pixels
    filled = pixels.copy()
    filled[~solid] = np.round(pixels[solid].mean(axis=0)).astype(np.uint8)
    return filled


def covered(texture: Texture, uv: np.ndarray) -> np.ndarray:
    """Return (n,) bool: the surface exists at uv (n, 2) of a texture with a cover."""
    h, w = texture.cover.shape
    at = np.clip(np.nan_to_num(uv), -1e6, 1e6) * [w, h]
    if texture.nearest:
        corners = [(np.floor(at).astype(np.int64), np.ones(len(at)))]
    else:
        first = np.floor(at - 0.5)
        f = at - 0.5 - first
        first = first.astype(np.int64)
        corners = [(first + (i, j), np.abs(1 - i - f[:, 0]) * np.abs(1 - j - f[:, 1])) for i in (0, 1) for j in (0, 1)]
    total = np.zeros(len(at))
    for texel, weight in corners:
        column, row = (_wrapped(texel[:, k], n, texture.wrap[k]) for k, n in enumerate((w, h)))
        total += weight * texture.cover[row, column]
    return total >= HALF - 0.5


def without_holes(mesh: Mesh) -> Mesh:
    """Return the mesh without its fully transparent triangles."""
    if mesh.paint is None or all(t.cover is None for t in mesh.paint.textures):
        return mesh
    keep = np.ones(len(mesh.faces), bool)
    for t, texture in enumerate(mesh.paint.textures):
        rows = np.flatnonzero(mesh.paint.face_texture == t)
        if texture.cover is not None and len(rows):
            keep[rows] = _anything(texture, mesh.paint.corner_uv[rows])
    if keep.all() or not keep.any():
        return mesh
    rows = np.flatnonzero(keep)
    corner = {k: v if v is None else v[rows] for k, v in mesh._asdict().items() if k not in ("vertices", "paint")}
    return mesh._replace(paint=rows_of(mesh.paint, rows), **corner)


def _anything(texture: Texture, uv: np.ndarray) -> np.ndarray:
    """Return (n,) bool: the surface exists somewhere in the bounding box of each triangle uv (n, 3, 2)."""
    h, w = texture.cover.shape
    uv = np.clip(np.nan_to_num(uv.astype(np.float64)), -1e6, 1e6)
    count = np.zeros((h + 1, w + 1), np.int32)  # summed-area table of existing texels
    np.cumsum(texture.cover >= HALF, axis=0, dtype=np.int32, out=count[1:, 1:])
    np.cumsum(count[1:, 1:], axis=1, out=count[1:, 1:])

    def before(row, column):
        """Return the number of texels above a row and left of a column, in the repeated texture."""
        (m, i), (n, k) = divmod(row, h), divmod(column, w)
        return m * n * int(count[h, w]) + m * count[h, k] + n * count[i, w] + count[i, k]

    size = np.array([w, h])
    # Half a texel of padding for interpolation.
    low = np.floor(uv.min(axis=1) * size - 0.5).astype(np.int64)
    high = np.floor(uv.max(axis=1) * size + 0.5).astype(np.int64) + 1
    inside = (low >= 0) & (high <= size)
    repeats = np.array([way == "repeat" for way in texture.wrap])
    high = np.minimum(high - low, size) + low % size
    low = low % size
    (x, y), (u, v) = low.T, high.T
    covers = before(v, u) - before(y, u) - before(v, x) + before(y, x) > 0
    return covers | ~(inside | repeats).all(axis=1)  # beyond an edge that does not repeat: kept


def _wrapped(i: np.ndarray, n: int, way: str) -> np.ndarray:
    if way == "repeat":
        return i % n
    if way == "mirror":
        i = i % (2 * n)
        return np.where(i < n, i, 2 * n - 1 - i)
    return np.clip(i, 0, n - 1)
