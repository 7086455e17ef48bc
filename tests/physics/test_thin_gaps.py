"""Light crosses gaps thinner than the start offset of segments, which is proportional to the radius."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.discs.region import EXTENSION
from gi_core.scene.types import Scene
from gi_core.solver import Solver
from tests.support.scene_builders import floor, grey, lamp, merge, quad


@pytest.mark.parametrize("gap", [0.0005, 0.002, 0.02])
def test_a_floor_close_under_a_lamp_has_all_of_its_light(gap):
    above = quad((-2, -2, gap), (0, 4, 0), (4, 0, 0), (1, 1), 1)
    scene = Scene(merge(floor(20.0, 40), above), (grey(0.0), lamp(5.0)), up=(0.0, 0.0, 1.0), name="gap")
    solver = Solver(scene, photons=100_000, radius=0.3)
    assert EXTENSION * 0.3 > 0.002
    solver.solve()
    p = solver.receivers.positions
    under = (np.abs(p[:, :2]).max(axis=1) < 1.2) & (solver.receivers.normals[:, 2] > 0.5) & (p[:, 2] == 0)
    assert under.sum() >= 9
    assert solver.irradiance[under].mean() == pytest.approx(np.pi * 5.0, rel=0.03)
