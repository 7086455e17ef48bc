"""Frames with contact and without, as `studies.contact_cost` compares them."""

import numpy as np

from app.settings import Settings, make_solver, open_scene
from gi_core.scene.types import Pose
from studies.contact_cost import measure, without_contact
from tests.support import control_scenes
from tests.support.scene_builders import complete, solve


def test_contact_can_be_omitted_from_a_frame():
    """Without it the floor beside a white leg in a furnace is darker, as with regions of each object alone."""
    case = control_scenes.leg(True)
    solver = solve(case.scene, photons=50_000, radius=case.radius)
    beside, _ = control_scenes.classes(case, solver.surfaces, solver.receivers)
    whole, facts = solver.irradiance, solver.frame.control_facts
    with without_contact(solver):
        solver.move_all({})
        apart = solver.irradiance
        assert solver.frame.control_facts == facts._replace(stale=0, on_mobiles=0)
    assert 0.7 < apart[beside].mean() / whole[beside].mean() < 0.9
    free = solve(case.scene, photons=50_000, radius=case.radius, control=False)
    assert np.array_equal(apart[beside], free.irradiance[beside])  # nothing of the floor itself is in the way
    solver.move("body", Pose((0.0, 0.0, 0.3)))
    solver.move("body", Pose())
    assert np.array_equal(solver.irradiance, whole)


def test_both_kinds_of_frame_are_measured():
    settings = Settings("cornell", photons=3000, light="photons")
    solver = complete(make_solver(open_scene(settings), settings))
    found = measure(solver, 3)
    assert found["static"] > 0 and found["on mobiles"] > 0 and found["with"] > 0 and found["without"] > 0
