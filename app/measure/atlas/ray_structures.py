"""Failures of ray structures: triangles tested per ray, where each structure tests most of them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from app.measure.atlas.row import AtlasRow, Number
from app.measure.atlas.shapes import ball, box
from gi_core.instruments.ray_timing import Rays, built, run_of

RAYS = 1000
HALL, DENSE, MIDDLE = 100.0, 0.2, 47.5  # side of a hall, radius of a dense object, its place on all axes [m]
TRIANGLES = 1000
BVH = "`--rays bvh`"


def rows() -> Iterator[AtlasRow]:
    """Measure every structure where it fails."""
    rng = np.random.default_rng(0)
    anywhere = _rays(rng.uniform(0, 1, (RAYS, 3)), rng.normal(size=(RAYS, 3)))
    at = rng.uniform(0, 1, (TRIANGLES, 1, 3))
    soup = np.concatenate([at, at + rng.uniform(-0.02, 0.02, (TRIANGLES, 2, 3))], axis=1)
    yield _row("none", "none", "small triangles anywhere", "every ray tests all triangles", soup, anywhere)

    dense, walls = ball(DENSE), box((0.0,) * 3, (HALL,) * 3)
    hall = (MIDDLE + dense.vertices)[dense.faces], walls.vertices[walls.faces]
    start = rng.uniform(0.1, 0.9, (RAYS, 3)) * HALL
    aimed = _rays(start, MIDDLE - start)
    where = f"a ball of {2 * DENSE:g} m in a hall of {HALL:g} m, rays aimed at it"
    theory = "the ball lies in one cell: a ray that enters it tests all of the ball's triangles"
    yield _row("grid3d", "grid3d", where, theory, np.concatenate(hall), aimed, len(dense.faces))

    ends = rng.choice([-0.5, 0.5], (TRIANGLES, 1, 3))
    slivers = np.concatenate([at, at + ends, at + 1e-3 * rng.normal(size=at.shape)], axis=1)
    theory = "slivers along diagonals have large boxes and planes: nearly every cell lists nearly all of them"
    yield _row("octree", "octree", "slivers along diagonals", theory, slivers, anywhere, known=TRIANGLES / 2)

    along, wide = rng.uniform(0, 0.02, (TRIANGLES, 1, 3)), 0.02 * rng.normal(size=(TRIANGLES, 1, 3))
    bundle = np.concatenate([along, along + 1, along + 1 + wide], axis=1)
    theory = "every plane across an axis cuts all of them: the root is not divided. Boxes of a bvh all overlap"
    yield _row("bsp", "bsp", "a bundle of long triangles along the diagonal", theory, bundle, anywhere, helped=False)


def _rays(origins, directions) -> Rays:
    d = directions / np.linalg.norm(directions, axis=1)[:, None]
    limits = np.full(len(origins), 1e4, np.float32)
    return Rays(origins.astype(np.float32), d.astype(np.float32), limits, False)


def _tests(name: str, corners: np.ndarray, rays: Rays) -> Number:
    """Return triangles tested per ray against separate triangles (n, 3, 3)."""
    mesh = corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return Number(run_of(built(name, [mesh]), rays, all_rays=True)().tests)


def _row(key, name, where, theory, corners, rays, predicted=TRIANGLES, known=0.0, helped=True) -> AtlasRow:
    least = math.log2(len(corners))
    return AtlasRow(
        f"rays_{key}",
        f"{name}: {where}",
        theory,
        float(predicted),
        _tests(name, corners, rays),
        BVH if helped else "none, but shorter triangles (`--max-edge`)",
        _tests("bvh", corners, rays) if helped else None,
        aim=least,
        known=known,
        aim_known=TRIANGLES / 4 if known else 2 * least,
        quantity="triangles tested per ray",
        title="Structures of rays",
    )
