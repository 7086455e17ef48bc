"""Grows the tree of tree.glb: a skeleton by space colonisation, bark as tubes, leaves on the thin twigs.

The skeleton follows Runions, Lane and Prusinkiewicz 2007 ("Modeling Trees with a Space Colonization
Algorithm"): points scattered in the crown pull the nearest twig towards them until it has reached them.
Only `random()` of a fixed generator is used and coordinates are rounded, so that the arrays are the same
everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SEED = 20
ROOT = np.array([0.5, 0.5, 0.0])
CROWN_CENTRE, CROWN_RADII = np.array([0.5, 0.5, 0.61]), np.array([0.33, 0.33, 0.285])
BARE_TRUNK = 0.24  # height of the lowest fork
ATTRACTORS = 900
STEP = 0.0125  # between nodes: the length of a triangle's edge
REACH, KILL = 0.16, 0.032
TWIG_RADIUS = 0.0016
PIPE = 2.35  # r^PIPE of a branch is the sum of that of the twigs it carries
EDGE = 0.01  # wanted length of a triangle's edge around a branch
LEAF_LENGTH, LEAF_WIDTH = 0.030, 0.017
FOLD, DROOP = 0.25, 0.35  # rise of a leaf's sides and fall of its tip, as shares of width and length
LEAFY = 3.2  # twigs up to so many times the thinnest carry leaves


class Skeleton(NamedTuple):
    """Nodes in the order they grew."""

    position: np.ndarray  # (n, 3)
    parent: np.ndarray  # (n,) int, -1 at the root
    radius: np.ndarray  # (n,)


def grow() -> Skeleton:
    """Return the skeleton of trunk, branches and twigs."""
    rng = np.random.default_rng(SEED)
    ball = rng.random((ATTRACTORS * 4, 3)) * 2 - 1
    ball = ball[(ball * ball).sum(axis=1) < 1][:ATTRACTORS]
    wanted = CROWN_CENTRE + ball * CROWN_RADII
    position, parent = [ROOT], [-1]
    # A slightly leaning trunk up to the first fork.
    for k in range(1, int(BARE_TRUNK / STEP) + 1):
        h = k * STEP
        position.append(ROOT + np.array([0.02 * np.sin(7 * h), 0.015 * np.sin(11 * h), h]))
        parent.append(k - 1)
    for _ in range(120):
        nodes = np.array(position)
        off = wanted[:, None] - nodes[None]
        distance = np.sqrt((off * off).sum(axis=2))
        nearest = distance.argmin(axis=1)
        least = distance[np.arange(len(wanted)), nearest]
        pulls = (least < REACH) | (least == least.min())
        before = len(position)
        for node in np.unique(nearest[pulls]):
            mine = pulls & (nearest == node)
            d = off[mine, node] / distance[mine, node][:, None]
            d = d.sum(axis=0) + 0.25 * (rng.random(3) - 0.5) * mine.sum() + [0, 0, 0.15 * mine.sum()]
            d = d / np.sqrt((d * d).sum())
            new = nodes[node] + STEP * d
            if np.sqrt(((np.array(position[before:] or [[9.0, 9, 9]]) - new) ** 2).sum(axis=1)).min() > STEP / 3:
                position.append(new)
                parent.append(int(node))
        nodes = np.array(position[before:])
        if not len(nodes):
            break
        off = wanted[:, None] - nodes[None]
        wanted = wanted[np.sqrt((off * off).sum(axis=2)).min(axis=1) > KILL]
        if not len(wanted):
            break
    return _with_radii(np.array(position), np.array(parent))


def _with_radii(position, parent) -> Skeleton:
    load = np.zeros(len(parent))
    leaf = np.ones(len(parent), bool)
    leaf[parent[1:]] = False
    load[leaf] = TWIG_RADIUS**PIPE
    for i in range(len(parent) - 1, 0, -1):  # children come after their parents
        load[parent[i]] += load[i]
    radius = load ** (1 / PIPE)
    foot = np.maximum(0.0, 1 - position[:, 2] / 0.07)
    return Skeleton(position, parent, radius * (1 + 0.55 * foot * foot))


def bark(tree: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of tubes along the skeleton; each runs on into its thickest child."""
    children = [[] for _ in tree.parent]
    for i, p in enumerate(tree.parent):
        if p >= 0:
            children[p].append(i)
    vertices, faces, count = [], [], 0
    starts = [[0]]
    while starts:
        chain = starts.pop()
        while children[chain[-1]]:
            kids = sorted(children[chain[-1]], key=lambda k: -tree.radius[k])
            starts += [[chain[-1], k] for k in kids[1:]]
            chain.append(kids[0])
        if len(chain) < 3:
            continue
        v, f = _tube(tree.position[chain], _tapered(tree.radius[chain], chain[0] == 0))
        vertices.append(v)
        faces.append(f + count)
        count += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def _tapered(radius: np.ndarray, trunk: bool) -> np.ndarray:
    r = radius.copy()
    if not trunk:
        r[0] = r[1]  # a branch leaves its parent with its own thickness
    return r


