"""Shared by the stability tests: a closed room, a solved solver, a check of sound light."""

import numpy as np
import pytest

from gi_core.scene.types import Mobile, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import box, grey, lamp, merge, quad, solve

UP = (0.0, 0.0, 1.0)


def solved(scene: Scene, photons: int = 2000, poses=None, **setting) -> Solver:
    solver = solve(scene, photons=photons, **{"radius": 0.1, "neighbours": 20, **setting})
    if poses:
        solver.move_all(poses)
    return solver


def assert_sound(solver: Solver) -> None:
    """Finite, nothing negative, every photon accounted for."""
    assert np.isfinite(solver.irradiance).all()
    assert (solver.irradiance >= 0).all()
    fates = solver.frame.fates
    gone = fates["absorbed"] + fates["escaped"] + fates["truncated"]
    assert gone == pytest.approx(fates["emitted"], rel=1e-12)
    for part in fates.values():
        assert (part >= 0).all()


def room(*mobiles: Mobile, lights=(), more=()) -> Scene:
    """A closed white room of 1 m with a lamp below its ceiling."""
    walls = merge(box((0, 0, 0), (1, 1, 1), 6, 0, inward=True), quad((0.4, 0.4, 0.99), (0, 0.2, 0), (0.2, 0, 0)), *more)
    walls = walls._replace(face_material=np.where(np.arange(len(walls.faces)) // 2 == 6 * 36, 1, walls.face_material))
    return Scene(walls, (grey(0.7), lamp(10.0), grey(0.5, two_sided=True)), mobiles, lights, up=UP, name="room")
