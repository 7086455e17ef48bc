"""Meshes and rays on which structures of rays must agree, the awkward ones among them."""

from collections.abc import Callable

import numpy as np

from gi_core.scene.types import Mesh
from tests.support.scene_builders import box, merge, quad, sphere

Rays = tuple[np.ndarray, np.ndarray]  # origins and directions (n, 3) float32


def of_corners(corners: np.ndarray) -> Mesh:
    """Return a mesh of separate triangles (n, 3, 3), rounded to float32."""
    n = len(corners)
    points = np.asarray(corners, np.float32).astype(np.float64).reshape(-1, 3)
    return Mesh(points, np.arange(3 * n, dtype=np.int32).reshape(-1, 3), np.zeros(n, np.int32))


def soup(triangles: int, seed: int = 0, size: float = 0.4) -> Mesh:
    """Triangles of any shape and position in a cube of 2 m."""
    rng = np.random.default_rng(seed)
    return of_corners(rng.uniform(-1, 1, (triangles, 1, 3)) + rng.uniform(-size, size, (triangles, 3, 3)))


def room(scale: float = 1.0) -> Mesh:
    """A closed room with a ball in a corner; its walls are grids whose vertices float32 rounds."""
    mesh = merge(box((0, 0, 0), (1, 1, 1), 7, 0, inward=True), sphere((0.1, 0.1, 0.1), 0.05, 2, 0))
    return mesh._replace(vertices=(scale * mesh.vertices).astype(np.float32).astype(np.float64))


def directions(rng, n: int) -> np.ndarray:
    d = rng.normal(size=(n, 3))
    return (d / np.linalg.norm(d, axis=1)[:, None]).astype(np.float32)


def aimed_at(mesh: Mesh, origins: np.ndarray, rng, where: str) -> np.ndarray:
    """Return directions (n, 3) float32 from origins to vertices of the mesh, or to points on its edges."""
    face = rng.integers(0, len(mesh.faces), len(origins))
    a, b = (mesh.vertices[mesh.faces[face, k]] for k in (0, 1))
    share = 0.0 if where == "vertices" else rng.uniform(0, 1, (len(origins), 1))
    to = a + share * (b - a) - origins.astype(np.float64)
    return (to / np.linalg.norm(to, axis=1)[:, None]).astype(np.float32)


def _random(n: int, scale: float = 1.0) -> tuple[Mesh, Rays]:
    rng, mesh = np.random.default_rng(1), soup(300)
    origins = (scale * rng.uniform(-1.5, 1.5, (n, 3))).astype(np.float32)
    return mesh._replace(vertices=scale * mesh.vertices), (origins, directions(rng, n))


def _aimed(n: int, where: str) -> tuple[Mesh, Rays]:
    rng, mesh = np.random.default_rng(2), merge(room(), box((0.3, 0.3, 0.3), (0.6, 0.6, 0.6), 2, 0))
    origins = rng.uniform(0.05, 0.95, (n, 3)).astype(np.float32)
    return mesh, (origins, aimed_at(mesh, origins, rng, where))


def _axis_parallel(n: int, zero: float = 0.0) -> tuple[Mesh, Rays]:
    """Rays along the axes, half of them from multiples of 1/8: through vertices, along edges, within faces."""
    rng = np.random.default_rng(4)
    corners = rng.integers(-8, 9, (300, 1, 3)) / 8 + rng.integers(-2, 3, (300, 3, 3)) / 8
    origins = rng.uniform(-1.5, 1.5, (n, 3))
    origins[::2] = rng.integers(-12, 13, (len(origins[::2]), 3)) / 8
    d = np.full((n, 3), zero)
    d[np.arange(n), rng.integers(0, 3, n)] = rng.choice([-1.0, 1.0], n)
    return of_corners(corners), (origins.astype(np.float32), d.astype(np.float32))


def _in_cell_faces(n: int) -> tuple[Mesh, Rays]:
    """Rays within the planes that halve the box of the mesh again and again, and within its sides."""
    rng = np.random.default_rng(5)
    mesh = merge(of_corners([[[-1, -1, -1], [1, 1, 1], [1, -1, 1]]]), soup(200, 6, 0.1))
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    origins, d = rng.uniform(-1.5, 1.5, (n, 3)), directions(rng, n)
    axis = rng.integers(0, 3, n)
    origins[np.arange(n), axis] = (low + (high - low) * rng.integers(0, 9, (n, 1)) / 8)[np.arange(n), axis]
    d[np.arange(n), axis] = 0.0
    return mesh, (origins.astype(np.float32), (d / np.linalg.norm(d, axis=1)[:, None]).astype(np.float32))


