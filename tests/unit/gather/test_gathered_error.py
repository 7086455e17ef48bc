"""The error stated for gathered static light includes its bias, in a room lit through one deep window."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.gather.reference_sample import draw_by_area, gather_sample
from gi_core.solver import Solver
from tests.support.scene_builders import classroom

pytestmark = pytest.mark.slow

NOISE = 0.025  # of whole paths, where the test ends


def test_stated_error_is_the_true_one_and_the_mean_is_right():
    solver = Solver(classroom(0.6), photons=1 << 14, light="best")
    solver.solve()
    areas = solver.receivers.areas
    rows, times = draw_by_area(np.flatnonzero(areas > 0), areas, 400, 5)
    *_, truth = gather_sample(solver.model, solver.poses, rows, times, 77, 0.015)
    stated, true = [], []
    for progress in solver.gather_steps():
        g = solver.light_source.gathered
        if progress.picture:
            stated.append(g.error)
            true.append(truth.error(solver.irradiance))
        if g.state is not None and g.noise <= NOISE:
            break
    assert len(stated) > 4 and max(true) > 0.04
    assert stated == pytest.approx(true, rel=1 / 3)
    assert truth.relative_total(solver.irradiance) == pytest.approx(1, abs=0.01)
