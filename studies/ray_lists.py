"""Gloss at vertices by list, by QuadTree and by the report's QuadTree: error, time, memory, and drift.

    python -m studies.ray_lists showroom --photons 200000 --out out/gloss.png    # error against time and memory
    python -m studies.ray_lists --drift 10000 --out out/drift.png                # 10,000 random moves

The first compares cells of all depths with the list of single rays, over 16 eyes, on the glossy receivers whose lobes
are drawn at vertices. The second moves an object at random. It compares list and cells with those from scratch, bit
for bit, and the QuadTree of report 2.10.1 in floats (tests/support/quadtree_2003.py) with a new one of the same rays.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np

from app.measure.chart.figure import need_matplotlib
from app.settings import Settings, make_solver, open_scene
from gi_core.base.random_numbers import basis
from gi_core.bsdf.table import join
from gi_core.gloss.arrivals import DIRECTION_BITS
from gi_core.gloss.hemisphere import CELLS, GRAZING, disc_of
from gi_core.gloss.light import FIELDS
from gi_core.gloss.radiance import Directions, gloss_radiance, room_for
from gi_core.gloss.rays import RECEIVER_BIT
from gi_core.gloss.reflectors import BY_CELLS, ways
from gi_core.gloss.source import LIST, OPENED
from gi_core.retrace.cuts import current_segments
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Pose
from gi_core.solver import Solver
from tests.physics.test_gloss import GIVEN, ROOM
from tests.support.quadtree_2003 import QuadTree2003

DEPTHS = (1, 2, 3, 4, 5)
EYES = 16
REPEATS = 5
VIEWS = 60
CHECK = 250  # moves between comparisons
LOBE = (0.5, 0.5, 0.5, 1.0)
ALPHA = 0.3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="showroom")
    parser.add_argument("--photons", type=int, default=200_000)
    parser.add_argument("--drift", type=int, default=0, metavar="MOVES")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.png")
    given = parser.parse_args()
    need_matplotlib()
    if given.drift:
        drift(given.drift, given.out)
    else:
        depths(given.scene, given.photons, given.out)


def depths(scene: str, photons: int, out: Path) -> None:
    """Print and draw error, time and memory of each way."""
    settings = Settings(scene=scene, photons=photons, gloss=LIST, light="photons")
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    light, s = solver.frame.gloss, solver.surfaces
    given, receivers = light.directions(), solver.model.object_receivers
    first = np.full(len(receivers.areas), -1)
    of_vertices = np.flatnonzero(ways(solver.model).way == BY_CELLS)
    glossy = of_vertices[~np.isnan(s.lobe[of_vertices, 4])]
    first[s.corner_front[glossy].reshape(-1)] = np.repeat(glossy, 3)
    which = np.flatnonzero(first[light.rows] >= 0)
    rows = light.rows[which]
    faces = first[rows]
    tangent = s.tangent[faces] if len(s.tangent) else np.zeros((len(faces), 3))
    one = np.ones((len(rows), 3))
    fixed = which.astype(np.int32), one, receivers.positions[rows], receivers.normals[rows], s.lobe[faces], tangent
    low, high = receivers.positions.min(axis=0), receivers.positions.max(axis=0)
    eyes = low + np.random.default_rng(1).random((EYES, 3)) * (high - low)

    def radiance(directions: Directions) -> tuple[np.ndarray, float]:
        found, times = [], []
        for eye in eyes:
            seen = room_for(len(rows))
            for _ in range(REPEATS):
                start = time.perf_counter()
                gloss_radiance(directions, *fixed, s.tables, eye, seen)
                times.append(time.perf_counter() - start)
            found.append(seen.copy())
        return np.array(found), float(np.median(times))

    exact, seconds = radiance(given._replace(opened=OPENED[LIST]))
    held = np.diff(given.offsets[::CELLS])[which]
    print(f"{scene}, {solver.frame.photons:,} photons, {len(rows):,} receivers, {held.mean():.0f} rays per receiver")
    points = [("list", 0.0, seconds, float(held.mean()) * 24)]
    for share in (1 / 16, 1 / 64, 1 / 256):
        seen, seconds = radiance(given._replace(opened=share))
        points.append((f"all rays, {share:.4f}", _l1(seen, exact), seconds, held.mean() * 24 + CELLS * 24))
    for depth in DEPTHS:
        cells = _cells(given, light.rows, receivers.normals, depth)
        seen, seconds = radiance(Directions(cells, np.zeros(1, np.int64), np.empty((0, FIELDS), np.float32)))
        points.append((f"{4**depth} cells", _l1(seen, exact), seconds, 4**depth * 24))
    for name, error, seconds, size in points:
        print(f"{name:18} error {100 * error:6.2f} %  {1e6 * seconds / len(rows):7.3f} us  {size:8.0f} B per receiver")
    _draw(points, len(rows), out)


def _l1(seen: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs(seen - exact).sum() / exact.sum())


def _cells(given: Directions, rows: np.ndarray, normals: np.ndarray, depth: int) -> np.ndarray:
    """Return the rays of receivers, summed in 4^depth cells: (n, 4^depth, 6) float32."""
    side, n = 2**depth, len(rows)
    receiver = np.repeat(np.arange(n), np.diff(given.offsets[::CELLS]))
    axes = np.array([basis(*normal) for normal in normals[rows]]).reshape(n, 2, 3)
    frames = np.concatenate([axes, normals[rows][:, None]], axis=1)
    local = np.einsum("mij,mj->mi", frames[receiver], given.rays[:, 3:].astype(np.float64))
    place = np.minimum((0.5 * (_square(disc_of(local)) + 1) * side).astype(np.int64), side - 1)
    cell = (receiver * side + place[:, 0]) * side + place[:, 1]
    out = np.zeros((n * side * side, 6))
    weight = given.rays[:, :3].sum(axis=1) / np.sqrt(np.maximum(local[:, 2], GRAZING))
    for c in range(3):
        out[:, c] = np.bincount(cell, given.rays[:, c], minlength=len(out))
        out[:, 3 + c] = np.bincount(cell, weight * given.rays[:, 3 + c], minlength=len(out))
    out[:, 3:] /= np.maximum(np.bincount(cell, weight, minlength=len(out)), 1e-30)[:, None]
    return out.reshape(n, side * side, 6).astype(np.float32)


def _square(disc: np.ndarray) -> np.ndarray:
    """Return the points (n, 2) of the square for places on the disc: the concentric map inverted, as cell_of() does."""
    x, y = disc.T
    wide, r = np.abs(x) >= np.abs(y), np.sqrt(x * x + y * y)
    a, b = np.where(wide, x, y), np.where(wide, y, x)
    main = np.copysign(r, a)
    other = main * (4 / math.pi) * np.arctan(b / np.where(a == 0, 1, a))
    return np.stack([np.where(wide, main, other), np.where(wide, other, main)], axis=1)


def _draw(points: list, receivers: int, out: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
    for axis, column, label in ((axes[0], 2, "time per receiver and view [us]"), (axes[1], 3, "bytes per receiver")):
        for kind, marker, below in (("cells", "o", True), ("all rays", "s", False)):
            some = [p for p in points if kind in p[0]]
            along = [p[column] / receivers * 1e6 if column == 2 else p[column] for p in some]
            axis.loglog(along, [100 * p[1] for p in some], marker + "-", label=f"QuadTree: {kind}")
            for x, p in zip(along, some, strict=True):
                text, offset = p[0].replace("all rays, ", ""), (-7, -11) if below else (6, 4)
                place = {
                    "textcoords": "offset points",
                    "ha": "right" if below else "left",
                    "bbox": {"fc": "white", "ec": "none", "pad": 0.5},
                }
                axis.annotate(text, (x, 100 * p[1]), xytext=offset, **place)
        axis.margins(0.25, 0.15)
        exact = points[0][column] / receivers * 1e6 if column == 2 else points[0][column]
        axis.axvline(exact, color="grey", linestyle=":", label="list (error 0)")
        axis.set_xlabel(label)
    axes[0].set_ylabel("error against the list [%]")
    axes[0].legend()
    figure.savefig(out, dpi=110)


def drift(moves: int, out: Path) -> None:
    """Move an object at random; print and draw the error of each tree at one receiver against the list."""
    solver = Solver(ROOM, **GIVEN | {"photons": 1000}, gloss=LIST)
    solver.solve()
    source, rng = solver.frame_light.gloss.source, np.random.default_rng(2)
    lists, cells = source.lists(solver.setting.radius), source.cells(solver.setting.radius, LIST)
    receiver = int(np.argmax(np.diff(solver.frame.gloss.tree.offsets[::CELLS][: lists.discs.count(0) + 1])))
    normal = lists.discs.normals[receiver]
    literal, before, rows = QuadTree2003(), {}, []
    for move in range(moves):
        at = Pose(tuple(0.15 + 0.7 * rng.random(3)), axis_angle((0, 1, 1), 360 * rng.random()))
        solver.move("ball", at)
        now = _rays_at(lists, solver, receiver)
        literal.update([v for k, v in before.items() if k not in now], [v for k, v in now.items() if k not in before])
        before = now
        if move % CHECK and move != moves - 1:
            continue
        change = solver.frame.change
        segments, _ = current_segments(solver.model, change.at, solver.seed, 0, solver.photons)
        scratch, found = lists.from_scratch([segments], change.at), solver.frame.gloss.tree
        assert np.array_equal(found.rays[: len(scratch.rays)], scratch.rays), "the list has drifted"
        sums = cells.current_sums(change)
        assert np.array_equal(sums, cells.from_scratch([segments], change.at)), "the cells have drifted"
        fresh = QuadTree2003()
        fresh.update([], list(now.values()))
        every = np.array([np.concatenate(ray[2:]) for ray in now.values()], np.float32)
        moments = sums[receiver].astype(np.float64)
        moments = moments[moments[:, :3].sum(axis=1) > 0]
        moments[:, 3:6] /= moments[:, 6:] * (1 << DIRECTION_BITS)
        exact = _seen(every, normal)
        errors = [_l1(_seen(r, normal), exact) for r in (moments[:, :6], fresh.rays(), literal.rays())]
        rows.append((move + 1, *errors, literal.needlessly_summarised))
        print(f"{move + 1:6} moves: cells {100 * errors[0]:5.2f} %, new QuadTree of 2003 {100 * errors[1]:5.2f} %, "
              f"updated {100 * errors[2]:6.2f} %, {rows[-1][4]} cells needlessly summarised", flush=True)  # fmt: skip
    _draw_drift(np.array(rows), out)


def _rays_at(lists, solver: Solver, receiver: int) -> dict[int, tuple]:
    """Return the rays of the frame at a receiver by key: (key, cell, flux, direction)."""
    rays = lists._of_frame(solver.frame.change, lists.photons)
    some = rays.where(rays.receiver == receiver)
    cell = (some.key >> (RECEIVER_BIT - 6)) % CELLS
    every = zip(some.key.tolist(), cell.tolist(), some.flux, some.direction, strict=True)
    return {ray[0]: ray for ray in every}


def _seen(rays: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the radiance (VIEWS, 3) of ALPHA's lobe towards spread eyes, from rays (m, 6) at the origin."""
    i = np.arange(VIEWS) + 0.5
    z, phi = 1 - 0.9 * i / VIEWS, math.pi * (1 + 5**0.5) * i
    flat = np.sqrt(1 - z * z)
    ax, ay, az, bx, by, bz = basis(*normal)
    frame = np.array([[ax, ay, az], [bx, by, bz], normal])
    out, none = np.zeros((VIEWS, 3)), np.zeros((1, 3))
    one = none, normal[None], np.array([[*LOBE, ALPHA]]), normal[None], join([])
    given = Directions(rays[None].astype(np.float32), np.zeros(1, np.int64), np.empty((0, FIELDS), np.float32))
    for k, eye in enumerate(np.stack([flat * np.cos(phi), flat * np.sin(phi), z], axis=1) @ frame):
        seen = room_for(1)
        gloss_radiance(given, np.zeros(1, np.int32), np.ones((1, 3)), *one, eye, seen)
        out[k] = seen[0]
    return out


def _draw_drift(rows: np.ndarray, out: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    axis.plot(rows[:, 0], 100 * rows[:, 3], label="QuadTree of the report, updated")
    axis.plot(rows[:, 0], 100 * rows[:, 2], label="QuadTree of the report, new from the same rays")
    axis.plot(rows[:, 0], 100 * rows[:, 1], label="64 cells of integers: updated = from scratch")
    axis.set_xlabel("random moves of an object")
    axis.set_ylabel("error against the list [%]")
    axis.set_ylim(bottom=0)
    axis.legend()
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    main()
