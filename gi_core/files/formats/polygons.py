"""Polygons as triangles: fans, and by ear clipping (mapbox_earcut) where a fan would leave the outline."""

from __future__ import annotations

import numpy as np

from gi_core.base.vectors import cross, dot
from gi_core.files.formats.boundary import MOST_AT_VERTEX


def without_overlaps(corners: np.ndarray, places: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the corners (F, 3) of triangles; polygons whose fans fold over are cut by ear clipping.

    corners (F, 3) int64: of the fans of polygons, one after the other, each a number of a corner in the file; places
    (C, 3) [m] of corners by that number; counts (P,) of triangles per polygon.
    """
    if counts.max(initial=1) == 1:
        return corners
    polygon = np.repeat(np.arange(len(counts)), counts)
    with np.errstate(all="ignore"):  # vertices beyond all bounds are refused later
        p = places[corners]
        normals = cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        whole = np.stack([np.bincount(polygon, normals[:, k], len(counts)) for k in range(3)], axis=1)
        folds = dot(normals, whole[polygon]) < -1e-9 * dot(whole, whole)[polygon]
    first = np.cumsum(counts) - counts
    corners = corners.copy()
    for k in np.unique(polygon[folds & (counts <= MOST_AT_VERTEX)[polygon]]).tolist():  # fans of more are refused
        rows = slice(int(first[k]), int(first[k] + counts[k]))
        outline = np.append(corners[rows, :2].reshape(-1)[:2], corners[rows, 2])
        cut = _clipped(places[outline], whole[k])
        if len(cut) == counts[k]:  # an outline that crosses itself has no such triangles
            corners[rows] = outline[cut]
    return corners


def _clipped(outline: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return triangles (n, 3) of numbers of the corners of an outline (m, 3), wound as its normal (3,) says."""
    import mapbox_earcut

    axis = int(np.argmax(np.abs(normal)))
    flat = np.ascontiguousarray(np.delete(outline, axis, axis=1))
    cut = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32)).reshape(-1, 3).astype(np.int64)
    p = outline[cut]
    turned = dot(cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), normal) < 0
    cut[turned] = cut[turned][:, ::-1]
    return cut
