"""A room lit by luminaires: photons, gathered light and the reference agree, and frames equal a solve from scratch."""

import numpy as np
import pytest

from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.surfaces import evaluation_points
from gi_core.scene.types import Mobile, Pose, Scene
from gi_core.solver import Solver
from tests.support.photometry import luminaire
from tests.support.scene_builders import box, grey, solve

MOVED = {"block": Pose((0.45, 0.55, 0.25))}


@pytest.fixture(scope="module")
def scene() -> Scene:
    walls = box((0, 0, 0), (1, 1, 1), 10, 0, inward=True)
    lights = (
        luminaire("point", (0.3, 0.3, 0.8), (2.0, 1.0, 0.5)),
        luminaire("panel", (0.6, 0.7, 0.85), (1.0, 2.0, 3.0), size=(0.3, 0.15), c0=(0.0, 1.0, 0.0)),
    )
    things = (Mobile("block", box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), 3), Pose((0.7, 0.3, 0.4))),)
    return Scene(walls, (grey(0.6)._replace(reflectance=(0.7, 0.5, 0.3)),), things, lights, up=(0, 0, 1))


def solved(scene, light, **settings) -> Solver:
    return solve(scene, photons=1 << 16, radius=0.06, light=light, **settings)


@pytest.fixture(scope="module")
def truth(scene):
    """Irradiance (R, 3) of receivers at MOVED; sums over walls have 0.6 % of noise, over the block's sides 1.3 %."""
    solver = Solver(scene, photons=0)
    solver.move_all(MOVED)
    at = evaluation_points(solver.surfaces, solver.receivers)
    return reference_irradiance(scene, *at, 400, 3, poses=MOVED)[0]


def sums(solver: Solver, E: np.ndarray) -> np.ndarray:
    """Return mean irradiance per channel of each wall and of the block's sides, by facing, (2, 6, 3)."""
    r, first = solver.receivers, solver.surfaces.receiver_range(1).start
    facing = np.argmax(r.normals @ np.vstack([np.eye(3), -np.eye(3)]).T, axis=1)
    out = np.empty((2, 6, 3))
    for side in range(6):
        for o, rows in enumerate((np.arange(len(E)) < first, np.arange(len(E)) >= first)):
            chosen = rows & (facing == side)
            out[o, side] = (E[chosen] * r.areas[chosen, None]).sum(axis=0) / r.areas[chosen].sum()
    return out


@pytest.mark.slow
def test_photons_and_gathered_light_agree_with_the_reference(scene, truth):
    solver = solved(scene, "photons")
    solver.move_all(MOVED)
    expected = sums(solver, truth)
    # Discs blur light over edges, so photons are compared on walls.
    assert sums(solver, solver.irradiance)[0] == pytest.approx(expected[0], rel=0.03)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    best = solved(scene, "best")
    for step in best.gather_steps():
        if best.frame_light.is_gathered and step.fraction > 0.5:
            break
    assert best.frame_light.is_gathered
    best.move_all(MOVED, paths=256)
    assert sums(best, best.irradiance)[0] == pytest.approx(expected[0], rel=0.02)
    # Beneath the block, frames know its shadow by means of the floor's faces.
    assert sums(best, best.irradiance)[1] == pytest.approx(expected[1], rel=0.07)
    assert np.array_equal(best.irradiance, best.from_scratch())


def test_a_luminaire_is_dimmed_as_any_lamp(scene):
    solver = solved(scene, "best", threads=2)
    solver.move_all(MOVED)
    full = solver.irradiance.copy()
    solver.set_lamps({"point": 0.5, "panel": 0.5})
    assert np.array_equal(solver.irradiance, 0.5 * full)
    solver.set_lamps({"point": 0.0})
    assert np.array_equal(solver.irradiance, solver.from_scratch())
