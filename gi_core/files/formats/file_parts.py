"""What mesh-file readers share: the records that they return, and polygons as triangles.

A record has parts in world space, materials, and lights if the format has any. Polygons become fans, or are cut by ear
clipping (mapbox_earcut) where a fan would leave the outline. Transmission, blending and dissolving become thin glass.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import cross, dot
from gi_core.files.formats.boundary import MOST_AT_VERTEX
from gi_core.scene.pose import three
from gi_core.scene.rules import MOST_IOR
from gi_core.scene.types import Camera, Light, Material, Mesh, Paint, Pane, Texture

MOST_COVER = 0.9  # opacity from which a blended surface is taken as opaque ...
LEAST_TRANSMISSION = 0.5  # ... and transmission below which one is: its diffuse part is the larger one
CHANNELS = (1,), (2,), (0, 1, 2), (0, 1, 2)  # of the textures of Finish that count: eight in all


def listed(names: list[str]) -> str:
    """Return the first few names in words."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


class FileParts(NamedTuple):
    """A mesh file as read, before any cleaning."""

    parts: list[Mesh]  # paint with colours of any size, without textures; corner normals of any length
    materials: list[Material]
    lights: list[Light]
    camera: Camera | None
    up: str  # "y" or "z", the format's custom
    notes: list[str]
    textures: tuple[Texture, ...] = ()  # of the paint of all parts
    finishes: tuple[Texture, ...] = ()  # of their finish


def placed(texture: np.ndarray, uv: np.ndarray, colour: np.ndarray | None = None) -> Paint:
    """Return textures (F,) int, -1 for none, placed on faces by uv (F, 3, 2), v downwards, with colours (F, 3, 3).

    colour: None: white.
    """
    colour = np.ones((len(texture), 3, 3), np.float32) if colour is None else colour.astype(np.float32)
    return Paint((), texture.astype(np.int32), uv.astype(np.float32), colour)


def without_overlaps(corners: np.ndarray, places: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the corners (F, 3) of triangles; polygons whose fans fold over are cut by ear clipping.

    corners (F, 3) int64: of the fans of polygons, one after the other, each a number of a corner in the file; places
    (C, 3) [m] of corners by that number; counts (P,) of triangles per polygon.
    """
    if counts.max(initial=1) == 1:
        return corners
    polygon = np.repeat(np.arange(len(counts)), counts)
    p = places[corners]
    normals = cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    whole = np.stack([np.bincount(polygon, normals[:, k], len(counts)) for k in range(3)], axis=1)
    folds = dot(normals, whole[polygon]) < -1e-9 * dot(whole, whole)[polygon]
    first = np.cumsum(counts) - counts
    corners = corners.copy()
    for k in np.unique(polygon[folds & (counts <= MOST_AT_VERTEX)[polygon]]).tolist():  # fans of more are refused
        rows = slice(int(first[k]), int(first[k] + counts[k]))
        outline = np.append(corners[rows, :2].reshape(-1)[:2], corners[rows, 2])
        cut = clipped(places[outline], whole[k])
        if len(cut) == counts[k]:  # an outline that crosses itself has no such triangles
            corners[rows] = outline[cut]
    return corners


def clipped(outline: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return triangles (n, 3) of numbers of the corners of an outline (m, 3), wound as its normal (3,) says."""
    import mapbox_earcut

    axis = int(np.argmax(np.abs(normal)))
    flat = np.ascontiguousarray(np.delete(outline, axis, axis=1))
    cut = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32)).reshape(-1, 3).astype(np.int64)
    p = outline[cut]
    turned = dot(cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), normal) < 0
    cut[turned] = cut[turned][:, ::-1]
    return cut


def transmitting(material: Material, colour: Sequence[float], ior: float = Pane().ior) -> Material:
    """Return a material as a pane of internal transmittance `colour` (3,) in [0, 1]; ior < 1: the usual one."""
    passes = three(np.clip(np.asarray(colour, np.float64), 0.0, 1.0))
    return material.as_pane(Pane(passes, min(ior, MOST_IOR) if ior >= 1 else Pane().ior))


def behind_cover(cover: float, colour: Sequence[float]) -> np.ndarray:
    """Return the transmittance (3,) of a surface of some opacity, whose colour (3,) filters the light behind it."""
    return 1 - cover * (1 - np.asarray(colour, np.float64))