def _degenerate(n: int) -> tuple[Mesh, Rays]:
    """Points, needles and slivers among triangles; rays aimed at them."""
    rng, good = np.random.default_rng(7), soup(100)
    a, b = rng.uniform(-1, 1, (2, 90, 1, 3))
    share = rng.uniform(0, 1, (90, 3, 1))
    share[:30] = 0.5  # all three corners in one point
    thin = a + share * (b - a)
    thin[60:] += 1e-6 * rng.normal(size=(30, 3, 3))
    mesh = merge(good, of_corners(thin))
    origins = rng.uniform(-1.5, 1.5, (n, 3)).astype(np.float32)
    return mesh, (origins, aimed_at(mesh, origins, rng, "edges"))


def _far_origin(n: int) -> tuple[Mesh, Rays]:
    """Rays that come from as far as 1,000 sizes of the mesh."""
    rng, mesh = np.random.default_rng(8), soup(300)
    origins = directions(rng, n) * (10.0 ** rng.uniform(0.5, 3.3, (n, 1))).astype(np.float32)
    to = rng.uniform(-1, 1, (n, 3)) - origins
    return mesh, (origins, (to / np.linalg.norm(to, axis=1)[:, None]).astype(np.float32))


def _on_surfaces(n: int) -> tuple[Mesh, Rays]:
    """Rays that start on triangles, some of them within."""
    rng, mesh = np.random.default_rng(9), room()
    face = rng.integers(0, len(mesh.faces), n)
    corners = mesh.vertices[mesh.faces[face]]
    origins = (corners * rng.dirichlet((1, 1, 1), n)[:, :, None]).sum(axis=1).astype(np.float32)
    d = directions(rng, n)
    within = corners[:, 1] - corners[:, 0]
    d[::4] = (within / np.linalg.norm(within, axis=1)[:, None])[::4]
    return mesh, (origins, d)


def _room(n: int) -> tuple[Mesh, Rays]:
    rng = np.random.default_rng(10)
    return room(), (rng.uniform(0.2, 0.8, (n, 3)).astype(np.float32), directions(rng, n))


def _sheets(n: int) -> tuple[Mesh, Rays]:
    """Two lattices of different triangles in one tilted plane, as the layers of some files."""
    rng, where = np.random.default_rng(11), ((-1.0, -1.0, 0.3), (2.0, 0.1, 0.2), (0.3, 2.0, -0.4))
    mesh = merge(quad(*where, (7, 7)), quad(*where, (5, 5)))
    return mesh, (rng.uniform(-1, 1, (n, 3)).astype(np.float32), directions(rng, n))


def strays(ours, theirs) -> int:
    """Return how many rays' faces differ at distances that differ by more than 1e-5, of answers (distance, face, ...).

    Where faces overlap in one plane, rounding decides which is hit.
    """
    far = np.abs(ours[0].astype(np.float64) - theirs[0]) > 1e-5 * np.abs(ours[0])
    return int(((ours[1] != theirs[1]) & far).sum())


def _few(n: int, triangles: int) -> tuple[Mesh, Rays]:
    return soup(triangles), _random(n)[1]


CASES: dict[str, Callable[[int], tuple[Mesh, Rays]]] = {
    "random": _random,
    "vertices": lambda n: _aimed(n, "vertices"),
    "edges": lambda n: _aimed(n, "edges"),
    "axis-parallel": _axis_parallel,
    "nearly axis-parallel": lambda n: _axis_parallel(n, 1e-30),
    "faces of cells": _in_cell_faces,
    "degenerate": _degenerate,
    "far origin": _far_origin,
    "on surfaces": _on_surfaces,
    "room": _room,
    "sheets": _sheets,
    "scale 1e-3": lambda n: _random(n, 1e-3),
    "scale 1e3": lambda n: _random(n, 1e3),
    "empty": lambda n: _few(n, 0),
    "one triangle": lambda n: _few(n, 1),
}
