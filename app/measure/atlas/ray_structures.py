"""Failures of ray structures: triangles tested per ray, where each structure tests most of them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from app.measure.atlas.row import AtlasRow, Number
from app.measure.atlas.shapes import ball, box
from gi_core.instruments.ray_timing import Rays, built, run_of
from gi_core.rays.leaf_boxes import LeafBoxes, visited

RAYS = 1000
HALL, MIDDLE = 100.0, 47.5  # side of a hall, place of an object on all axes [m]
DENSE, TINY = 0.2, 0.002  # radii of balls [m]
TRIANGLES = 1000
ENDS = 20  # tests that cells at the ends of a bundle add
SHARED = 0.5  # of the tests that a bvh adds: a leaf holds up to four triangles


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

    tiny = ball(TINY)
    hall = (MIDDLE + tiny.vertices)[tiny.faces], walls.vertices[walls.faces]
    where = f"a ball of {2e3 * TINY:g} mm in that hall, rays aimed at it"
    theory = "the smallest cells, 12 levels deep, are larger than the ball: one lists all of its triangles"
    yield _row("octree", "octree", where, theory, np.concatenate(hall), aimed, len(tiny.faces), known=len(walls.faces))

    ends = rng.choice([-0.5, 0.5], (TRIANGLES, 1, 3))
    slivers = np.concatenate([at, at + ends, at + 1e-3 * rng.normal(size=at.shape)], axis=1)
    boxes = LeafBoxes(slivers.min(axis=1), slivers.max(axis=1), np.ones(TRIANGLES, np.int64))
    crossed = [visited(boxes, o, d, 1e4).sum() for o, d in zip(anywhere.origin, anywhere.direction, strict=True)]
    mean = float(np.mean(crossed))
    theory = "a ray tests each sliver whose box it crosses, and those in the same leaf; an octree divides the slivers"
    yield _row("bvh", "bvh", "slivers along diagonals", theory, slivers, anywhere, mean, "octree", SHARED * mean)

    along, wide = rng.uniform(0, 0.02, (TRIANGLES, 1, 3)), 0.02 * rng.normal(size=(TRIANGLES, 1, 3))
    bundle = np.concatenate([along, along + 1, along + 1 + wide], axis=1)
    theory = "planes across an axis cut all of them, but at the ends of the bundle. Boxes of a bvh all overlap"
    yield _row(
        "bsp", "bsp", "a bundle of long triangles along the diagonal", theory, bundle, anywhere, helper=None, known=ENDS
    )


def _rays(origins, directions) -> Rays:
    d = directions / np.linalg.norm(directions, axis=1)[:, None]
    limits = np.full(len(origins), 1e4, np.float32)
    return Rays(origins.astype(np.float32), d.astype(np.float32), limits, False)


def _tests(name: str, corners: np.ndarray, rays: Rays) -> Number:
    """Return triangles tested per ray against separate triangles (n, 3, 3)."""
    mesh = corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return Number(run_of(built(name, [mesh]), rays, all_rays=True)().tests)


def _row(key, name, where, theory, corners, rays, predicted=TRIANGLES, helper="bvh", known=0.0):
    """Return the row of a structure; helper: a structure that tests fewer, None for none."""
    least = math.log2(len(corners))
    return AtlasRow(
        f"rays_{key}",
        f"{name}: {where}",
        theory,
        float(predicted),
        _tests(name, corners, rays),
        f"`--rays {helper}`" if helper else "none, but shorter triangles (`--max-edge`)",
        _tests(helper, corners, rays) if helper else None,
        aim=least,
        known=known,
        aim_known=(2 if helper == "bvh" else 4) * least,
        quantity="triangles tested per ray",
        title="Structures of rays",
    )
