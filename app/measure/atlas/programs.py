"""Failures of programs: many moves, none, extreme scales and places, odd meshes, rays at edges, no photons."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from app.measure.atlas.mobiles import COUNT, SETTING, block, lit_room
from app.measure.atlas.photon_map import SUN
from app.measure.atlas.row import AtlasRow, Number, View, near, ratios, solved
from app.measure.atlas.shapes import BLACK, furnace, scene, sheet
from app.measure.atlas.tangent_plane import CONTROL, FURNACE
from gi_core.scene import Mesh, Pose


def rows() -> Iterator[AtlasRow]:
    """Measure every failure of programs."""
    yield drift()
    yield from at_rest()
    yield from scales()
    yield soup()
    yield from at_edges()
    yield from next_to_nothing()


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
        "drift",
        "1,000 jumps and back to the start",
        "0 bits: each frame comes from the background alone",
        0.0,
        Number(float(np.abs(solver.irradiance - begun).max())),
        quantity="largest change of E [W/m2]",
        view=View(place, 100_000, SETTING, None, "tangent_plane, at the start and again at the end"),
        title="Many moves",
    )


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
            f"rest_{step:g}",
            f"impact_count, a mobile moves by {step:g} m",
            "only photons that are cut before or after can change",
            1.0 if step else 0.0,
            Number(changed),
            known=math.inf if step else 0.0,
            quantity="flux that changes places / flux of all segments of cut photons",
            title="Flicker",
        )


def scales() -> Iterator[AtlasRow]:
    """The same room a thousand times smaller and larger, and far from the origin."""
    cases = {f"a room of {s:g} m": (0.0, s) for s in (1e-3, 1e3)}
    cases |= {f"{d:g} sizes from the origin": (d, 1.0) for d in (3.0, 30.0, 1e6)}
    for name, (low, size) in cases.items():
        room = furnace(4, low=(low,) * 3, high=(low + size,) * 3)
        middles = near(*(low + size * np.array([(0.5, 0.5, 0), (0.5, 0, 0.5)])), tolerance=1e-5 * size)
        setting = {**CONTROL, "radius": 0.1 * size}
        ((found,),) = ratios(room, 50_000, [middles], [setting], truth=FURNACE)
        yield AtlasRow(
            f"scale_{low or size:g}",
            name,
            "no failure: 1",
            1.0,
            found,
            "none needed: meshes farther than 8 sizes are shifted to the origin",
            None,
            title="Scale and place",
        )


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

    ((found,),) = ratios(replace(room, static=loose), 50_000, [with_area], [SETTING], truth=FURNACE)
    return AtlasRow(
        "soup",
        "tangent_plane, a furnace of loose triangles, a point, a needle and an edge among them",
        "no failure: 1",
        1.0,
        found,
        view=View(replace(room, static=loose), 50_000, SETTING, None, "tangent_plane, lit like a whole one"),
        title="Odd meshes",
    )


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
            f"edges_{name}",
            f"rays from the middle of a closed room to its {name}",
            "0 slip through, except by rounding; those count as escaped",
            0.0,
            Number(float((face < 0).mean())),
            known=0.002,
            quantity="share that hits nothing",
            title="Rays through vertices and edges",
        )


def next_to_nothing() -> Iterator[AtlasRow]:
    """No photon, fewer photons than neighbours, a black room."""
    common: dict[str, Any] = {"title": "Next to nothing"}
    dark = solved(lit_room(block()), 0, **SETTING)
    yield AtlasRow(
        "none", "no photon", "0", 0.0, Number(float(dark.irradiance.max())), quantity="largest E [W/m2]", **common
    )
    ground = scene(sheet((-1, -1, 0), (2, 0, 0), (0, 2, 0), (8, 8)), (BLACK,), (0, -1.6, 1.2), (0, 0, 0), (SUN,))
    map_: dict[str, Any] = {"estimator": "photon_map", "neighbours": 1000, "radius": 0.5}
    ((found,),) = ratios(ground, 500, [near((0, 0, 0))], [map_], seeds=16)
    yield AtlasRow(
        "few", "photon_map, k = 1,000 of 500 photons", "no failure: all hits within the radius", 1.0, found, **common
    )
    black = solved(furnace(4, reflectance=0.0), 2000, **COUNT)
    share = float(black.frame.fates["absorbed"][1] / black.frame.fates["emitted"][1])
    quantity = "flux absorbed at the first hit / emitted"
    yield AtlasRow("black", "a black room", "no failure: 1", 1.0, Number(share), quantity=quantity, **common)
