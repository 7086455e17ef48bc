"""The first light gathered, by the pilot's few paths: unbiased, before most photons where they stay noisy."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scene_builders import box_mobile, coloured_room

from app.gathering import Gathering
from gi_core import static_light
from gi_core.evaluation_points import evaluation_points
from gi_core.gather_rounds import PILOT, PILOT_STREAM, gather_rounds
from gi_core.model import Model
from gi_core.pilot_light import PilotLight, passes
from gi_core.reference import Gatherer
from gi_core.scene import Pose
from gi_core.solver import Solver

SCENE = coloured_room((box_mobile(size=0.1),))
PHOTONS = 200_000
POSE = Pose((0.55, 0.5, 0.35))


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))


def noisy(**settings) -> Solver:
    """Return a solver whose photons miss most of its tiny discs."""
    solver = Solver(SCENE, photons=PHOTONS, radius=0.004)
    solver.configure(static_light="gathered", **settings)
    return solver


def until_gathered(solver: Solver) -> Gathering:
    gathering = Gathering(solver, time.monotonic)
    for _ in gathering.ahead(solver.solve_steps()):
        if solver.uses_gathered:
            break
    return gathering


def test_passes_are_all_paths_once():
    for paths in (1, 2, 3, 4, 8, 20):
        numbers = [first + k for first, count in passes(paths) for k in range(count)]
        assert numbers == list(range(len(numbers))) and (len(numbers) == paths or paths < 8)
    assert [n for n, _ in passes(PILOT)] == [0, 2, 4]


def test_it_is_the_mean_of_the_pilots_paths_and_changes_nothing_of_what_comes_after():
    model = Model(SCENE)
    points, normals = evaluation_points(model.surfaces, model.object_receivers)
    weights, early = np.ones(len(points)), PilotLight(len(points))
    given = SCENE, points, normals, 3, weights
    with_it, plain = (gather_rounds(*given, model=model, step=64, early=e) for e in (early, None))
    known = []
    for state in with_it:
        if early.paths and (not known or known[-1][0] < early.paths):
            known.append((early.paths, early.mean, early.standard_error, early.noise(weights)))
        if state.sets.min() >= 2:
            break
    assert [k[0] for k in known] == [2, 4, 8]
    values = Gatherer(SCENE, points, normals, 3, None, True, model).paths(
        np.arange(len(points)), 0, PILOT, stream=PILOT_STREAM
    )
    for paths, mean, error, _ in known:
        part = values[:, :paths]
        assert np.allclose(mean, part.mean(axis=1), rtol=1e-9)
        assert np.allclose(error, part.std(axis=1, ddof=1) / np.sqrt(paths), rtol=1e-6, atol=1e-9 * mean.max())
    noises = [k[3] for k in known]
    assert noises[0] > 1.2 * noises[2] > 0
    for other in plain:
        if other.sets.min() >= 2:
            break
    for a, b in zip(state, other, strict=True):
        assert np.array_equal(a, b)


def test_it_comes_before_most_photons_where_they_stay_noisy_and_every_frame_is_that_from_scratch():
    solver = noisy()
    until_gathered(solver)
    g = solver.gathered
    assert solver.photons_traced < PHOTONS / 2 and g.early == 2 and not g.enough and g.fraction == 0
    g.noise, told = 0.0, g.noise
    assert not g.enough, "so few paths prove nothing"
    g.noise = told
    assert np.array_equal(solver.resting_irradiance, g.mean)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    solver.move("box", POSE)
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_all_photons_and_all_rounds_end_in_the_same_bits_with_and_without_it(monkeypatch):
    monkeypatch.setattr("gi_core.static_gather.ENOUGH", 0.03)
    first, later = noisy(), noisy()
    gathering = until_gathered(first)
    first.move("box", POSE)  # in between, as in the window
    for _ in gathering.ahead(first.solve_steps()):
        pass
    assert first.gathered.early == PILOT and first.photons_traced == PHOTONS
    later.solve()
    later.move("box", POSE)
    assert later.gathered is None
    for solver in (first, later):
        for _ in solver.gather_steps():
            pass
    assert first.gathered.early == 0 and first.gathered.enough
    assert np.array_equal(first.gathered.mean, later.gathered.mean)
    assert np.array_equal(first.irradiance, later.irradiance)


@pytest.mark.parametrize(
    "why", ["photons do well", "not asked for", "few photons", "all photons are in", "it is there"]
)
def test_photons_go_first_where(why, monkeypatch):
    solver = noisy()
    if why == "photons do well":
        solver.configure(radius=0.1)
    elif why == "not asked for":
        solver.configure(static_light="all")
    elif why == "few photons":
        monkeypatch.setattr(static_light, "TELLING", PHOTONS)
    for progress in solver.solve_steps():
        if progress.picture and solver.photons_traced > 50_000 and why not in ("all photons are in", "it is there"):
            break
    if why == "it is there":
        for _ in solver.gather_steps():
            if solver.gathered.early == PILOT:
                break
        solver.configure(photons=2 * PHOTONS)
    assert not solver.gathers_ahead


def test_a_pilot_that_is_as_noisy_as_the_photons_is_not_used():
    solver = noisy()
    until_gathered(solver)
    g, photons = solver.gathered, solver._shown.resting(solver.photons_traced)
    its_own = g._share * g.noise
    assert g.better_than(photons, 2 * its_own)
    for noise in (1.3 * its_own, float("nan")):
        assert not g.better_than(photons, noise)