def _tube(path: np.ndarray, radius: np.ndarray):
    """Return a tube with a pointed end; its open start lies within the parent, or on the ground."""
    sides = int(np.clip(2 * round(np.pi * float(np.median(radius)) / EDGE), 4, 20))
    tangent = np.gradient(path, axis=0)
    tangent /= np.sqrt((tangent * tangent).sum(axis=1, keepdims=True))
    tangent[0] = [0, 0, 1] if path[0, 2] == 0 else tangent[0]  # the trunk's foot is cut level
    side = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    turn = 2 * np.pi * np.arange(sides) / sides
    rings = []
    for p, t, r in zip(path[:-1], tangent, radius, strict=False):
        side = side - t * float(side @ t)  # carried along without twisting
        side = side / np.sqrt(float(side @ side))
        other = np.cross(t, side)
        rings.append(p + r * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other))
    vertices = np.concatenate([*rings, path[-1:]])
    k, j = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = []
    for i in range(len(rings) - 1):
        a, b, c, d = i * sides + k, i * sides + j, (i + 1) * sides + j, (i + 1) * sides + k
        faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    last = (len(rings) - 1) * sides
    faces.append(np.stack([last + k, last + j, np.full(sides, len(vertices) - 1)], axis=1))
    return vertices, np.concatenate(faces)


# A leaf in units of length, half width, height: base, three vertices across twice, tip.
LEAF = np.array(
    [
        [0, 0, 0],
        [0.36, 1, 1],
        [0.36, 0, 0],
        [0.36, -1, 1],
        [0.70, 0.72, 0.8],
        [0.70, 0, 0],
        [0.70, -0.72, 0.8],
        [1, 0, 0],
    ]
)
LEAF_FACES = np.array([[0, 2, 1], [0, 3, 2], [1, 2, 5], [1, 5, 4], [2, 3, 6], [2, 6, 5], [4, 5, 7], [5, 6, 7]])


def leaves(tree: Skeleton, triangles: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of leaves with exactly so many triangles; the last leaf may be torn."""
    rng = np.random.default_rng(SEED + 1)
    thin = np.flatnonzero((tree.radius < LEAFY * TWIG_RADIUS) & (tree.parent >= 0))
    count = -(-triangles // len(LEAF_FACES))
    node = thin[(np.arange(count) * len(thin)) // count]
    along = tree.position[node] - tree.position[tree.parent[node]]
    along /= np.sqrt((along * along).sum(axis=1, keepdims=True))
    # Each leaf turns on by the golden angle, and leans out of the crown and into the light.
    turn = 2.39996 * np.arange(count) + 0.8 * rng.random(count)
    across = np.cross(along, [0.31, 0.17, 0.94])
    across /= np.sqrt((across * across).sum(axis=1, keepdims=True))
    other = np.cross(along, across)
    outward = tree.position[node] - CROWN_CENTRE
    outward /= np.maximum(np.sqrt((outward * outward).sum(axis=1, keepdims=True)), 1e-9)
    x = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * other + 0.55 * along + 0.35 * outward
    x /= np.sqrt((x * x).sum(axis=1, keepdims=True))
    z = np.array([0, 0, 1.0]) + 0.6 * outward + 0.7 * (rng.random((count, 3)) - 0.5)
    z -= x * (x * z).sum(axis=1, keepdims=True)
    z /= np.sqrt((z * z).sum(axis=1, keepdims=True))
    y = np.cross(z, x)
    size = (0.75 + 0.5 * rng.random(count))[:, None, None]
    u, v, h = LEAF.T
    local = u * LEAF_LENGTH, v * LEAF_WIDTH / 2, h * FOLD * LEAF_WIDTH / 2 - DROOP * LEAF_LENGTH * u * u * 0.5
    stalk = tree.position[node] + x * tree.radius[node][:, None]
    shape = sum(a[None, :, None] * axis[:, None] for a, axis in zip(local, (x, y, z), strict=True))
    vertices = (stalk[:, None] + size * shape).reshape(-1, 3)
    faces = (LEAF_FACES[None] + len(LEAF) * np.arange(count)[:, None, None]).reshape(-1, 3)
    return vertices, faces[:triangles]
