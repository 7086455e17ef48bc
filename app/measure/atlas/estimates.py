"""Failures of photon maps, impact count and sums."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from app.measure.atlas.row import (
    BLACK,
    CONTROL,
    COUNT,
    SEEDS,
    SUN,
    UNCORRECTED,
    AtlasRow,
    Number,
    View,
    beyond,
    box,
    control_off_and_on,
    fan,
    floor,
    furnace,
    joined,
    near,
    over_seeds,
    ratios,
    scene,
    sheet,
    solved,
)
from gi_core.scene import DirectionalLight, Material, Mobile, Pose, SkyLight, SpotLight

COPIES = 12
NEIGHBOURS = 50
HALF_A_HIT = 0.5 / NEIGHBOURS  # share: Sobol photons are more even than random ones, so k - 1 of them are too few by it
KINDS = [("isolated", a) for a in (30, 60, 90, 120)] + [("fan", a) for a in range(60, 331, 30)] + [("interior", 360)]


def fans():
    """A field of fans of every angle, each alone in its place, under parallel light: E = 1 at every apex."""
    copies_apart = 2.2
    meshes: list = []
    apexes: dict[tuple[str, int], list[tuple]] = {kind: [] for kind in KINDS}
    for i, (name, angle) in enumerate(KINDS):
        for j in range(COPIES):
            place = (i * copies_apart, j * copies_apart, 0.0)
            apexes[name, angle].append(place)
            meshes.append(fan(place, angle, step=angle if name == "isolated" else 30))
    middle = np.array([len(KINDS) - 1, COPIES - 1, 0]) * copies_apart / 2
    eye = tuple(middle + (0, -24, 24))
    return scene(joined(*meshes), (BLACK._replace(reflectance=(0.5,) * 3),), eye, tuple(middle), (SUN,)), apexes


def borders() -> Iterator[AtlasRow]:
    """Figs 2.9 and 2.10: hits fill alpha of the 2 pi around a border vertex, and are divided by the whole circle."""
    field, apexes = fans()
    photons = 350_000  # k hits of 30 degrees then reach 0.9 of a fan
    places = [near(*apexes[kind]) for kind in KINDS]
    map_ = UNCORRECTED | {"neighbours": NEIGHBOURS, "radius": 1.0}
    corrected = {**map_, "border_correction": True}
    measured, helped = ratios(field, photons, places, [map_, corrected])
    for (name, angle), m, h in zip(KINDS, measured, helped, strict=True):
        yield AtlasRow(
            f"border_{name}_{angle}", f"photon_map, {name} vertex of {angle}°",
            "α / 2π of the truth: the report's bias 1 - α / 2π", angle / 360, m,
            "border correction: divide by the angle of the fan (2.9.1)", h, within=HALF_A_HIT * angle / 360,
            cost="none per frame",
            view=View(field, photons, map_, corrected) if (name, angle) == ("fan", 180) else None,
            title="A photon map at a border vertex",
        )  # fmt: skip


def corners() -> Iterator[AtlasRow]:
    """Where walls meet, the sphere around a vertex holds hits on all of them: a quarter or half a circle each."""
    room, along = furnace(20), np.linspace(0.3, 0.7, 9)
    places = {
        "in a corner of three walls": (near(*np.indices((2, 2, 2)).reshape(3, -1).T), 0.75),
        "at the edge of two walls": (near(*[(x, 0, 0) for x in along], *[(x, 1, 1) for x in along]), 1.0),
    }
    map_ = UNCORRECTED | {"neighbours": 200, "radius": 0.3}
    settings = [map_, {**map_, "border_correction": True}]
    measured, helped = ratios(room, 100_000, [p for p, _ in places.values()], settings, truth=2 * math.pi)
    for (where, (_, share)), m, h in zip(places.items(), measured, helped, strict=True):
        yield AtlasRow(
            f"map_corner_{share:g}", f"photon_map {where}",
            "the walls' share of a circle: three quarters, two halves", share, m,
            "border correction: hits on the receiver's own side, divided by the angle that it fills", h,
            within=0.5 / 200, title="A photon map in corners",
        )  # fmt: skip


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
    map_, plane = UNCORRECTED | {"neighbours": 10_000, "radius": 0.5}, {**CONTROL, "radius": 0.2}
    measured, helped = ratios(field, 500_000, [near(*corners[s]) for s in sizes], [map_, plane])
    for s, m, h in zip(sizes, measured, helped, strict=True):
        yield AtlasRow(
            f"small_{s:g}", f"photon_map, a square of {s:g} m alone, search radius 0.5 m",
            "its area over the circle's: s² / πR²", s * s / (math.pi * 0.25), m, "tangent_plane", h,
            view=View(field, 500_000, map_, plane) if s == 0.3 else None, title="A photon map on a small surface",
        )  # fmt: skip


WALL, AT = 0.002, 0.024  # m thick, and where: between two rows of vertices


def shaded_wall():
    """A floor under slanting parallel light, and a thin black wall across it: beyond, 3 m of full shadow."""
    wall = box((AT, -1.5, 0), (AT + WALL, 1.5, 3.0), 1, 1)
    sun = DirectionalLight("sun", (-1, 0, -1), (math.sqrt(2),) * 3, disc_degrees=0.0)
    # E of floor and wall is sqrt(2) cos(45) = 1; nothing is reflected.
    return scene(joined(floor(40), wall), (BLACK, BLACK), (-0.6, -1.6, 1.2), (0, 0, 0), (sun,))


def line(x: float):
    """Return places on the floor of the shaded wall, away from its rim."""
    return near(*[(x, y, 0) for y in np.linspace(-0.5, 0.5, 21)])


def thin_wall() -> Iterator[AtlasRow]:
    """Hits on the lit side of a wall are found from the dark side; a disc reaches through it."""
    place, radius, photons = shaded_wall(), 0.2, 150_000
    map_: dict[str, Any] = {"estimator": "photon_map", "neighbours": 10_000, "radius": radius}
    bare, plane = control_off_and_on(radius)
    dark, lit, names = -0.05, 0.1, ("photon_map", "tangent_plane without control")
    helped, *measured = ratios(place, photons, [line(dark), line(lit)], [plane, map_, bare])
    for name, setting, (leak, loss) in zip(names, (map_, bare), measured, strict=True):
        # Hits on the lit wall lie in the sphere too: half a disc of the sphere's section with it.
        walls = [0.5 * (1 - (d / radius) ** 2) if setting is map_ else 0.0 for d in (AT + WALL - dark, lit - AT - WALL)]
        also = ", and the hits on the wall" if setting is map_ else ""
        view = View(place, photons, setting, plane)
        key = "map" if setting is map_ else "disc"
        yield AtlasRow(
            f"leak_{key}", f"{name}, 7 cm behind a wall {WALL * 1000:g} mm thin, radius {radius:g} m",
            "the share of the circle beyond the wall leaks in" + also, beyond(AT + WALL - dark, radius) + walls[0],
            leak, "tangent_plane with control", helped[0], aim=0.0, view=view, quantity="E / that of the lit side",
            title="Across a thin wall",
        )  # fmt: skip
        yield AtlasRow(
            f"beside_{key}", f"{name}, on the lit side, 7 cm before the wall",
            "the share of the circle behind the wall is missing" + also,
            1 - beyond(lit - AT - WALL, radius) + walls[1], loss, "tangent_plane with control", helped[1],
            title="Across a thin wall",
        )  # fmt: skip


NEAREST: dict[str, Any] = {"estimator": "photon_map", "neighbours": 20, "radius": 0.5}


def textbook() -> Iterator[AtlasRow]:
    """The k-th hit sets the radius of the circle; counting it too overestimates."""
    meshes = [fan((2.2 * i, 2.2 * j, 0), 360) for i in range(12) for j in range(12)]
    field = scene(joined(*meshes), (BLACK,), (12, -20, 24), (12, 12, 0), (SUN,))
    apexes = near(*[(2.2 * i, 2.2 * j, 0) for i in range(12) for j in range(12)])
    for k in (5, 20, 50):
        map_: dict[str, Any] = {"estimator": "photon_map", "neighbours": k, "radius": 0.9}

        def run(seed, map_=map_):
            solver, means = solved(field, 200_000, seed, **map_), []
            for form in (True, False):
                solver.configure(textbook=form)
                solver.solve()
                means.append(solver.irradiance[apexes(solver.receivers), 1].mean())
            return means[0] / means[1], means[1]

        ratio, unbiased = over_seeds(run, SEEDS)
        yield AtlasRow(
            f"textbook_{k}", f"photon_map, textbook form, k = {k}", "k / (k - 1) of the unbiased form", k / (k - 1),
            ratio, "count k - 1 hits: `textbook` off, as by default", unbiased, within=1e-6,
            aim_within=0.5 / k,  # Sobol photons are more even than random ones: k - 1 of them are too few
            cost="none", quantity="E / E of the unbiased form", title="The k-th hit, counted",
            view=View(field, 200_000, {**map_, "textbook": True}, map_) if k == 5 else None,
        )  # fmt: skip


def small_faces() -> Iterator[AtlasRow]:
    """A face of area A is hit N E A / Phi times: its noise is proportional to 1 / sqrt(A), for any shape."""
    photons, seeds, copies = 200_000, 6, 100
    shapes = {"0.2 x 0.2": (0.2, 0.2), "0.05 x 0.05": (0.05, 0.05), "a sliver of 0.005 x 0.5": (0.005, 0.5)}
    meshes = [
        sheet((0.6 * i, j, 0), (w, 0, 0), (0, h, 0))
        for i, (w, h) in enumerate(s for s in shapes.values() for _ in range(5))
        for j in range(copies // 5)
    ]
    # Not parallel light: its photons are more even than random ones, by half for ten of them per face.
    sky = SkyLight("sky", (1 / math.pi,) * 3)
    field = scene(joined(*meshes), (BLACK,), (4.5, -3, 3.5), (4.5, 2.5, 0), (sky,))
    spread: dict[str, list[float]] = {name: [] for name in shapes}
    for seed in range(seeds):
        solver = solved(field, photons, seed, **COUNT)
        p, areas = solver.receivers.positions, solver.receivers.areas
        for i, name in enumerate(shapes):
            inside = (p[:, 0] >= 3.0 * i) & (p[:, 0] < 3.0 * (i + 1) - 0.05)
            # One receiver per triangle: of the four corners of a square, the two that belong to one triangle alone.
            alone = inside & (areas < 1.5 * areas[inside].min())
            spread[name].append(solver.irradiance[alone, 1])
    flux = float(solver.model.emitters.total_flux[1])
    for name, (w, h) in shapes.items():
        samples = np.concatenate(spread[name])
        expected = math.sqrt(flux / (photons * w * h / 2))
        yield AtlasRow(
            f"face_{w:g}", f"impact_count, triangles half of {name} m, {photons:,} photons",
            "noise √(Φ / N E A): variance ~ 1 / area", expected,
            Number(float(samples.std()), float(samples.std() / math.sqrt(2 * len(samples))), len(samples)),
            "tangent_plane: the same disc for every triangle", None, within=0.12 * expected,
            quantity="standard deviation of E / truth",
            view=View(field, photons, COUNT, {**CONTROL, "radius": 0.2}) if w == 0.2 else None,
            title="impact_count on small faces and slivers",
        )  # fmt: skip


def blocked_spot():
    """A floor under a blue sky and a red spot light, which a plate blocks."""
    lights = SkyLight("sky", (0.0, 0.0, 0.5)), SpotLight("spot", (0, 0, 1.5), (0, 0, -1), (5.0, 0, 0), 14.0, 15.0)
    plate = Mobile("plate", box((-0.2, -0.2, 0), (0.2, 0.2, 0.02), 3), Pose((0, 0, 1.0)))
    return scene(floor(20), (BLACK._replace(reflectance=(0.5,) * 3),), (0, -2.4, 1.8), (0, 0, 0.3), lights, (plate,))


def naive_sums() -> Iterator[AtlasRow]:
    """Eq. 2.4 with k nearest: each part is divided by its own circle, so the removed part can exceed the whole."""
    place = blocked_spot()
    solver = solved(place, 20_000, **NEAREST)
    model, estimate, frame = solver.model, solver.frame.background.estimate, solver.frame.change
    scale = model.emitters.unit_flux / solver.frame.photons
    static = solver.surfaces.receiver_range(0)

    def read(sums, area):
        return (sums * scale / area[:, None]).reshape(len(area), -1, 3).sum(axis=1)[static]  # over lamps

    parts = [estimate.from_scratch([s], frame.at) for s in (frame.removed_suffixes.segments(), frame.new_suffixes)]
    lost, gained = (read(e.sums, e.area) for e in parts)
    before = read(*estimate.background(solver.frame.photons))
    naive = before - lost + gained
    exact = float(np.abs(solver.irradiance - solver.from_scratch()).max())
    caption = "photon_map as it is done: the spot's red is gone from under the plate, nothing is below 0"
    yield AtlasRow(
        "additive", "photon_map, Eq. 2.4 term by term: E_bg - E(removed) + E(new), red, darkest receiver",
        "below 0: Eq. 2.8 is not additive", 0.0, Number(float(naive[:, 0].min() / before[:, 0].mean())),
        "stale receivers are estimated again from all hits: bits of a solution from scratch", Number(exact), aim=0.0,
        within=math.inf, quantity="E / mean E without the plate", view=View(place, 20_000, NEAREST, None, caption),
        title="k nearest hits are not additive",
    )  # fmt: skip


def beside_a_mobile() -> Iterator[AtlasRow]:
    """The foot of a mobile on the floor: the part of a disc that it covers is missing, as beside a wall."""
    glow, grey = Material("glow", (0.5,) * 3, (1.0, 1.0, 1.0)), Material("grey", (0.5,) * 3)
    radius, half, gap = 0.1, 0.195, 0.005
    block = Mobile("block", box((-half, -half, 0), (half, half, 0.003), 4, 1), Pose((0.5, 0.5, 0.0)))
    room = scene(furnace(20).static, (glow, grey), (0.5, -1.9, 1.1), (0.5, 0.5, 0.2), (), (block,))
    places = near(*[(x, y, 0) for x in (0.3, 0.7) for y in (0.45, 0.55)], *[(x, 0.3, 0) for x in (0.45, 0.55)])
    settings = control_off_and_on(radius)
    (m,), (h,) = ratios(room, 100_000, [places], settings, truth=2 * math.pi)
    yield AtlasRow(
        "mobile_foot", "tangent_plane without control, on the floor 5 mm beside a mobile 3 mm high",
        "the share of the disc that the mobile leaves free", 1 - beyond(gap, radius), m,
        "artifact control: regions follow mobiles, frame by frame", h,
        within=0.03, aim_within=0.03,  # a mobile cannot emit: the room is a little darker than a furnace
        view=View(room, 100_000, settings[0], settings[1]), title="A disc beside a mobile on the floor",
    )  # fmt: skip
