"""Light maps: a second set of texture coordinates (xatlas), and irradiance as an image over them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from app.settings import UsageError

PADDING = 4  # texels between charts, filled with the light of the nearest chart
SEAM = 1.0  # texels round a triangle that its light continues in: bilinear filters read there
TEXELS = 1 << 20  # texels per step


class Unwrapped(NamedTuple):
    """A mesh cut along the edges of its charts."""

    vertices: np.ndarray  # (m,) numbers of the mesh's vertices
    corners: np.ndarray  # (n, 3) of each triangle, in these
    uv: np.ndarray  # (m, 2) float32 in 0 .. 1, from the upper left corner of the image


class LightMap(NamedTuple):
    """Irradiance over texture coordinates."""

    irradiance: np.ndarray  # (h, w, 3) float32 [W/m2 or lx]
    coverage: np.ndarray  # (h, w) float32: 1 where a texel's centre lies in a chart


def unwrap(meshes: Sequence[tuple[np.ndarray, np.ndarray]], pixels: int) -> tuple[list[Unwrapped], tuple[int, int]]:
    """Return each mesh, positions (m, 3) and triangles (n, 3), unwrapped into one image, and its width and height.

    pixels: about, per side. Raises UsageError.
    """
    import xatlas

    atlas = xatlas.Atlas()
    for positions, triangles in meshes:
        atlas.add_mesh(np.ascontiguousarray(positions, np.float32), np.ascontiguousarray(triangles, np.uint32))
    packing = xatlas.PackOptions()
    packing.resolution, packing.padding, packing.bilinear, packing.create_image = pixels, PADDING, True, False
    atlas.generate(xatlas.ChartOptions(), packing)
    if atlas.atlas_count != 1:
        raise UsageError(f"the light map of {pixels} pixels needs {atlas.atlas_count} images: choose more pixels")
    arrays = (atlas[k] for k in range(len(meshes)))
    return [Unwrapped(v.astype(np.int64), c.astype(np.int64), uv) for v, c, uv in arrays], (atlas.width, atlas.height)


def light_map(size: tuple[int, int], parts: Iterable[tuple[Unwrapped, np.ndarray, np.ndarray]]) -> LightMap:
    """Return the light of unwrapped meshes, each with irradiance (m, 3) and interpolation weights (m,) at its vertices.

    A texel has the light of its centre, interpolated as in the picture. size: width and height.
    """
    width, height = size
    light = np.zeros((height * width, 3), np.float32)
    nearest = np.full(height * width, np.inf)  # squared distance of a texel's centre from its triangle [texels2]
    for part, irradiance, weights in parts:
        at = part.uv.astype(np.float64) * (width, height) - 0.5  # centres of texels are whole numbers
        for triangles in _chunks(at[part.corners]):
            rows = part.corners[triangles]
            f, texel, shares, away = _texels(at[rows], width, height)
            share = shares * weights[rows[f]]
            values = (share[:, :, None] * irradiance[rows[f]]).sum(axis=1) / share.sum(axis=1)[:, None]
            order = np.argsort(-away, kind="stable")  # the nearest triangle is written last
            order = order[away[order] < nearest[texel[order]]]
            light[texel[order]], nearest[texel[order]] = values[order], away[order]
    filled = np.isfinite(nearest)
    _fill(light, filled, width, height)
    covered = (nearest == 0).astype(np.float32)
    return LightMap(light.reshape(height, width, 3), covered.reshape(height, width))


def _boxes(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first texel (n, 2) and the numbers of texels (n, 2) of boxes round triangles (n, 3, 2)."""
    low = np.floor(p.min(axis=1) - SEAM).astype(np.int64)
    return low, np.ceil(p.max(axis=1) + SEAM).astype(np.int64) - low + 1


def _chunks(p: np.ndarray) -> Iterable[np.ndarray]:
    """Yield numbers of triangles (n, 3, 2) whose boxes have about TEXELS texels together; flat ones are left out."""
    e, g = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    solid = np.flatnonzero(np.abs(e[:, 0] * g[:, 1] - e[:, 1] * g[:, 0]) > 1e-9)
    if len(solid):
        sizes = _boxes(p[solid])[1].prod(axis=1)
        yield from np.split(solid, np.flatnonzero(np.diff(np.cumsum(sizes) // TEXELS)) + 1)


def _texels(p: np.ndarray, width: int, height: int) -> tuple[np.ndarray, ...]:
    """Return the texels within SEAM of triangles (n, 3, 2): triangle, texel, barycentric weights (k, 3) of the nearest
    point on it, and the squared distance from that."""
    low, size = _boxes(p)
    counts = size.prod(axis=1)
    f = np.repeat(np.arange(len(p)), counts)
    k = np.arange(len(f)) - np.repeat(np.cumsum(counts) - counts, counts)
    centre = low[f] + np.stack([k % size[f, 0], k // size[f, 0]], axis=1)
    shares = _nearest_on(p[f], centre)
    off = (shares[:, :, None] * p[f]).sum(axis=1) - centre
    away = (off * off).sum(axis=1)
    away[away < 1e-18] = 0.0
    inside = ((centre >= 0) & (centre < (width, height))).all(axis=1) & (away <= SEAM * SEAM)
    return f[inside], centre[inside, 1] * width + centre[inside, 0], shares[inside], away[inside]


def _nearest_on(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the barycentric weights (n, 3) of the points on triangles (n, 3, 2) that are nearest to points (n, 2)."""
    a, e, g = p[:, 0], p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    d, area = x - a, e[:, 0] * g[:, 1] - e[:, 1] * g[:, 0]
    v, w = (d[:, 0] * g[:, 1] - d[:, 1] * g[:, 0]) / area, (e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0]) / area
    best = np.stack([1 - v - w, v, w], axis=1)
    outside = np.flatnonzero((best < 0).any(axis=1))
    least = np.full(len(outside), np.inf)
    for i in range(3):
        j = (i + 1) % 3
        start, edge = p[outside, i], p[outside, j] - p[outside, i]
        way = x[outside] - start
        t = np.clip((way * edge).sum(axis=1) / np.maximum((edge * edge).sum(axis=1), 1e-30), 0, 1)
        off = way - t[:, None] * edge
        closer = (away := (off * off).sum(axis=1)) < least
        least[closer], rows = away[closer], outside[closer]
        best[rows] = 0.0
        best[rows, i], best[rows, j] = 1 - t[closer], t[closer]
    return best


def _fill(light: np.ndarray, filled: np.ndarray, width: int, height: int) -> None:
    """Give texels within PADDING of filled ones the mean of their filled neighbours, ring by ring, in place."""
    for _ in range(PADDING):
        grid, seen = light.reshape(height, width, 3), filled.reshape(height, width)
        total, count = np.zeros((height + 2, width + 2, 3), np.float64), np.zeros((height + 2, width + 2))
        for y in range(3):
            for x in range(3):
                total[y : y + height, x : x + width] += np.where(seen[..., None], grid, 0)
                count[y : y + height, x : x + width] += seen
        sums, counts = total[1:-1, 1:-1].reshape(-1, 3), count[1:-1, 1:-1].reshape(-1)
        ring = ~filled & (counts > 0)
        light[ring] = sums[ring] / counts[ring, None]
        filled |= ring
