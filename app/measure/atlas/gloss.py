"""Gloss from single rays: its noise against the width of the lobe, and the blur of what it reflects."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from app.measure.atlas.row import SEEDS, AtlasRow, over_seeds, solved
from app.measure.atlas.shapes import BLACK, joined, scene, sheet
from gi_core.gloss.hemisphere import CELLS
from gi_core.gloss.radiance import gloss_radiance, room_for
from gi_core.gloss.source import LIST, OPENED, RADII
from gi_core.scene import Material, SkyLight
from gi_core.scene.types import Gloss

RADIUS = 0.1  # of irradiance [m]; gloss has RADII times that
NODES = 2000  # of an integral over the polar angle
SMALL = 0.02  # [m]: a few rays per disc, which are as uneven as random ones; more Sobol photons are more even
HEIGHT = 1.0  # of the strip [m]


def rows() -> Iterator[AtlasRow]:
    """Measure every failure of gloss."""
    yield from noise()
    yield blur()


def noise() -> Iterator[AtlasRow]:
    """The noise of radiance is F times that of irradiance from the same rays: the noise factor of docs/brdfs.md."""
    sky = SkyLight("sky", (1 / math.pi,) * 3)
    places = [(i, j, 0.0) for i in range(12) for j in range(12)]
    for alpha in (0.15, 0.3):
        satin = Material("satin", (0.2,) * 3, gloss=Gloss((0.04,) * 3, alpha))
        field = scene(joined(*(sheet(p, (0.02, 0, 0), (0, 0.02, 0)) for p in places)), (satin,), (6, -9, 9), (6, 6, 0),
                      (sky,))  # fmt: skip

        def run(seed, field=field):
            solver = solved(field, 200_000, seed, radius=SMALL, gloss=LIST)
            light, s = solver.frame.gloss, solver.surfaces
            corner = s.corner_front[::2, 0]  # one receiver per sheet: discs of two sheets do not overlap
            row = np.searchsorted(light.rows, corner).astype(np.int32)
            position, normal = solver.receivers.positions[corner], solver.receivers.normals[corner]
            given = light.directions()._replace(opened=OPENED[LIST])
            fixed = np.ones((len(row), 3)), position, normal, s.lobe[::2], normal, s.tables
            seen = room_for(len(row))
            gloss_radiance(given, row, *fixed, np.array([6.0, 6.0, 1e5]), seen)
            count = np.diff(given.offsets[::CELLS])[row]
            # All photons of the sky have the same flux: irradiance is proportional to the number of rays.
            return (_noise(seen[:, 1] * count) / _noise(count),)

        (measured,) = over_seeds(run, 2 * SEEDS)
        yield AtlasRow(
            f"gloss_noise_{alpha}",
            f"gloss of alpha {alpha} by single rays, seen along the normal under an even sky",
            "F = sqrt(pi integral of f^2 cos) / (integral of f cos)",
            _factor(alpha),
            measured,
            "64 cells instead of rays; reflections where F is above 2",
            known=0.03 * _factor(alpha),
            quantity="noise of radiance / noise of irradiance",
            title="Gloss from few rays",
        )


def _noise(values: np.ndarray) -> float:
    return float(np.std(values, ddof=1) / np.mean(values))


def _factor(alpha: float) -> float:
    """Return the noise factor F along the normal: GGX with height-correlated Smith and F0 = 0.04."""
    theta = (np.arange(NODES) + 0.5) * (0.5 * math.pi / NODES)
    cos, sin = np.cos(theta), np.sin(theta)
    half = np.cos(0.5 * theta)
    d = alpha**2 / (math.pi * (half**2 * (alpha**2 - 1) + 1) ** 2)
    smith = 0.5 * (np.sqrt(1 + alpha**2 * (sin / cos) ** 2) - 1)
    f = d / (4 * cos * (1 + smith)) * (0.04 + 0.96 * (1 - half) ** 5)
    weight = 2 * math.pi * sin * cos * (0.5 * math.pi / NODES)
    return math.sqrt(math.pi * float(weight @ f**2)) / float(weight @ f)


def blur() -> AtlasRow:
    """A disc of radius R sees a thin strip at a distance h from all its points: it spreads over R / 2h (standard)."""
    satin = Material("satin", (0.2,) * 3, gloss=Gloss((0.04,) * 3, 0.3))
    glow = Material("glow", (0.0,) * 3, (100.0,) * 3)
    places = [(0.5 * i, 0.0, 0.0) for i in range(8)]
    strip = sheet((-1.0, 0.005, HEIGHT), (6.0, 0, 0), (0, -0.01, 0), material=2)
    field = scene(joined(*(sheet(p, (0.02, 0, 0), (0, 0.02, 0)) for p in places), strip), (satin, BLACK, glow),
                  (2, -4, 2), (2, 0, 0))  # fmt: skip

    def run(seed):
        solver = solved(field, 400_000, seed, radius=RADIUS, gloss=LIST)
        tree = solver.frame.gloss.tree
        direction, share = tree.rays[:, 3:].astype(float), tree.rays[:, 1].astype(float)
        slope = direction[:, 1] / direction[:, 2]
        share = np.where(direction[:, 2] > 0, share, 0.0)
        mean = (share @ slope) / share.sum()
        return (math.sqrt(share @ (slope - mean) ** 2 / share.sum()),)

    (measured,) = over_seeds(run, 4)
    return AtlasRow(
        "gloss_blur",
        f"a strip lamp {HEIGHT} m over glossy faces, discs of {RADII * RADIUS} m",
        "R / 2h: reflected edges are blurred by 2R / h",
        0.5 * RADII * RADIUS / HEIGHT,
        measured,
        "a smaller radius; reflections for sharp lobes",
        known=0.01 * RADII * RADIUS / HEIGHT,  # receivers lie 0 to 2 cm off the strip's middle
        quantity="standard deviation of the slope of rays",
        title="Reflections blurred by the disc",
    )
