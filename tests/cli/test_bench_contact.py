"""`gi-viewer bench SCENE --contact`: the same frames with contact and without; how long is no test's business."""

from __future__ import annotations

import re

import numpy as np
import pytest

from app import __main__ as cli
from gi_core.scene.types import Pose
from gi_core.solver import Solver
from tests.support import control_scenes


def test_contact_can_be_left_out_of_a_frame_and_comes_back():
    """Without it the floor beside a white leg in a furnace is darker, as with regions of each object alone."""
    case = control_scenes.leg(True)
    solver = Solver(case.scene, photons=50_000, radius=case.radius)
    solver.solve()
    beside, _ = control_scenes.classes(case, solver.surfaces, solver.receivers)
    whole, facts = solver.irradiance, solver.control_facts
    with solver.frame_parts().background.estimate.contact_switched(False):
        solver.move_all({})
        apart = solver.irradiance
        assert solver.control_facts == facts._replace(stale=0, on_mobiles=0)
    assert 0.7 < apart[beside].mean() / whole[beside].mean() < 0.9
    free = Solver(case.scene, photons=50_000, radius=case.radius, control=False)
    free.solve()
    assert np.array_equal(apart[beside], free.irradiance[beside])  # nothing of the floor itself is in the way
    solver.move("body", Pose((0.0, 0.0, 0.3)))
    solver.move("body", Pose())
    assert np.array_equal(solver.irradiance, whole)


def test_what_it_prints(capsys):
    assert cli.main(["bench", "cornell", "--contact", "--frames", "3", "--photons", "3000"]) == 0
    told = capsys.readouterr().out
    static, mobile = re.search(r"in contact +([\d,]+) static receivers and ([\d,]+) on mobiles", told).groups()
    assert int(static) > 0 and int(mobile) > 0
    assert "it costs" in told and "by CPU time" in told


@pytest.mark.parametrize("off", [["--no-control"], ["--estimator", "impact_count"]])
def test_it_needs_what_it_measures(off, capsys):
    assert cli.main(["bench", "cornell", "--contact", "--photons", "100", *off]) == cli.USAGE
    assert "--contact needs tangent_plane with artifact control, got" in capsys.readouterr().err
