"""Failures of photon maps: at borders, on small surfaces, across walls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from app.measure.atlas.row import AtlasRow, View, near, ratios
from app.measure.atlas.shapes import BLACK, beyond, box, fan, furnace, joined, scene, sheet
from gi_core.scene import DirectionalLight

SUN = DirectionalLight("sun", (0, 0, -1), (1.0, 1.0, 1.0))
COPIES = 12
NEIGHBOURS = 50
HALF_A_HIT = 0.5 / NEIGHBOURS  # share: Sobol photons are more even than random ones, so k - 1 of them are too few by it
KINDS = [("isolated", a) for a in (30, 60, 90, 120)] + [("fan", a) for a in range(60, 331, 30)] + [("interior", 360)]
SPACING = 2.2


def rows() -> Iterator[AtlasRow]:
    """Measure every failure of photon maps."""
    yield from borders()
    yield from corners()
    yield from small_surfaces()
    yield from thin_wall()


def fans():
    """A field of fans of every angle, each alone in its place, under parallel light: E = 1 at every apex."""
    meshes: list = []
    apexes: dict[tuple[str, int], list[tuple]] = {kind: [] for kind in KINDS}
    for i, (name, angle) in enumerate(KINDS):
        for j in range(COPIES):
            place = (i * SPACING, j * SPACING, 0.0)
            apexes[name, angle].append(place)
            meshes.append(fan(place, angle, step=angle if name == "isolated" else 30))
    middle = np.array([len(KINDS) - 1, COPIES - 1, 0]) * SPACING / 2
    eye = tuple(middle + (0, -24, 24))
    return scene(joined(*meshes), (BLACK._replace(reflectance=(0.5,) * 3),), eye, tuple(middle), (SUN,)), apexes


def borders() -> Iterator[AtlasRow]:
    """Figs 2.9 and 2.10: hits fill alpha of the 2 pi around a border vertex, and are divided by the whole circle."""
    field, apexes = fans()
    photons = 350_000  # k hits of 30 degrees then reach 0.9 of a fan
    places = [near(*apexes[kind]) for kind in KINDS]
    map_: dict[str, Any] = {
        "estimator": "photon_map",
        "neighbours": NEIGHBOURS,
        "radius": 1.0,
        "border_correction": False,
    }
    corrected = {**map_, "border_correction": True}
    measured, helped = ratios(field, photons, places, [map_, corrected])
    for (name, angle), m, h in zip(KINDS, measured, helped, strict=True):
        yield AtlasRow(
            f"border_{name}_{angle}",
            f"photon_map, {name} vertex of {angle}°",
            "α / 2π of the truth: the report's bias 1 - α / 2π",
            angle / 360,
            m,
            "border correction: divide by the angle of the fan (2.9.1)",
            h,
            known=HALF_A_HIT * angle / 360,
            cost="none per frame",
            view=View(field, photons, map_, corrected) if (name, angle) == ("fan", 180) else None,
            title="A photon map at a border vertex",
        )


def corners() -> Iterator[AtlasRow]:
    """Where walls meet, the sphere around a vertex holds hits on all of them: a quarter or half a circle each."""
    room, along = furnace(20), np.linspace(0.3, 0.7, 9)
    places = {
        "in a corner of three walls": (near(*np.indices((2, 2, 2)).reshape(3, -1).T), 0.75),
        "at the edge of two walls": (near(*[(x, 0, 0) for x in along], *[(x, 1, 1) for x in along]), 1.0),
    }
    map_: dict[str, Any] = {"estimator": "photon_map", "neighbours": 200, "radius": 0.3, "border_correction": False}
    settings = [map_, {**map_, "border_correction": True}]
    found, helped = ratios(room, 100_000, [p for p, _ in places.values()], settings, truth=2 * math.pi)
    for (where, (_, share)), m, h in zip(places.items(), found, helped, strict=True):
        yield AtlasRow(
            f"map_corner_{share:g}",
            f"photon_map {where}",
            "the walls' share of a circle: three quarters, two halves",
            share,
            m,
            "border correction: hits on the receiver's own side, divided by the angle that it fills",
            h,
            known=0.5 / 200,
            title="A photon map in corners",
        )


def small_surfaces() -> Iterator[AtlasRow]:
    """A surface with fewer than k hits: all its hits are divided by the largest circle."""
    sizes = (0.15, 0.2, 0.3)
    # Parallel light comes from a disc that covers the scene: two specks far out let it cover all tangent discs.
    meshes = [sheet((-2 + 8 * k, -2 + 26 * k, 0), (0.01, 0, 0), (0, 0.01, 0)) for k in (0, 1)]
    corners: dict[float, list] = {s: [] for s in sizes}
    for i, s in enumerate(sizes):
        for j in range(COPIES):
            meshes.append(sheet((i * 2.0, j * 2.0, 0), (s, 0, 0), (0, s, 0)))
            corners[s].append((i * 2.0, j * 2.0, 0))
    field = scene(joined(*meshes), (BLACK._replace(reflectance=(0.5,) * 3),), (2, -2, 2.2), (2, 2.2, 0), (SUN,))
    map_: dict[str, Any] = {"estimator": "photon_map", "neighbours": 10_000, "radius": 0.5, "border_correction": False}
    plane: dict[str, Any] = {"estimator": "tangent_plane", "radius": 0.2}
    measured, helped = ratios(field, 500_000, [near(*corners[s]) for s in sizes], [map_, plane])
    for s, m, h in zip(sizes, measured, helped, strict=True):
        yield AtlasRow(
            f"small_{s:g}",
            f"photon_map, a square of {s:g} m alone, search radius 0.5 m",
            "its area over the circle's: s² / πR²",
            s * s / (math.pi * 0.25),
            m,
            "tangent_plane",
            h,
            view=View(field, 500_000, map_, plane) if s == 0.3 else None,
            title="A photon map on a small surface",
        )


WALL, AT = 0.002, 0.024  # m thick, and where: between two rows of vertices


def shaded_wall():
    """A floor under slanting parallel light, and a thin black wall across it: beyond, 3 m of full shadow."""
    ground = sheet((-1, -1, 0), (2, 0, 0), (0, 2, 0), (40, 40))
    wall = box((AT, -1.5, 0), (AT + WALL, 1.5, 3.0), 1, 1)
    sun = DirectionalLight("sun", (-1, 0, -1), (math.sqrt(2),) * 3)
    # E of floor and wall is sqrt(2) cos(45) = 1; nothing is reflected.
    return scene(joined(ground, wall), (BLACK, BLACK), (-0.6, -1.6, 1.2), (0, 0, 0), (sun,))


def line(x: float):
    """Return places on the floor of the shaded wall, away from its rim."""
    return near(*[(x, y, 0) for y in np.linspace(-0.5, 0.5, 21)])


def thin_wall() -> Iterator[AtlasRow]:
    """Hits on the lit side of a wall are found from the dark side; a disc reaches through it."""
    place, radius, photons = shaded_wall(), 0.2, 150_000
    map_: dict[str, Any] = {"estimator": "photon_map", "neighbours": 10_000, "radius": radius}
    bare: dict[str, Any] = {"estimator": "tangent_plane", "radius": radius, "control": False}
    plane: dict[str, Any] = {**bare, "control": True}
    dark, lit = -0.05, 0.1
    bare_name = "tangent_plane without control"
    places = [line(dark), line(lit)]
    found = ratios(place, photons, places, [plane, map_, bare])
    helped = found[0]
    for name, setting, (leak, loss) in zip(("photon_map", bare_name), (map_, bare), found[1:], strict=True):
        # Hits on the lit wall lie in the sphere too: half a disc of the sphere's section with it.
        walls = [0.5 * (1 - (d / radius) ** 2) if setting is map_ else 0.0 for d in (AT + WALL - dark, lit - AT - WALL)]
        also = ", and the hits on the wall" if setting is map_ else ""
        view = View(place, photons, setting, plane)
        key = "map" if setting is map_ else "disc"
        yield AtlasRow(
            f"leak_{key}",
            f"{name}, 7 cm behind a wall {WALL * 1000:g} mm thin, radius {radius:g} m",
            "the share of the circle beyond the wall leaks in" + also,
            beyond(AT + WALL - dark, radius) + walls[0],
            leak,
            "tangent_plane with control",
            helped[0],
            aim=0.0,
            view=view,
            quantity="E / that of the lit side",
            title="Across a thin wall",
        )
        yield AtlasRow(
            f"beside_{key}",
            f"{name}, on the lit side, 7 cm before the wall",
            "the share of the circle behind the wall is missing" + also,
            1 - beyond(lit - AT - WALL, radius) + walls[1],
            loss,
            "tangent_plane with control",
            helped[1],
            title="Across a thin wall",
        )
