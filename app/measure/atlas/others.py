"""Other failures: impact count on small faces, k-nearest sums, bright rooms, scale, mobiles that touch."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from app.measure.atlas.photon_map import SUN
from app.measure.atlas.row import SEEDS, AtlasRow, Number, View, near, over_seeds, ratios, solved
from app.measure.atlas.shapes import BLACK, beyond, box, fan, furnace, joined, scene, sheet
from app.measure.atlas.tangent_plane import BARE, CONTROL
from gi_core.lights.mix import sum_of_lamps
from gi_core.scene import Material, Mobile, Pose, SkyLight, SpotLight

COUNT: dict[str, Any] = {"estimator": "impact_count"}
NEAREST: dict[str, Any] = {"estimator": "photon_map", "neighbours": 20, "radius": 0.5}


def rows() -> Iterator[AtlasRow]:
    """Measure every other failure."""
    yield from textbook()
    yield from small_faces()
    yield naive_sums()
    yield from bright_rooms()
    yield beside_a_mobile()


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
            f"textbook_{k}",
            f"photon_map, textbook form, k = {k}",
            "k / (k - 1) of the unbiased form",
            k / (k - 1),
            ratio,
            "count k - 1 hits: `textbook` off, as by default",
            unbiased,
            known=1e-6,
            aim_known=0.5 / k,  # Sobol photons are more even than random ones: k - 1 of them are too few
            cost="none",
            quantity="E / E of the unbiased form",
            view=View(field, 200_000, {**map_, "textbook": True}, map_) if k == 5 else None,
            title="The k-th hit, counted",
        )


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
            f"face_{w:g}",
            f"impact_count, triangles half of {name} m, {photons:,} photons",
            "noise √(Φ / N E A): variance ~ 1 / area",
            expected,
            Number(float(samples.std()), float(samples.std() / math.sqrt(2 * len(samples))), len(samples)),
            "tangent_plane: the same disc for every triangle",
            None,
            known=0.12 * expected,
            quantity="standard deviation of E / truth",
            view=View(field, photons, COUNT, {**CONTROL, "radius": 0.2}) if w == 0.2 else None,
            title="impact_count on small faces and slivers",
        )


def blocked_spot():
    """A floor under a blue sky and a red spot light, which a plate blocks."""
    ground = sheet((-1, -1, 0), (2, 0, 0), (0, 2, 0), (20, 20))
    lights = SkyLight("sky", (0.0, 0.0, 0.5)), SpotLight("spot", (0, 0, 1.5), (0, 0, -1), (5.0, 0, 0), 14.0, 15.0)
    plate = Mobile("plate", box((-0.2, -0.2, 0), (0.2, 0.2, 0.02), 3), Pose((0, 0, 1.0)))
    return scene(ground, (BLACK._replace(reflectance=(0.5,) * 3),), (0, -2.4, 1.8), (0, 0, 0.3), lights, (plate,))


def naive_sums() -> AtlasRow:
    """Eq. 2.4 with k nearest: each part is divided by its own circle, so the removed part can exceed the whole."""
    place = blocked_spot()
    solver = solved(place, 20_000, **NEAREST)
    model, estimate, frame = solver.model, solver.frame.background.estimate, solver.frame.change
    scale = model.emitters.unit_flux / solver.frame.photons
    static = solver.surfaces.receiver_range(0)

    def read(sums, area):
        return sum_of_lamps(sums * scale / area[:, None])[static]

    parts = [estimate.from_scratch([s], frame.at) for s in (frame.removed_suffixes.segments(), frame.new_suffixes)]
    lost, gained = (read(e.sums, e.area) for e in parts)
    before = read(*estimate.background(solver.frame.photons))
    naive = before - lost + gained
    exact = float(np.abs(solver.irradiance - solver.from_scratch()).max())
    return AtlasRow(
        "additive",
        "photon_map, Eq. 2.4 term by term: E_bg - E(removed) + E(new), red, darkest receiver",
        "below 0: Eq. 2.8 is not additive",
        0.0,
        Number(float(naive[:, 0].min() / before[:, 0].mean())),
        "stale receivers are estimated again from all hits: bits of a solution from scratch",
        Number(exact),
        aim=0.0,
        known=math.inf,
        quantity="E / mean E without the plate",
        view=View(
            place,
            20_000,
            NEAREST,
            None,
            "photon_map as it is done: the spot's red is gone from under the plate, nothing is below 0",
        ),
        title="k nearest hits are not additive",
    )


def bright_rooms() -> Iterator[AtlasRow]:
    """Flux arriving in a closed room is Phi (1 + rho + rho^2 ...), and so is the mean number of a path's segments."""
    for rho in (0.5, 0.9, 0.98, 0.999):
        room = furnace(4, reflectance=rho)

        def run(seed, room=room):
            solver = solved(room, 6000, seed, **COUNT)
            arrived = float((solver.irradiance[:, 1] * solver.receivers.areas).sum()) / (6 * math.pi)
            return arrived, solver.frame.segments / solver.frame.photons

        arrived, segments = over_seeds(run, SEEDS)
        yield AtlasRow(
            f"rho_{rho:g}",
            f"closed room of reflectance {rho:g}: flux that arrives",
            "1 / (1 - ρ): paths end by survival alone",
            1 / (1 - rho),
            arrived,
            "mean number of segments of a path: 1 / (1 - ρ), too",
            segments,
            aim=1 / (1 - rho),
            quantity="flux that arrives / emitted; segments per path",
            title="Closed rooms that reflect nearly all",
        )


def beside_a_mobile() -> AtlasRow:
    """The foot of a mobile on the floor: the part of a disc that it covers is missing, as beside a wall."""
    glow, grey = Material("glow", (0.5,) * 3, (1.0, 1.0, 1.0)), Material("grey", (0.5,) * 3)
    radius, half, gap = 0.1, 0.195, 0.005
    block = Mobile("block", box((-half, -half, 0), (half, half, 0.003), 4, 1), Pose((0.5, 0.5, 0.0)))
    room = scene(furnace(20).static, (glow, grey), (0.5, -1.9, 1.1), (0.5, 0.5, 0.2), (), (block,))
    places = near(*[(x, y, 0) for x in (0.3, 0.7) for y in (0.45, 0.55)], *[(x, 0.3, 0) for x in (0.45, 0.55)])
    settings = [{**BARE, "radius": radius}, {**CONTROL, "radius": radius}]
    (m,), (h,) = ratios(room, 100_000, [places], settings, truth=2 * math.pi)
    return AtlasRow(
        "mobile_foot",
        "tangent_plane without control, on the floor 5 mm beside a mobile 3 mm high",
        "the share of the disc that the mobile leaves free",
        1 - beyond(gap, radius),
        m,
        "artifact control: regions follow mobiles, frame by frame",
        h,
        known=0.03,  # a mobile cannot emit: the room is a little darker than a furnace
        aim_known=0.03,
        view=View(room, 100_000, settings[0], settings[1]),
        title="A disc beside a mobile on the floor",
    )
