"""Consistent winding: faces to turn so that neighbours face the same way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.grouping import components, group_of, order_of
from gi_core.base.vectors import cross, dot, every, length
from gi_core.geometry.receivers import weld
from gi_core.scene.types import Mesh


class Winding(NamedTuple):
    """Faces to turn, and the bodies that they form."""

    turned: np.ndarray  # (F,) bool, faces to turn round; the larger area of each body stays as it is
    body: np.ndarray  # (F,) int64, faces joined by edges that just two faces share
    orientable: np.ndarray  # (B,) bool, a body without two sides (a Moebius strip) stays as it is


def consistent_winding(faces: np.ndarray, areas: np.ndarray) -> Winding:
    """Find the faces to turn: faces (F, 3) of welded vertices, areas (F,) [m2].

    Only edges of exactly two faces connect them: where three meet, the winding is ambiguous.
    Each face is two nodes of a graph, as it is and turned; an edge ties the nodes that agree.
    """
    n = len(faces)
    first, second, agree = _shared_edges(faces)
    a = np.concatenate([first, first + n])
    b = np.concatenate([np.where(agree, second, second + n), np.where(agree, second + n, second)])
    label = components(np.stack([a, b], axis=1), 2 * n)
    as_is, turned = label[:n], label[n:]
    # Of the two colourings of a body keep the one that leaves more area alone.
    body = np.unique(np.minimum(as_is, turned), return_inverse=True)[1].reshape(-1)
    orientable = np.ones(int(body.max(initial=-1)) + 1, bool)
    orientable[body[as_is == turned]] = False
    higher = as_is > turned
    balance = np.bincount(body, np.where(higher, areas, -areas), len(orientable))
    turn = np.where(balance[body] > 0, ~higher, higher) & orientable[body]
    return Winding(turn, body, orientable)


def _shared_edges(faces: np.ndarray):
    """Return pairs of faces (n,), (n,) over one edge of exactly two, and whether they run it in opposite directions."""
    start, end = faces.reshape(-1), faces[:, [1, 2, 0]].reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = order_of((low, high))
    low, high, forward = low[order], high[order], (start < end)[order]
    fresh = np.ones(len(low), bool)
    fresh[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    begin = np.flatnonzero(fresh)
    pair = begin[np.diff(np.append(begin, len(low))) == 2]
    face = order // 3
    return face[pair], face[pair + 1], forward[pair] != forward[pair + 1]


def faces_to_turn(parts: list[Mesh], vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which faces (F,) of all parts together to turn round, and which belong to a body without two sides.

    Where a file has normals they decide: a face that all three of its normals oppose is wound the wrong
    way, unless most of its part is. Elsewhere neighbours must agree.
    """
    p = vertices[faces]
    double = cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    size = length(double)
    turn, torn = np.zeros(len(faces), bool), np.zeros(len(faces), bool)
    starts = np.cumsum([0, *(len(q.faces) for q in parts)])
    bare = np.zeros(len(faces), bool)
    for q, first, last in zip(parts, starts[:-1], starts[1:], strict=True):
        if q.corner_normals is None:
            bare[first:last] = True
            continue
        n = q.corner_normals
        cosine = dot(n, double[first:last, None])
        # normals that lean farther to the other side than a cosine of 0.5 mean it
        opposed = every(cosine < -0.5 * length(n) * size[first:last, None])
        if 2 * opposed.sum() < len(opposed):
            turn[first:last] = opposed
    rows = np.flatnonzero(bare & (size > 0))
    if len(rows):
        corners = np.where(turn[:, None], faces[:, ::-1], faces)
        places = weld(vertices)[corners[rows]]
        first, like = distinct(places)
        winding = consistent_winding(places[first], size[rows[first]])
        turn[rows] = winding.turned[like]
        torn[rows] = ~winding.orientable[winding.body[like]]
    return turn, torn


def distinct(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first faces (n,) of each three places and winding, and for each face (F,) its number among these.

    places: (F, 3) of the corners. Copies of a face would be its neighbours over three edges.
    """
    start = np.argmin(places, axis=1)[:, None]
    turned = np.take_along_axis(places, (start + np.arange(3)) % 3, axis=1)
    _, first, like = np.unique(group_of(tuple(turned.T)), return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[order := np.argsort(first)] = np.arange(len(first))
    return first[order], rank[like.reshape(-1)]
