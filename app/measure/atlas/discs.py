"""Failures of discs: at walls, corners, curves, shadow edges, by size."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from app.measure.atlas.row import (
    BLACK,
    CONTROL,
    FURNACE,
    SUN,
    AtlasRow,
    Number,
    View,
    ball,
    beyond,
    box,
    control_off_and_on,
    floor,
    furnace,
    joined,
    near,
    ratios,
    scene,
    sheet,
    solved,
)
from gi_core.scene import Material, PointLight

SETTING: dict[str, Any] = {**CONTROL, "radius": 0.1}


def walls_and_corners() -> Iterator[AtlasRow]:
    """In a furnace E is the same everywhere; the part of a disc behind a wall is missing."""
    room, radius = furnace(20), 0.1
    along = np.linspace(0.3, 0.7, 9)
    places = {
        "corner": (near(*np.indices((2, 2, 2)).reshape(3, -1).T), 0.25, "in a corner of three walls"),
        "edge": (near(*[(x, 0, 0) for x in along], *[(x, 1, 1) for x in along]), 0.5, "at the edge of two walls"),
        "wall": (near(*[(x, 0.05, 0) for x in along]), 1 - beyond(0.05, radius), "half a radius before a wall"),
    }
    settings = control_off_and_on(radius)
    measured, helped = ratios(room, 100_000, [p for p, _, _ in places.values()], settings, truth=FURNACE)
    for (key, (_, share, where)), m, h in zip(places.items(), measured, helped, strict=True):
        yield AtlasRow(
            f"room_{key}", f"tangent_plane without control, {where}", "the share of the disc that light can reach",
            share, m, "artifact control: divide by the reachable area", h, cost="24 % of frame time",
            view=View(room, 100_000, settings[0], settings[1]) if key == "corner" else None,
            title="A disc in a corner, at an edge, before a wall",
        )  # fmt: skip


def table_leg() -> Iterator[AtlasRow]:
    """A post stands in the disc: its foot hides its own area."""
    side, radius, gap = 0.1, 0.2, 0.05
    post = box((0.5, 0.45, 0), (0.5 + side, 0.45 + side, 0.6), 4)
    room = furnace(20, post)
    settings = control_off_and_on(radius)
    sides = near((0.5 - gap, 0.5, 0), (0.6 + gap, 0.5, 0), (0.55, 0.45 - gap, 0), (0.55, 0.55 + gap, 0))
    (m,), (h,) = ratios(room, 50_000, [sides], settings, truth=FURNACE)
    yield AtlasRow(
        "leg", "tangent_plane without control, 5 cm beside a table leg of 10 cm, radius 20 cm", "1 - a² / πr²",
        1 - side * side / (math.pi * radius * radius), m,
        "artifact control: the part of the disc that is seen from its middle", h,
        view=View(room, 50_000, settings[0], settings[1]), title="A disc round the leg of a table",
    )  # fmt: skip


def curved_inside() -> Iterator[AtlasRow]:
    """Inside a sphere every tangent disc lies behind the surface: nothing would cross it before its hit.

    The concave rule is always on: on its own smooth patch a segment counts up to 2r behind its hit.
    """
    glow = Material("glow", (0.5,) * 3, (1.0, 1.0, 1.0))
    hollow = scene(ball(1.0, 24, inward=True), (glow,), (0, -3.6, 1), (0, 0, 0))
    settings = control_off_and_on(0.15)

    def belt(receivers):
        return np.abs(receivers.positions[:, 2]) < 0.7

    (m,), (h,) = ratios(hollow, 50_000, [belt], settings, truth=FURNACE)
    yield AtlasRow(
        "concave", "tangent_plane, inside of a sphere: the surface rises through its own disc",
        "0 without the concave rule; 1 with it, which is always on", 1.0, m,
        "on its own smooth patch a segment counts up to 2r behind its hit", h,
        within=0.025,  # the steepest segments end their 2r before they reach the disc
        view=View(hollow, 50_000, settings[1], None, "tangent_plane with the rule; the half before it is not drawn"),
        title="A disc inside a sphere",
    )  # fmt: skip


def larger_than_the_room() -> Iterator[AtlasRow]:
    """A disc that holds the whole wall measures its flux over the disc's area; the error saturates, nothing breaks."""
    room = furnace(4)
    middles = near((0.5, 0.5, 0), (0.5, 0.5, 1), (0, 0.5, 0.5), (1, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 1, 0.5))
    for radius in (1.0, 4.0):
        settings = control_off_and_on(radius)
        (m,), (h,) = ratios(room, 20_000, [middles], settings, truth=FURNACE)
        yield AtlasRow(
            f"huge_{radius:g}", f"tangent_plane without control, radius {radius:g} m in a room of 1 m",
            "wall over disc: 1 / πr²", 1 / (math.pi * radius * radius), m, "artifact control", h,
            view=View(room, 20_000, settings[0], settings[1]) if radius == 1 else None,
            title="A disc larger than the room",
        )  # fmt: skip


