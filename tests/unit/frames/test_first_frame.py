"""Backgrounds of recent settings: a return to a setting estimates nothing again and gives the same bits."""

import numpy as np
import pytest

from gi_core.frames import first_frame
from gi_core.frames.background import Photons
from gi_core.gather import static
from gi_core.gather.direct_light import DirectLight
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, coloured_room, solve

SCENE = coloured_room((box_mobile(size=0.1),))


def estimated(solver: Solver) -> bool:
    """Solve; return whether the solution of all photons was the first picture shown, and it came without estimating."""
    before = solver.frame.background
    added = {id(b): b.added for b in solver._first_frame._recent}
    pictures = [p for p in solver.solve_steps() if p.picture]
    now = solver.frame.background
    assert now is not before
    return len(pictures) > 1 or added.get(id(now)) != now.added


def test_a_return_to_a_recent_setting_is_one_frame():
    solver = solve(SCENE, photons=40_000, radius=0.06)
    light = solver.irradiance
    for name in ("photon_map", "impact_count"):
        solver.configure(estimator=name)
        assert estimated(solver)
    solver.configure(estimator="tangent_plane")
    assert not estimated(solver) and np.array_equal(solver.irradiance, light)
    solver.configure(photons=5_000)
    assert estimated(solver)
    solver.configure(photons=40_000)
    assert not estimated(solver) and np.array_equal(solver.irradiance, light)


def test_an_abandoned_switch_loses_nothing():
    solver = solve(SCENE, photons=40_000, radius=0.06)
    light, first = solver.irradiance, solver.frame.background
    solver.configure(estimator="photon_map")
    for progress in solver.solve_steps():
        if progress.picture:
            break
    solver.configure(estimator="impact_count")
    next(solver.solve_steps())
    solver.configure(estimator="tangent_plane")
    solver.solve()
    assert solver.frame.background is first and np.array_equal(solver.irradiance, light)


@pytest.mark.slow
def test_gathered_light_returns_at_once_though_its_photons_were_few(monkeypatch):
    """Keys 1, 2, 1 while photons of the first estimator were still being estimated."""
    monkeypatch.setattr(static, "ENOUGH", 0.03)
    solver = Solver(SCENE, photons=50_000, radius=0.06, light="best")
    steps = solver.solve_steps()
    until_picture(steps)
    few = solver.frame.photons
    list(solver.gather_steps())
    assert solver.frame_light.is_gathered and few < 50_000
    solver.configure(estimator="impact_count", light="photons")
    solver.solve()
    solver.configure(estimator="tangent_plane", light="best")
    steps = solver.solve_steps()
    until_picture(steps)
    assert solver.frame.photons == few and solver.frame.gathered and solver.setting.estimator == "tangent_plane"
    list(steps)
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_nothing_is_lit_from_scratch_before_the_first_solve(estimator):
    """tangent_plane had no receivers yet: AttributeError."""
    solver = Solver(SCENE, estimator=estimator, photons=100, radius=0.06)
    assert not solver.from_scratch().any() and solver.from_scratch().shape == solver.irradiance.shape


def until_picture(steps) -> None:
    next(p for p in steps if p.picture)


def test_no_more_than_the_recent_ones_stay_and_none_if_memory_is_short(monkeypatch):
    solver = Solver(SCENE, photons=2_000, radius=0.06)
    for radius in (0.06, 0.05, 0.04, 0.03, 0.02):
        solver.configure(radius=radius)
        solver.solve()
    recent = solver._first_frame._recent
    assert [b.setting.radius for b in recent] == [0.04, 0.03, 0.02] and len(recent) == first_frame.RECENT

    monkeypatch.setattr("gi_core.base.memory.available", lambda: 0)
    solver.configure(photons=4_000)
    solver.solve()
    assert [b.setting.radius for b in solver._first_frame._recent] == [0.02]
    assert solver.frame.photons == 2_000 and solver.frame.store.memory_full


def fractions(steps) -> list[float]:
    return [progress.fraction for progress in steps]


def test_the_share_of_the_photons_only_grows(monkeypatch):
    """In a scene whose first picture comes before its regions, in a new setting beside gathered light, in all of it."""
    monkeypatch.setattr(static, "ENOUGH", 0.03)
    monkeypatch.setattr(first_frame, "MANY_RECEIVERS", 1)
    solver = Solver(SCENE, photons=60_000, radius=0.06, light="best")
    done = fractions(solver.solve_steps())
    assert done == sorted(done) and done[-1] == 1.0 and len(set(done)) > 3
    list(solver.gather_steps())
    assert solver.frame_light.is_gathered
    solver.configure(estimator="impact_count")
    done = fractions(solver.solve_steps())
    assert done == sorted(done) and done[-1] == 1.0 and len(set(done)) > 3


def test_memory_that_ends_before_the_photons_takes_back_no_progress(monkeypatch):
    solver = Solver(SCENE, photons=60_000, radius=0.06)
    monkeypatch.setattr(Photons, "affordable", lambda *_: 40_000)
    done = fractions(solver.solve_steps())
    assert done == sorted(done) and solver.frame.photons == 40_000


def test_the_first_pictures_do_not_wait_for_many_rays_of_direct_light(monkeypatch):
    def known(rays: int) -> tuple[list[bool], np.ndarray]:
        monkeypatch.setattr(DirectLight, "rays", rays)
        solver = Solver(SCENE, photons=40_000, radius=0.06, light="best")
        return [solver.frame_light.direct.is_known for p in solver.solve_steps() if p.picture], solver.irradiance

    (few, light), (many, same) = known(rays=0), known(rays=1 << 40)
    assert few[0] and not many[0] and many[-1] and sorted(many) == many
    assert np.array_equal(light, same)
