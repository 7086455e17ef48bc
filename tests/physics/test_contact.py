"""Contact of mobiles with floors and walls: mobiles enter discs, and discs on mobiles enter walls.

A white object in a furnace reflects all light: E = pi Le / (1 - rho) everywhere, with and without it.
"""

import math

import numpy as np
import pytest

from gi_core.instruments.compile_ahead import TOUCHING, _tiny_scene
from gi_core.scene.types import Pose
from gi_core.solver import Solver
from tests.support import control_scenes
from tests.support.scene_builders import solve

FURNACE = 2 * math.pi  # of Le = 1, rho = 0.5


def solved(case: control_scenes.ControlScene, control: bool = True) -> Solver:
    return solve(case.scene, photons=case.photons, radius=case.radius, control=control)


def mean_error(E: np.ndarray) -> float:
    return float(np.abs(E - FURNACE).mean() / FURNACE)


@pytest.mark.parametrize("thing", ["leg", "book"])
def test_white_mobile_in_a_furnace_leaves_the_floor_unchanged(thing):
    """A disc beside the object loses up to a half without control: a fifth on average over distances up to 0.9 r.

    These receivers see some 300 and 1200 photons in all, so their mean has a deviation of 6 and 3 %. The same
    photons count with and without control, so the difference is far more precise.
    """
    case = control_scenes.leg(True) if thing == "leg" else control_scenes.book()
    on, off = solved(case), solved(case, control=False)
    beside, free = control_scenes.classes(case, on.surfaces, on.receivers)
    E, without = on.irradiance[:, 0], off.irradiance[:, 0]
    assert on.frame.control_facts.stale > beside.sum() and off.frame.control_facts.stale == 0
    assert abs(E[beside].mean() / FURNACE - 1) < (0.24 if thing == "leg" else 0.12)
    assert 0.12 < 1 - without[beside].mean() / E[beside].mean() < 0.28
    assert mean_error(E[beside]) < 1.5 * mean_error(E[free])
    assert np.array_equal(E[free], without[free])


def test_corners_and_borders_of_a_room_are_as_right_as_its_floor():
    """Half a disc sees half of the photons: 1.41 times the noise; the 24 corners among 384 have twice."""
    case = control_scenes.corner()
    E, without = (solved(case, control).irradiance[:, 0] for control in (True, False))
    solver = Solver(case.scene, photons=0, radius=case.radius)
    border, free = control_scenes.classes(case, solver.surfaces, solver.receivers)
    assert mean_error(E[border]) < 1.5 * mean_error(E[free])
    assert mean_error(without[border]) > 3 * mean_error(without[free])


def test_mobile_leg_and_static_leg_light_the_floor_alike():
    """Both count the same photons but for rounding, and the regions are the same."""
    E = []
    for mobile in (True, False):
        case = control_scenes.leg(mobile)
        solver = solved(case)
        beside = control_scenes.classes(case, solver.surfaces, solver.receivers)[0]
        E.append(solver.irradiance[beside, 0])
    assert abs(E[0].mean() / E[1].mean() - 1) < 0.01
    assert np.median(np.abs(E[0] / E[1] - 1)) < 0.01


def test_sides_of_a_standing_mobile_are_not_dark():
    """A disc at its lower edge reaches into the floor, half of it; on average more than a quarter."""
    case = control_scenes.book()
    on, off = solved(case), solved(case, control=False)
    p, n = on.receivers.positions, on.receivers.normals
    low = (np.arange(len(p)) >= on.surfaces.first_receiver[1]) & (np.abs(n[:, 2]) < 0.1) & (p[:, 2] < 0.005)
    assert low.sum() > 60
    E, without = on.irradiance[low, 0], off.irradiance[low, 0]
    assert abs(E.mean() / FURNACE - 1) < 0.12
    assert 0.25 < 1 - without.mean() / E.mean() < 0.55


@pytest.mark.parametrize("mobile", [False, True])
def test_nothing_leaks_past_a_thin_wall(mobile):
    """Lit on one side, the other stays at exactly 0; also if the wall is a mobile that fills a gap."""
    case = control_scenes.two_rooms(mobile)
    solver = solved(case)
    dark, lit = control_scenes.classes(case, solver.surfaces, solver.receivers)
    assert solver.irradiance[lit].mean() > 1
    assert not solver.irradiance[dark].any()
    assert solved(case, control=False).irradiance[dark].max() > 0.1


def test_a_mobile_in_mid_air_costs_nothing(monkeypatch):
    """No ray is cast for regions, no receiver is estimated again, no additional segment is searched."""
    case = control_scenes.leg(True)
    solver = solve(case.scene, photons=5000, radius=case.radius)
    resting = solver.frame.control_facts
    assert resting.stale > 0 and resting.on_mobiles > 0
    cast = []
    real = solver.model.accelerator.nearest

    def counted(*given):
        cast.append(given)
        return real(*given)

    contact = solver.frame.background.estimate._contact
    monkeypatch.setattr(solver.model.accelerator, "nearest", counted)
    at = solver.model.transforms({"body": Pose((0.0, 0.0, 0.4))})
    wanted = contact.wanted(at, mobiles=True)
    assert not cast and not len(wanted.boxes) and not wanted.around.any()
    solver.move("body", Pose((0.0, 0.0, 0.4)))
    assert solver.frame.control_facts == resting._replace(stale=0, on_mobiles=0)
    assert solver.frame.change.near_boxes.size == 0 and solver.frame.changes.photons_cut > 0


def test_contact_on_mobiles_needs_light_from_photons():
    """If it gathers, no disc on it is read; floor and walls near it are estimated as before."""
    case = control_scenes.leg(True)
    solver = solve(case.scene, photons=5000, radius=case.radius)
    by_photons = solver.frame.control_facts
    solver.configure(light="best")
    solver.solve()
    assert by_photons.on_mobiles > 0
    assert solver.frame.control_facts == by_photons._replace(on_mobiles=0)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    solver.configure(light="photons")
    solver.solve()
    assert solver.frame.control_facts == by_photons


def test_warm_up_compiles_contact_kernels():
    """Its mobile enters a disc of the floor, and the floor discs on it: the first contact compiles no kernel."""
    solver = solve(_tiny_scene(), photons=64, radius=0.1)
    solver.move("mobile", TOUCHING)
    assert solver.frame.control_facts.stale > 0 and solver.frame.control_facts.on_mobiles > 0