def smaller_and_smaller() -> Iterator[AtlasRow]:
    """Noise of a disc is the noise of its count, 1 / sqrt(N E pi r² / Phi), so it is proportional to 1 / r."""
    room, photons, seeds = furnace(16), 20_000, 3
    flux = 6 * math.pi  # of the room's walls
    for radius in (0.04, 0.02, 0.01):
        spread = []
        for seed in range(seeds):
            solver = solved(room, photons, seed, **CONTROL, radius=radius)
            inner = np.sort(np.minimum(solver.receivers.positions, 1 - solver.receivers.positions), axis=1)[:, 1] > 0.1
            E = solver.irradiance[inner, 1] / FURNACE
            assert np.isfinite(E).all()
            spread.append(E.std())
        error = np.mean(spread) / math.sqrt(2 * seeds * int(inner.sum()))
        expected = math.sqrt(flux / (photons * FURNACE * math.pi * radius * radius))
        yield AtlasRow(
            f"noise_{radius:g}", f"tangent_plane, {photons:,} photons, radius {radius:g} m in a room of 1 m",
            "noise √(Φ / N E πr²)", expected,
            Number(float(np.mean(spread)), float(error), seeds * int(inner.sum())),
            "a larger radius, or more photons by its square", None,
            within=0.03 * expected,  # a photon crosses a disc more than once; Sobol photons lie a little more evenly
            quantity="standard deviation of E / truth", title="The radius to 0",
            view=View(room, photons, {**CONTROL, "radius": radius}, SETTING) if radius == 0.02 else None,
        )  # fmt: skip


def shadow_edge() -> Iterator[AtlasRow]:
    """Half a floor in the shadow of a plate: a disc across the edge holds its share of light, lit or dark itself."""
    plate = sheet((-1.5, -1.5, 1), (0, 3, 0), (1.5, 0, 0), (1, 1), 1)
    half = scene(
        joined(floor(40), plate), (BLACK, BLACK._replace(two_sided=True)), (0.6, -2.2, 1.4), (0.2, 0, 0), (SUN,)
    )
    coarse, fine = {**CONTROL, "radius": 0.2}, {**CONTROL, "radius": 0.05}
    offsets = (-0.1, 0.1)
    places = [near(*[(x, y, 0) for y in np.linspace(-0.6, 0.6, 25)]) for x in offsets]
    measured, helped = ratios(half, 100_000, places, [coarse, fine])
    for x, m, h in zip(offsets, measured, helped, strict=True):
        yield AtlasRow(
            f"shadow_{'lit' if x > 0 else 'dark'}",
            f"tangent_plane, radius 0.2 m, 0.1 m {'before' if x > 0 else 'behind'} a hard shadow's edge",
            "the share of the disc that is lit: edges blur over ± r", beyond(-x, 0.2), m, "a radius of 0.05 m", h,
            aim=1.0 if x > 0 else 0.0, cost="16 times the photons for the same noise",
            view=View(half, 200_000, coarse, fine) if x > 0 else None, quantity="E / that of the lit side",
            title="The edge of a hard shadow",
        )  # fmt: skip


def lamp_near_a_surface() -> Iterator[AtlasRow]:
    """A point light a height h over the floor: the disc's mean of I h / (h² + x²)^1.5, over I / h² at its foot."""
    h, radius = 0.1, 0.2
    lamp = PointLight("lamp", (0, 0, h), (4 * math.pi,) * 3)
    ground = scene(floor(40), (BLACK,), (0, -1.6, 1.2), (0, 0, 0), (lamp,))
    coarse, fine = {**CONTROL, "radius": radius}, {**CONTROL, "radius": 0.01}
    (m,), (n,) = ratios(ground, 200_000, [near((0, 0, 0))], [coarse, fine], truth=1 / h**2)
    yield AtlasRow(
        "small_lamp", "tangent_plane, radius 0.2 m, at the foot of a point light 0.1 m above",
        "2h² / r² (1 - h / √(h² + r²))", 2 * h * h / radius**2 * (1 - h / math.hypot(h, radius)), m,
        "a radius of a tenth of the height", n, aim=2 * 100 * (1 - 1 / math.hypot(1, 0.1)),
        view=View(ground, 200_000, coarse, fine), title="A small lamp near a surface",
    )  # fmt: skip
