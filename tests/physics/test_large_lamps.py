"""Irradiance under large lamps of two triangles is no noisier than with independent photons.

A photon crosses a receiver's disc with probability p = flux through the disc / emitted flux, so N independent photons
give E a relative deviation of sqrt((1 - p) / (p N)).
"""

import math

import numpy as np
import pytest

from gi_core.scene.types import Scene
from gi_core.solver import Solver
from tests.support import closed_form
from tests.support.scene_builders import BLACK, floor, lamp, merge, quad
from tests.support.significance import z_test

COUNTS = 1 << 17, 1 << 19, 1 << 20
WORST = 1.1  # error over that of independent numbers
RADIANCE = 10.0


@pytest.mark.parametrize(
    ("width", "ground", "height", "radius"),
    [(3.0, 4.0, 1.0, 0.07), (1.0, 1.0, 0.25, 0.02)],
    ids=["panel of 3 x 3 m over a floor", "parallel plates"],
)
def test_no_large_lamp_is_noisier_than_chance(width, ground, height, radius):
    half = width / 2
    panel = quad((-half, -half, height), (0, width, 0), (width, 0, 0), (1, 1), 1)
    scene = Scene(merge(floor(ground, 16), panel), (BLACK, lamp(RADIANCE)), up=(0.0, 0.0, 1.0), name="panel")
    solver = Solver(scene, photons=COUNTS[-1], radius=radius)
    solver.configure(subset_only=True)
    solver.solve()

    def field(p):
        return closed_form.parallel_rectangle(RADIANCE, -half, half, -half, half, height, p[:, 0], p[:, 1])

    at = solver.receivers.positions
    inside = (at[:, 2] == 0) & (np.abs(at[:, :2]).max(axis=1) < ground / 2 - radius)  # discs within the floor
    truth = np.array([closed_form.disc_mean(field, p, (0, 0, 1), radius) for p in at[inside]])
    crossing = truth * math.pi * radius**2 / (math.pi * RADIANCE * width**2)
    for photons in COUNTS:
        solver.move_all({}, photons)
        E, independent = solver.irradiance[inside, 0], np.sqrt((1 - crossing) / (crossing * photons))
        error = math.sqrt(((E / truth - 1) ** 2).mean())
        assert error < WORST * math.sqrt((independent**2).mean()), (photons, error)
        z_test(E, truth, truth * independent, f"worst receiver of {photons:,} photons")
