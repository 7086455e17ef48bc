"""Failures of structures of rays: where each tests many triangles per ray."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from app.measure.atlas.row import AtlasRow, Number, ball, box
from gi_core.instruments.timing import Rays, boxes_crossed, built, run_of

SOUP_TRIANGLES = 1000


def ray_structures() -> Iterator[AtlasRow]:
    """Measure every structure where it fails."""
    cast = 1000  # rays
    rng = np.random.default_rng(0)
    anywhere = _rays(rng.uniform(0, 1, (cast, 3)), rng.normal(size=(cast, 3)))
    at = rng.uniform(0, 1, (SOUP_TRIANGLES, 1, 3))
    soup = np.concatenate([at, at + rng.uniform(-0.02, 0.02, (SOUP_TRIANGLES, 2, 3))], axis=1)
    yield _row("none", "small triangles anywhere", "every ray tests all triangles", soup, anywhere)

    side, middle = 100.0, 47.5  # of a hall, place of a ball on all axes [m]
    dense, walls = ball(0.2), box((0.0,) * 3, (side,) * 3)
    hall = (middle + dense.vertices)[dense.faces], walls.vertices[walls.faces]
    start = rng.uniform(0.1, 0.9, (cast, 3)) * side
    aimed = _rays(start, middle - start)
    where = f"a ball of 0.4 m in a hall of {side:g} m, rays aimed at it"
    theory = "the ball lies in one cell: a ray that enters it tests all of the ball's triangles"
    yield _row("grid3d", where, theory, np.concatenate(hall), aimed, len(dense.faces))

    tiny = ball(0.002)
    hall = (middle + tiny.vertices)[tiny.faces], walls.vertices[walls.faces]
    where = "a ball of 4 mm in that hall, rays aimed at it"
    theory = "the smallest cells, 12 levels deep, are larger than the ball: one lists all of its triangles"
    yield _row("octree", where, theory, np.concatenate(hall), aimed, len(tiny.faces), within=len(walls.faces))

    ends = rng.choice([-0.5, 0.5], (SOUP_TRIANGLES, 1, 3))
    slivers = np.concatenate([at, at + ends, at + 1e-3 * rng.normal(size=at.shape)], axis=1)
    mean = float(boxes_crossed(slivers.min(axis=1), slivers.max(axis=1), anywhere).mean())
    theory = "a ray tests each sliver whose box it crosses, and those in the same leaf; an octree divides the slivers"
    # a bvh adds 0.5 of the tests: a leaf holds up to four triangles
    yield _row("bvh", "slivers along diagonals", theory, slivers, anywhere, mean, "octree", 0.5 * mean)

    along, wide = rng.uniform(0, 0.02, (SOUP_TRIANGLES, 1, 3)), 0.02 * rng.normal(size=(SOUP_TRIANGLES, 1, 3))
    bundle = np.concatenate([along, along + 1, along + 1 + wide], axis=1)
    theory = "planes across an axis cut all of them, but at the ends of the bundle. Boxes of a bvh all overlap"
    # 20 tests that cells at the ends of a bundle add
    where = "a bundle of long triangles along the diagonal"
    yield _row("bsp", where, theory, bundle, anywhere, helper=None, within=20)


def _rays(origins, directions) -> Rays:
    d = directions / np.linalg.norm(directions, axis=1)[:, None]
    limits = np.full(len(origins), 1e4, np.float32)
    return Rays(origins.astype(np.float32), d.astype(np.float32), limits, False)


def _tests(name: str, corners: np.ndarray, rays: Rays) -> Number:
    """Return triangles tested per ray against separate triangles (n, 3, 3)."""
    mesh = corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return Number(run_of(built(name, [mesh]), rays, all_rays=True)().tests)


def _row(name, where, theory, corners, rays, predicted=SOUP_TRIANGLES, helper="bvh", within=0.0):
    """Return the row of a structure; helper: a structure that tests fewer, None for none."""
    least = math.log2(len(corners))
    return AtlasRow(
        f"rays_{name}", f"{name}: {where}", theory, float(predicted), _tests(name, corners, rays),
        f"`--rays {helper}`" if helper else "none, but shorter triangles (`--max-edge`)",
        _tests(helper, corners, rays) if helper else None, aim=least, within=within,
        aim_within=(2 if helper == "bvh" else 4) * least, quantity="triangles tested per ray",
        title="Structures of rays",
    )  # fmt: skip
