"""Mobiles and lamps in odd places: at, in and over each other, in walls, out of the scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from app.measure.atlas.row import SEEDS, AtlasRow, Number, View, over_seeds, solved
from app.measure.atlas.shapes import BLACK, box, joined, scene, sheet
from app.measure.atlas.tangent_plane import CONTROL
from gi_core.scene import Material, Mobile, PointLight, Pose

SETTING: dict[str, Any] = {**CONTROL, "radius": 0.1}
COUNT: dict[str, Any] = {"estimator": "impact_count"}
GREY = Material("grey", (0.5,) * 3)


def rows() -> Iterator[AtlasRow]:
    """Measure mobiles and lamps at odd places."""
    yield from sparks()
    yield swallowed()
    yield from laid_over()
    yield under_a_box()
    yield from odd_places()


def lit_room(*mobiles: Mobile, more=(), lights=()):
    """A closed grey room of 1 m, a lamp of 0.2 m under its ceiling."""
    lamp = sheet((0.4, 0.4, 0.99), (0, 0.2, 0), (0.2, 0, 0), (1, 1), 1)
    room = box((0, 0, 0), (1, 1, 1), 8, 0, inward=True)
    materials = GREY, Material("lamp", (0.0,) * 3, (10.0,) * 3)
    return scene(joined(room, lamp, *more), materials, (0.5, -1.9, 0.8), (0.5, 0.5, 0.4), lights, mobiles)


def block(half: float = 0.15, height: float = 0.3, at=(0.5, 0.5, 0.0)) -> Mobile:
    return Mobile("block", box((-half, -half, 0), (half, half, height), 4), Pose(at))


def sparks() -> Iterator[AtlasRow]:
    """A point light just above the floor: half of its flux arrives, within some millimetres."""
    for height in (1e-4, 1e-6):
        lamp = PointLight("spark", (0.01, 0.02, height), (1e3,) * 3)
        ground = scene(sheet((-1, -1, 0), (2, 0, 0), (0, 2, 0), (8, 8)), (BLACK,), (0, -1.6, 1.2), (0, 0, 0), (lamp,))

        def run(seed, ground=ground):
            solver = solved(ground, 5000, seed, **COUNT)
            return (float(solver.irradiance[:, 1] @ solver.receivers.areas) / 500.0,)

        (found,) = over_seeds(run, SEEDS)
        yield AtlasRow(
            f"spark_{height:g}",
            f"impact_count, a point light {height:g} m over the floor",
            "no failure: half of its flux arrives",
            1.0,
            found,
            known=1e-3,  # photons within 1e-4 of the horizon, and unevenness of Sobol points
            quantity="flux that arrives / half of that emitted",
            view=View(ground, 5000, SETTING, None, "tangent_plane, the light 0.1 mm over the floor")
            if height == 1e-4
            else None,
            title="A tiny bright lamp at a surface",
        )


def swallowed() -> AtlasRow:
    """Measure the light that leaves a closed mobile over a bulb."""
    bulb = PointLight("bulb", (0.5, 0.5, 0.2), (10.0,) * 3)
    walls = box((0, 0, 0), (1, 1, 1), 8, 0, inward=True)
    looks = (GREY,), (0.5, -1.9, 0.8), (0.5, 0.5, 0.4), (bulb,)
    place = scene(walls, *looks, (block(at=(0.5, 0.5, 0.05)),))
    solver = solved(place, 20_000, **SETTING)
    return AtlasRow(
        "swallowed",
        "tangent_plane, a bulb inside a closed mobile: the room",
        "0: each photon is cut on its way",
        0.0,
        Number(float(solver.irradiance[solver.surfaces.receiver_range(0)].max())),
        quantity="largest E of the room [W/m2]",
        title="A light inside a mobile",
    )


def laid_over() -> Iterator[AtlasRow]:
    """Measure the light that passes a mobile flush over the lamp / the light of the free lamp."""
    plate = Mobile("plate", box((-0.15, -0.15, -0.01), (0.15, 0.15, 0.0), 2, 0), Pose((0.5, 0.5, 0.98)))
    place = lit_room(plate)
    solver = solved(place, 20_000, poses={"plate": Pose((0.5, 0.5, 5.0))}, **SETTING)
    below = np.flatnonzero(solver.receivers.positions[solver.surfaces.receiver_range(0), 2] < 0.9)
    free = solver.irradiance[below].mean()
    for name, height in {"0.1 mm under": 0.9899, "1 µm under": 0.99 - 1e-6, "flush with": 0.99}.items():
        solver.move("plate", Pose((0.5, 0.5, height)))
        yield AtlasRow(
            f"over_{height:.7g}",
            f"tangent_plane, a plate {name} a lamp",
            "0, except photons that leave at the rim or start in a gap thinner than the ray offset",
            0.0,
            Number(float(solver.irradiance[below].mean() / free)),
            known=0.02,
            quantity="E of the room / E without the plate",
            view=View(place, 100_000, SETTING, None, "tangent_plane, the plate 1 cm under the lamp")
            if height == 0.9899
            else None,
            title="A mobile over a lamp",
        )


def under_a_box() -> AtlasRow:
    """Measure light under a box that stands exactly on the floor."""
    place = lit_room(block(0.25, 0.4))
    solver = solved(place, 40_000, **{**SETTING, "radius": 0.08})
    p, n = solver.receivers.positions, solver.receivers.normals
    static = np.arange(len(p)) < solver.surfaces.receiver_range(0).stop
    under = static & (p[:, 2] == 0) & (n[:, 2] > 0.9) & (np.abs(p[:, :2] - 0.5).max(axis=1) < 0.16)
    assert under.any()
    return AtlasRow(
        "under",
        "tangent_plane, the floor under a box that stands on it",
        "0: no leak",
        0.0,
        Number(float(solver.irradiance[under].max())),
        quantity="largest E [W/m2]",
        view=View(place, 100_000, SETTING, None, "tangent_plane, the box stands exactly on the floor"),
        title="A mobile on the floor",
    )


def odd_places() -> Iterator[AtlasRow]:
    """Measure frames against solutions from scratch for mobiles that touch, cross, leave and swallow."""
    small = Mobile("small", box((-0.05, -0.05, 0.1), (0.05, 0.05, 0.2), 2), Pose((0.5, 0.5, 0.0)))
    places = {
        "on the floor, another inside it": (0.5, 0.5, 0.0),
        "half in a wall": (0.0, 0.5, 0.4),
        "half in a corner": (1.0, 1.0, 0.8),
        "outside": (3.0, 0.5, 0.5),
        "10,000 km away": (1e7, -1e7, 1e7),
    }
    for k, (name, at) in enumerate(places.items()):
        yield AtlasRow(
            f"odd_{k}",
            f"tangent_plane, a mobile {name}",
            "0: the bits of a solution from scratch, all finite",
            0.0,
            Number(off((block(at=at), small))),
            quantity="largest difference of E [W/m2]",
            title="Mobiles that touch, cross, swallow and leave",
        )


def off(poses) -> float:
    """Return the largest difference [W/m2] of E from a solution from scratch, inf for NaN."""
    solver = solved(lit_room(*poses), 4000, poses={m.name: m.pose for m in poses}, **SETTING)
    difference = np.abs(solver.irradiance - solver.from_scratch()).max()
    return float(difference) if np.isfinite(solver.irradiance).all() else math.inf
