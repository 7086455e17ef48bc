"""Receivers: one-sided points (position, normal) at the vertices of a mesh, which store irradiance.

Face corners at one position on one smooth side share a receiver: a box corner has three receivers, a vertex inside a
wall one. The back of a two-sided face has separate receivers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base import vec
from gi_core.base.grouping import components, group_of, order_of
from gi_core.base.jit import allocating
from gi_core.base.vectors import cross, dot, length
from gi_core.scene.types import Mesh

NONE = -1  # no surface


CREASE_DEGREES = 40.0  # faces that meet at a smaller angle shade as one smooth surface
FACES_COMPARED = 3  # faces at one edge that a face is compared with


class Receivers(NamedTuple):
    """R points with normals and areas."""

    positions: np.ndarray  # (R, 3) float64 [m]
    normals: np.ndarray  # (R, 3) float64 unit
    areas: np.ndarray  # (R,) float64 [m2], a third of each face around it


class Built(NamedTuple):
    receivers: Receivers
    corner_front: np.ndarray  # (F, 3) int64
    corner_back: np.ndarray  # (F, 3) int64, -1 where one-sided
    patch: np.ndarray  # (F,) int64


def build_receivers(mesh: Mesh, normals: np.ndarray, areas: np.ndarray, two_sided: np.ndarray) -> Built:
    """Build the receivers of one mesh in its own space.

    `normals` (F, 3), `areas` (F,), `two_sided` (F,) are per face. Corners are merged only where
    their normals agree within the crease angle, so opposed normals are never averaged.
    """
    F, corner_normals = len(mesh.faces), mesh.corner_normals
    group, count = _groups(mesh, normals)
    flat = group.reshape(-1)

    if corner_normals is None:
        directions, weight = np.repeat(normals, 3, axis=0), _corner_angles(mesh).reshape(-1)
    else:
        directions, weight = corner_normals.reshape(-1, 3), np.ones(3 * F)
    n = np.stack([np.bincount(flat, weight * directions[:, k], count) for k in range(3)], axis=1)
    size = length(n)
    first = np.full(count, -1)
    first[flat[::-1]] = np.arange(3 * F)[::-1]
    # Normals of slivers may cancel: use the first face's own normal.
    n = np.where(size[:, None] > 1e-12, n / np.where(size > 0, size, 1)[:, None], directions[first])
    positions = mesh.vertices[mesh.faces.reshape(-1)[first]]
    area = np.bincount(flat, np.repeat(areas / 3, 3), count)

    # A receiver has a twin on the back if any of its faces is two-sided.
    sided_area = np.bincount(flat, np.repeat(np.where(two_sided, areas / 3, 0), 3), count)
    has_back = np.bincount(flat, np.repeat(two_sided, 3), count) > 0
    back_index = np.where(has_back, count + np.cumsum(has_back) - 1, -1)
    receivers = Receivers(
        positions=np.concatenate([positions, positions[has_back]]),
        normals=np.concatenate([n, -n[has_back]]),
        areas=np.concatenate([area, sided_area[has_back]]),
    )
    corner_back = np.where(two_sided[:, None], back_index[group], -1)
    return Built(receivers, group, corner_back, _patches(group, count))


def count_receivers(mesh: Mesh, normals: np.ndarray, two_sided: np.ndarray) -> int:
    """Return the number of receivers that build_receivers() makes."""
    group, count = _groups(mesh, normals)
    return count + len(np.unique(group[two_sided]))


def _groups(mesh: Mesh, normals: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the receiver (F, 3) int64 of each front corner, and the number of receivers."""
    position_of = weld(mesh.vertices)[mesh.faces]  # (F, 3) welded vertex id per corner
    if mesh.corner_normals is None:
        group = _smooth_groups(position_of, normals)
    else:
        group = _equal_normals(position_of, mesh.corner_normals)
    return group, int(group.max(initial=-1)) + 1


