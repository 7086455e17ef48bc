"""Failures of programs: many moves, none, extreme scales, odd meshes, rays at edges, no photons; ray structures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from app.measure.atlas.discs import SETTING, block, lit_room
from app.measure.atlas.row import (
    CONTROL,
    COUNT,
    FURNACE,
    SUN,
    AtlasRow,
    Number,
    View,
    ball,
    box,
    floor_under,
    furnace,
    near,
    ratios,
    solved,
)
from gi_core.instruments.timing import Rays, boxes_crossed, built, run_of
from gi_core.scene import Mesh, Pose


def drift() -> AtlasRow:
    """Measure the difference after a thousand jumps and a return to the start."""
    place = lit_room(block())
    solver = solved(place, 2000, **SETTING)
    start, begun = dict(solver.poses), solver.irradiance.copy()
    for at in np.random.default_rng(0).uniform((0.16, 0.16, 0), (0.84, 0.84, 0.6), (1000, 3)):
        solver.move("block", Pose(tuple(at)))
    assert not np.array_equal(solver.irradiance, begun)
    solver.move_all(start)
    return AtlasRow(
        "drift", "1,000 jumps and back to the start", "0 bits: each frame comes from the background alone", 0.0,
        Number(float(np.abs(solver.irradiance - begun).max())), quantity="largest change of E [W/m2]",
        view=View(place, 100_000, SETTING, None, "tangent_plane, at the start and again at the end"),
        title="Many moves",
    )  # fmt: skip


def at_rest() -> Iterator[AtlasRow]:
    """Measure flicker for a mobile that does not move and one that moves by less than a pixel."""
    solver = solved(lit_room(block()), 20_000, **COUNT)
    rows, areas = solver.surfaces.receiver_range(0), solver.receivers.areas
    a_photon = float(solver.frame.fates["emitted"][1]) / solver.frame.photons
    for step in (0.0, 1e-7, 1e-4):
        solver.move("block", Pose((0.5, 0.5, 0.1)))
        before, old = solver.irradiance[rows, 1].copy(), solver.frame.changes
        solver.move("block", Pose((0.5 + step, 0.5, 0.1)))
        new = solver.frame.changes
        most = a_photon * (old.old_segments + old.new_segments + new.old_segments + new.new_segments)
        changed = float(np.abs(solver.irradiance[rows, 1] - before) @ areas[rows]) / most
        yield AtlasRow(
            f"rest_{step:g}", f"impact_count, a mobile moves by {step:g} m",
            "only photons that are cut before or after can change", 1.0 if step else 0.0, Number(changed),
            within=math.inf if step else 0.0,
            quantity="flux that changes places / flux of all segments of cut photons", title="Flicker",
        )  # fmt: skip


def scales() -> Iterator[AtlasRow]:
    """The same room a thousand times smaller and larger, and far from the origin."""
    cases = {f"a room of {s:g} m": (0.0, s) for s in (1e-3, 1e3)}
    cases |= {f"{d:g} sizes from the origin": (d, 1.0) for d in (3.0, 30.0, 1e6)}
    for name, (low, size) in cases.items():
        room = furnace(4, low=(low,) * 3, high=(low + size,) * 3)
        middles = near(*(low + size * np.array([(0.5, 0.5, 0), (0.5, 0, 0.5)])), tolerance=1e-5 * size)
        setting = {**CONTROL, "radius": 0.1 * size}
        ((ratio,),) = ratios(room, 50_000, [middles], [setting], truth=FURNACE)
        yield AtlasRow(
            f"scale_{low or size:g}", name, "no failure: 1", 1.0, ratio,
            "none needed: meshes farther than 8 sizes are shifted to the origin", None, title="Scale and place",
        )  # fmt: skip


def soup() -> AtlasRow:
    """A room whose triangles share no vertex; among them are a point, a needle and an edge."""
    room = furnace(20)
    mesh = room.static
    points = np.concatenate([mesh.vertices[mesh.faces].reshape(-1, 3), [(0.5, 0.5, 0), (0.5, 0.5 + 1e-12, 0)]])
    n = 3 * len(mesh.faces)
    faces = [*np.arange(n).reshape(-1, 3), (n, n, n), (0, n, n + 1), (n, n + 1, n)]
    loose = Mesh(points, np.array(faces, np.int32), np.zeros(len(faces), np.int32))
    middles = near(*[(x, y, 0) for x in (0.3, 0.5, 0.7) for y in (0.3, 0.5, 0.7)])

    def with_area(receivers):  # receivers of faces without area get no light and are never visible
        return middles(receivers) & (receivers.areas > 1e-9)

    ((ratio,),) = ratios(replace(room, static=loose), 50_000, [with_area], [SETTING], truth=FURNACE)
    return AtlasRow(
        "soup", "tangent_plane, a furnace of loose triangles, a point, a needle and an edge among them",
        "no failure: 1", 1.0, ratio,
        view=View(replace(room, static=loose), 50_000, SETTING, None, "tangent_plane, lit like a whole one"),
        title="Odd meshes",
    )  # fmt: skip


def at_edges() -> Iterator[AtlasRow]:
    """Rays aimed at every vertex, and at the middle of every edge, of a closed room."""
    solver = solved(furnace(8), 1000, **COUNT)
    mesh, middle = solver.scene.static, np.full(3, 0.5)
    for name, targets in {
        "vertices": mesh.vertices,
        "edges": mesh.vertices[mesh.faces[:, [0, 1]]].mean(axis=1),
    }.items():
        d = targets - middle
        d = (d / np.linalg.norm(d, axis=1)[:, None]).astype(np.float32)
        origins, far = np.tile(middle, (len(d), 1)).astype(np.float32), np.full(len(d), 10.0, np.float32)
        _, face = solver.model.accelerator.nearest(0, origins, d, far)
        yield AtlasRow(
            f"edges_{name}", f"rays from the middle of a closed room to its {name}",
            "0 slip through, except by rounding; those count as escaped", 0.0, Number(float((face < 0).mean())),
            within=0.002, quantity="share that hits nothing", title="Rays through vertices and edges",
        )  # fmt: skip


def next_to_nothing() -> Iterator[AtlasRow]:
    """No photon, fewer photons than neighbours, a black room."""
    common: dict[str, Any] = {"title": "Next to nothing"}
    dark = solved(lit_room(block()), 0, **SETTING)
    yield AtlasRow(
        "none", "no photon", "0", 0.0, Number(float(dark.irradiance.max())), quantity="largest E [W/m2]", **common
    )
    ground = floor_under(SUN, 8)
    map_: dict[str, Any] = {"estimator": "photon_map", "neighbours": 1000, "radius": 0.5}
    ((ratio,),) = ratios(ground, 500, [near((0, 0, 0))], [map_], seeds=16)
    yield AtlasRow(
        "few", "photon_map, k = 1,000 of 500 photons", "no failure: all hits within the radius", 1.0, ratio, **common
    )
    black = solved(furnace(4, reflectance=0.0), 2000, **COUNT)
    share = float(black.frame.fates["absorbed"][1] / black.frame.fates["emitted"][1])
    quantity = "flux absorbed at the first hit / emitted"
    yield AtlasRow("black", "a black room", "no failure: 1", 1.0, Number(share), quantity=quantity, **common)


SOUP_TRIANGLES = 1000


def ray_structures() -> Iterator[AtlasRow]:
    """Measure every structure where it fails."""
    cast = 1000  # rays
    rng = np.random.default_rng(0)
    anywhere = _rays(rng.uniform(0, 1, (cast, 3)), rng.normal(size=(cast, 3)))
    at = rng.uniform(0, 1, (SOUP_TRIANGLES, 1, 3))
    soup = np.concatenate([at, at + rng.uniform(-0.02, 0.02, (SOUP_TRIANGLES, 2, 3))], axis=1)
    yield _row("none", "none", "small triangles anywhere", "every ray tests all triangles", soup, anywhere)

    side, middle = 100.0, 47.5  # of a hall, place of a ball on all axes [m]
    dense, walls = ball(0.2), box((0.0,) * 3, (side,) * 3)
    hall = (middle + dense.vertices)[dense.faces], walls.vertices[walls.faces]
    start = rng.uniform(0.1, 0.9, (cast, 3)) * side
    aimed = _rays(start, middle - start)
    where = f"a ball of 0.4 m in a hall of {side:g} m, rays aimed at it"
    theory = "the ball lies in one cell: a ray that enters it tests all of the ball's triangles"
    yield _row("grid3d", "grid3d", where, theory, np.concatenate(hall), aimed, len(dense.faces))

    tiny = ball(0.002)
    hall = (middle + tiny.vertices)[tiny.faces], walls.vertices[walls.faces]
    where = "a ball of 4 mm in that hall, rays aimed at it"
    theory = "the smallest cells, 12 levels deep, are larger than the ball: one lists all of its triangles"
    yield _row("octree", "octree", where, theory, np.concatenate(hall), aimed, len(tiny.faces), within=len(walls.faces))

    ends = rng.choice([-0.5, 0.5], (SOUP_TRIANGLES, 1, 3))
    slivers = np.concatenate([at, at + ends, at + 1e-3 * rng.normal(size=at.shape)], axis=1)
    mean = float(boxes_crossed(slivers.min(axis=1), slivers.max(axis=1), anywhere).mean())
    theory = "a ray tests each sliver whose box it crosses, and those in the same leaf; an octree divides the slivers"
    # a bvh adds 0.5 of the tests: a leaf holds up to four triangles
    yield _row("bvh", "bvh", "slivers along diagonals", theory, slivers, anywhere, mean, "octree", 0.5 * mean)

    along, wide = rng.uniform(0, 0.02, (SOUP_TRIANGLES, 1, 3)), 0.02 * rng.normal(size=(SOUP_TRIANGLES, 1, 3))
    bundle = np.concatenate([along, along + 1, along + 1 + wide], axis=1)
    theory = "planes across an axis cut all of them, but at the ends of the bundle. Boxes of a bvh all overlap"
    # 20 tests that cells at the ends of a bundle add
    where = "a bundle of long triangles along the diagonal"
    yield _row("bsp", "bsp", where, theory, bundle, anywhere, helper=None, within=20)


def _rays(origins, directions) -> Rays:
    d = directions / np.linalg.norm(directions, axis=1)[:, None]
    limits = np.full(len(origins), 1e4, np.float32)
    return Rays(origins.astype(np.float32), d.astype(np.float32), limits, False)


def _tests(name: str, corners: np.ndarray, rays: Rays) -> Number:
    """Return triangles tested per ray against separate triangles (n, 3, 3)."""
    mesh = corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return Number(run_of(built(name, [mesh]), rays, all_rays=True)().tests)


def _row(key, name, where, theory, corners, rays, predicted=SOUP_TRIANGLES, helper="bvh", within=0.0):
    """Return the row of a structure; helper: a structure that tests fewer, None for none."""
    least = math.log2(len(corners))
    return AtlasRow(
        f"rays_{key}", f"{name}: {where}", theory, float(predicted), _tests(name, corners, rays),
        f"`--rays {helper}`" if helper else "none, but shorter triangles (`--max-edge`)",
        _tests(helper, corners, rays) if helper else None, aim=least, within=within,
        aim_within=(2 if helper == "bvh" else 4) * least, quantity="triangles tested per ray",
        title="Structures of rays",
    )  # fmt: skip
