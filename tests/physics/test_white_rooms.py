"""Closed rooms that reflect nearly all light: paths end by survival alone.

A photon arrives 1 + rho + rho^2 + ... = 1 / (1 - rho) times, with a standard deviation of sqrt(rho) / (1 - rho).
"""

import math

import numpy as np
import pytest

from gi_core.frames import frame
from gi_core.gather import static
from gi_core.gather.estimate import Source
from gi_core.gather.reference import reference_irradiance
from gi_core.photons import trace
from gi_core.retrace.cuts import current_segments
from gi_core.scene.types import Mobile, Pose, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import box, furnace_scene, grey, lamp, solve
from tests.support.significance import z_test

ROOM = box((0, 0, 0), (1, 1, 1), 2, inward=True)


def solved(scene: Scene, photons: int, **settings) -> Solver:
    return solve(scene, photons=photons, radius=0.2, **{"estimator": "impact_count", **settings})


def white_room(reflectance: float, mobile: float) -> Scene:
    """A room of emitting walls around a box of other reflectance."""
    walls, dark = lamp(1.0, reflectance), grey(mobile)
    block = Mobile("block", box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2), 2, 1), Pose((0.5, 0.5, 0.5)))
    return Scene(ROOM, (walls, dark), (block,), up=(0, 0, 1), name="white room")


@pytest.mark.parametrize(("rho", "photons"), [(0.95, 40_000), (0.97, 20_000), (0.999, 4_000)])
def test_all_light_of_a_closed_room_arrives(rho, photons):
    solver = solved(furnace_scene(1.0, rho, 2), photons)
    arrived = float((solver.irradiance[:, 0] * solver.receivers.areas).sum()) * (1 - rho) / (6 * math.pi)
    z_test(arrived, 1.0, math.sqrt(rho / photons), f"flux that arrives at reflectance {rho}")
    assert not solver.frame.fates["truncated"].any()


def test_the_reference_of_a_room_of_reflectance_0999_is_right():
    """E = pi Le / (1 - rho); a path of next-event estimation counts its vertices as a photon counts its hits."""
    scene = furnace_scene(1.0, 0.999, 1)
    paths = 3_000
    found, _ = reference_irradiance(scene, np.array([(0.5, 0.5, 0.0)]), np.array([(0.0, 0.0, 1.0)]), paths, 1)
    z_test(found[0, 0], 1000 * math.pi, 1000 * math.pi / math.sqrt(paths), "reference at reflectance 0.999")


def test_paths_do_not_depend_on_the_memory_of_a_step(monkeypatch):
    """Background paths and new suffixes of up to some hundred segments, with room for 2 and for all of them."""
    found = []
    for usual in (2, 4, 1000):
        monkeypatch.setattr(trace, "USUAL", usual)
        solver = solved(white_room(0.98, 0.9), 300, estimator="tangent_plane")
        photons, change = solver.frame.store, solver.frame.change
        paths, _ = photons.subset(300)
        assert np.diff(paths.offsets).max() > 200 and change.new_suffixes.bounce.max() > 100
        found.append((*paths, *change.new_suffixes, *photons.fates, *change.fates))
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other, strict=True))


def test_a_solve_from_scratch_holds_few_segments_at_once(monkeypatch):
    sizes = []

    def counted(*arguments):
        sizes.append((found := current_segments(*arguments))[0].size)
        return found

    monkeypatch.setattr(frame, "current_segments", counted)
    solver = solved(furnace_scene(1.0, 0.999, 2), 2_000)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    assert sum(sizes) > 1_500_000 and max(sizes) < 500_000


def test_frames_of_long_paths_equal_a_solve_from_scratch(estimator):
    solver = solved(white_room(0.98, 0.5), 400, estimator=estimator)
    for x in (0.3, 0.7):
        solver.move("block", Pose((x, 0.4, 0.5)))
        assert solver.frame.changes.photons_cut > 0 and solver.frame.changes.new_segments > 64
        assert np.array_equal(solver.irradiance, solver.from_scratch())
    fates = solver.frame.fates
    assert fates["emitted"] == pytest.approx(fates["absorbed"] + fates["truncated"], rel=1e-12)


def test_a_darker_mobile_in_a_white_room_takes_its_light_from_the_walls(monkeypatch):
    """The mean over the walls, of photons and of best light; the reference's at random places on them."""
    monkeypatch.setattr(static, "CLEAR", 10.0)  # of few receivers and much light: 1 would take a minute
    monkeypatch.setattr(static, "ENOUGH", 0.018)  # whole paths replace photons; the mean over 54 has a seventh
    scene, n, paths = white_room(0.97, 0.2), 2_000, 64
    rng = np.random.default_rng(1)
    wall, side = rng.integers(0, 3, n), rng.integers(0, 2, n)
    places, normals = rng.random((n, 3)), np.zeros((n, 3))
    places[np.arange(n), wall], normals[np.arange(n), wall] = side, 1 - 2 * side
    truth, _ = reference_irradiance(scene, places, normals, paths, 1)
    expected, error = truth[:, 0].mean(), truth[:, 0].std() / math.sqrt(n)
    assert error < 0.005 * expected
    solver = solved(scene, 10_000, light="best")
    walls = solver.surfaces.receiver_range(0)
    weights = solver.receivers.areas[walls] / 6
    for steps in ((), solver.gather_steps()):  # of photons, and of the better light at the end
        list(steps)
        assert weights @ solver.irradiance[walls, 0] == pytest.approx(expected, rel=0.02)
    assert solver.frame.gathered and solver.frame_light.static.best.source is Source.WHOLE_PATHS