def no_receivers(mesh: Mesh) -> Built:
    """Return the result of build_receivers() with no receivers, for ray casting only."""
    F = len(mesh.faces)
    none = np.full((F, 3), -1, np.int64)
    return Built(Receivers(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)), none, none, np.zeros(F, np.int64))


def weld(vertices: np.ndarray) -> np.ndarray:
    """Return the id (V,) of each vertex's position; vertices in one small cell share it.

    Cells grow eightfold from shell to shell around the middle, as the rounding of coordinates does: vertices far away
    must not merge those of a room. The innermost shell holds a tenth of all vertices or more.
    """
    if not len(vertices):
        return np.zeros(0, np.int64)
    around = vertices - np.median(vertices, axis=0)
    away = np.abs(around).max(axis=1)
    inner = max(float(np.quantile(away, 0.1)), 1e-24)
    shell = np.maximum(np.ceil(np.log2(np.maximum(away / inner, 1.0)) / 3), 1.0)
    # vertices nearer than 1e-6 of the extent around them are merged (float32 files repeat them)
    cell = 1e-6 * 2 * inner * 8.0 ** (shell - 1)
    return group_of((shell.astype(np.int64), *np.round(around / cell[:, None]).astype(np.int64).T))


def _smooth_groups(position_of: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Join corners at one place whose faces share an edge there and turn by less than the crease angle."""
    start = position_of.reshape(-1)
    end = position_of[:, [1, 2, 0]].reshape(-1)
    order = order_of((np.minimum(start, end), np.maximum(start, end)))
    pairs = _smooth_pairs(order, start, end, np.ascontiguousarray(normals), np.cos(np.radians(CREASE_DEGREES)))
    return components(pairs, len(start)).reshape(position_of.shape)


@allocating
def _smooth_pairs(order, start, end, normals, least):
    """Return the corners (m, 2) that meet on one smooth side. Edge 3 f + c runs from that corner of face f to its next;
    in `order`, edges with the same two ends are adjacent; an edge of more than two faces joins only smooth pairs."""
    pairs = np.empty((2 * FACES_COMPARED * len(order), 2), np.int64)
    count = 0
    for k in range(len(order)):
        i = order[k]
        low, high = min(start[i], end[i]), max(start[i], end[i])
        for j in order[k + 1 : k + 1 + FACES_COMPARED]:
            if min(start[j], end[j]) != low or max(start[j], end[j]) != high:
                break
            f, g = i // 3, j // 3
            if vec.dot(normals[f], normals[g]) > least:
                # The corners at either end of each edge; the edges may have opposite directions.
                a, b = i, 3 * f + (i + 1) % 3
                c, d = j, 3 * g + (j + 1) % 3
                if start[i] != start[j]:
                    c, d = d, c
                pairs[count, 0], pairs[count, 1] = a, c
                pairs[count + 1, 0], pairs[count + 1, 1] = b, d
                count += 2
    return pairs[:count]


def _equal_normals(position_of: np.ndarray, corner_normals: np.ndarray) -> np.ndarray:
    """Join corners at one place that carry the same normal (to 1/512)."""
    normals = np.round(corner_normals.reshape(-1, 3) * 512).astype(np.int64)
    return group_of((position_of.reshape(-1), *normals.T)).reshape(position_of.shape)


def _patches(group: np.ndarray, count: int) -> np.ndarray:
    """Return the patch of each face: faces that share a receiver are one smooth surface."""
    F = len(group)
    links = np.stack([np.repeat(np.arange(F), 3), F + group.reshape(-1)], axis=1)
    return components(links, F + count)[:F]  # the first nodes, numbered without gaps


def _corner_angles(mesh: Mesh) -> np.ndarray:
    """Return the inner angle (F, 3) [rad] at each corner."""
    p = mesh.vertices[mesh.faces]
    angles = np.empty(mesh.faces.shape)
    for k in range(3):
        u, v = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
        angles[:, k] = np.arctan2(length(cross(u, v)), dot(u, v))
    return angles
