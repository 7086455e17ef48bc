"""Artifact control: discs that reach into walls, and surfaces that rise through their own discs.

Each test is a closed form that fails without control, and by how much.
"""

import math

import numpy as np

from gi_core.scene.types import PointLight, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import box, grey, lamp, merge, quad, solve, sphere


def irradiance(scene: Scene, photons: int, radius: float, control: bool = True) -> tuple[Solver, np.ndarray]:
    solver = solve(scene, photons=photons, radius=radius, control=control)
    return solver, solver.irradiance[:, 0]


def test_a_two_sided_sphere_keeps_its_sides_apart():
    """Light outside leaves the inside at exactly 0, and light inside the outside."""
    ball = sphere((0, 0, 0), 1.0, 3)
    for position in ((0, 0, 3), (0, 0, 0)):
        lights = (PointLight("bulb", position, (100.0,) * 3),)
        _, E = irradiance(Scene(ball, (grey(0.5, two_sided=True),), lights=lights, up=(0, 0, 1)), 100_000, 0.1)
        outside, inside = np.split(E, 2)
        lit, dark = (outside, inside) if position[2] else (inside, outside)
        assert lit.max() > 1
        assert not dark.any()
    # Inside, all bounces together are I / (1 - rho) / R^2.
    assert abs(inside.mean() / (100 / (4 * math.pi) / 0.5) - 1) < 0.02


def test_grout_between_low_tiles_is_not_all_noise():
    """Grout 1 mm wide in a floor of 1 m: beside tiles lower than the reach of a segment a disc keeps its width.

    Light comes down to grout and tiles alike. In a groove deeper than that the region is the groove.
    """
    for height, low in ((7.5e-5, True), (1e-3, False)):
        room = merge(
            box((0, 0, 0), (1, 1, 1), 20, 0, inward=True),
            box((0.05, 0.05, 0), (0.4995, 0.95, height), 18, 0),
            box((0.5005, 0.05, 0), (0.95, 0.95, height), 18, 0),
            quad((0.2, 0.2, 0.99), (0, 0.6, 0), (0.6, 0, 0), (1, 1), 1),
        )
        solver, E = irradiance(Scene(room, (grey(0.5), lamp(10.0)), up=(0, 0, 1)), 100_000, 0.02)
        p, n = solver.receivers.positions, solver.receivers.normals
        middle = (n[:, 2] > 0.5) & (np.abs(p[:, 0] - 0.5) < 0.06) & (np.abs(p[:, 1] - 0.5) < 0.3)
        grout, tiles = E[middle & (p[:, 2] == 0)], E[middle & (p[:, 2] == height)]
        grout = grout[np.abs(p[middle & (p[:, 2] == 0), 0] - 0.5) < 1e-6]
        assert len(grout) > 8
        assert len(tiles) > 40
        noise = np.abs(grout / tiles.mean() - 1).mean()
        # Discs expect 60 photons or more: 10 % noise. The groove's share of a disc is a thirtieth: 56 %.
        assert (noise < 0.15) == low, noise
        if low:
            assert abs(grout.mean() / tiles.mean() - 1) < 0.05
