"""Curved surfaces: those that rise through their own discs count light behind its hit; the others are unchanged.

None leaks.
"""

import math

import numpy as np
import pytest

from gi_core.solver import Solver
from tests.support import control_scenes


def solved(case: control_scenes.ControlScene, rule: bool = True, control: bool = True) -> tuple[Solver, np.ndarray]:
    """Return solver and red irradiance; without `rule` no side counts as concave."""
    solver = Solver(case.scene, photons=case.photons // 2, radius=case.radius, control=control)
    if not rule:
        solver.model.__dict__["concave"] = np.zeros_like(solver.model.concave)
    solver.solve()
    return solver, solver.irradiance[:, 0]


def test_the_inside_of_a_sphere_is_dark_without_the_rule():
    """E = 2 pi in this furnace; every disc lies behind the surface. 2562 receivers of some 250 photons each."""
    case = control_scenes.ball(inside=True)
    E, without = (solved(case, rule)[1] for rule in (True, False))
    assert abs(E.mean() / (2 * math.pi) - 1) < 0.02
    assert without.mean() < 0.05 * E.mean()


def test_outside_of_a_sphere_needs_no_remedy():
    """E = pi of the surrounding lamps; the same bits with and without rule and control."""
    case = control_scenes.ball(inside=False)
    solver, E = solved(case)
    on = control_scenes.classes(case, solver.surfaces, solver.receivers)[0]
    assert abs(E[on].mean() / math.pi - 1) < 0.05
    assert np.array_equal(E[on], solved(case, rule=False)[1][on])
    assert np.array_equal(E[on], solved(case, control=False)[1][on])


def test_valleys_of_a_bumpy_wall_are_as_bright_as_its_crests():
    """Both see the same wide lamp: by the reference they differ by 0.1 %. Without the rule valleys keep a third."""
    case = control_scenes.bumpy_wall()
    for rule in (True, False):
        solver, E = solved(case, rule)
        valleys, crests = control_scenes.classes(case, solver.surfaces, solver.receivers)
        share = E[valleys].mean() / E[crests].mean()
        assert abs(share - 1) < 0.06 if rule else share < 0.4


@pytest.mark.parametrize("name", ["bumpy", "dome"])
def test_curved_walls_do_not_leak(name):
    """Lit from one side: the back of a thin sheet of bumps, and the inside of a dome 2 mm thick, stay at exactly 0."""
    case = control_scenes.bumpy_wall(two_sided=True) if name == "bumpy" else control_scenes.tent()
    solver, E = solved(case)
    n = solver.receivers.normals
    dark, lit = control_scenes.classes(case, solver.surfaces, solver.receivers)
    if name == "bumpy":
        dark, lit = (dark | lit) & (n[:, 2] < 0), (dark | lit) & (n[:, 2] > 0)
    assert dark.sum() > 500 and lit.sum() > 500
    assert E[lit].mean() > 0.5 and not E[dark].any()
    if name == "dome":
        assert solved(case, control=False)[1][dark].mean() > 0.1
