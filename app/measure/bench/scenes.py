"""Variants of a scene for measuring growth: the same surfaces cut finer, all of them two-sided, or none.

What light does stays what it was but for the sides: a mobile cuts the same photons, so that only the number of
triangles and receivers differs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gi_core.geometry.tessellation import tessellate
from gi_core.scene import Mesh, Scene

GUESSES = 8  # of the longest edge
CLOSE = 0.02  # of the number of triangles wanted
COARSE_CELLS = 20  # of the coarse ground along a side: ten edges of the skirt meet it there, no T-junctions
COARSE_LEAVES = 2460  # of two triangles: with bark, ground and dome 20,000 triangles
TREE = "tree"  # the scene that has a coarse twin


def with_triangles(scene: Scene, triangles: int, coarse: bool) -> Scene:
    """Cut the static part finer until it has about so many triangles; `coarse`: begin with the coarse tree.

    A scene that has as many already stays as it is.
    """
    mesh = coarse_tree(scene) if coarse else scene.static
    return replace(scene, static=_cut(mesh, triangles))


def with_sides(scene: Scene, two_sided: bool) -> Scene:
    """Make every surface two-sided, or every one one-sided."""
    return replace(scene, materials=tuple(m._replace(two_sided=two_sided) for m in scene.materials))


def coarse_tree(scene: Scene) -> Mesh:
    """Return the tree's static part in some 20,000 triangles: wide squares of ground, fewer and plainer leaves."""
    from scenes.make_tree import tree_parts
    from scenes.tree_growth import LEAF

    number = {m.name: k for k, m in enumerate(scene.materials)}
    vertices, faces, materials, first = [], [], [], 0
    for part in tree_parts():
        v, f = part.vertices, part.faces
        if part.material == "ground":
            v, f = _ground(COARSE_CELLS)
        if part.material == "leaf":
            # Leaves keep their outline of four: base, both sides, tip.
            every = max(len(v) // len(LEAF) // COARSE_LEAVES, 1)
            base = len(LEAF) * every * np.arange(min(COARSE_LEAVES, len(v) // len(LEAF) // every))
            f = (np.array([[0, 7, 1], [0, 3, 7]])[None] + base[:, None, None]).reshape(-1, 3)
        vertices.append(v)
        faces.append(f + first)
        materials.append(np.full(len(f), number[part.material], np.int32))
        first += len(v)
    vertices, faces = np.concatenate(vertices), np.concatenate(faces)
    used, index = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], index.reshape(-1, 3).astype(np.int32), np.concatenate(materials))


def _ground(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit square in squares of two triangles that face up."""
    s = np.linspace(0.0, 1.0, cells + 1)
    x, y = np.meshgrid(s, s, indexing="ij")
    i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    a = (i * (cells + 1) + j).reshape(-1)
    b, c, d = a + cells + 1, a + cells + 2, a + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3), faces


def _cut(mesh: Mesh, triangles: int) -> Mesh:
    """Find the longest edge that leaves about so many triangles."""
    if len(mesh.faces) >= (1 - CLOSE) * triangles:
        return mesh
    p = mesh.vertices[mesh.faces]
    crossed = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    area = float(np.sqrt((crossed * crossed).sum(axis=1)).sum()) / 2
    edge, best = 1.5 * float(np.sqrt(area / triangles)), mesh
    for _ in range(GUESSES):
        tried = tessellate(mesh, edge)
        if abs(len(tried.faces) - triangles) < abs(len(best.faces) - triangles):
            best = tried
        if abs(len(tried.faces) - triangles) <= CLOSE * triangles:
            break
        edge *= float(np.sqrt(len(tried.faces) / triangles))  # half the edge: four times the triangles
    return best
