"""Radiosity by kept bounces: closed forms, the reference, and conditions of its use."""

import numpy as np
import pytest

from gi_core.base.pause import steps
from gi_core.gather import radiosity, static
from gi_core.gather.radiosity import Radiosity
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import local_deviation, luminance, relative_error
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Mesh, PointLight, Pose, Scene, SkyLight
from gi_core.solver import Solver
from tests.support.scene_builders import (
    box,
    box_mobile,
    classroom,
    coloured_room,
    complete,
    fine_room,
    grey,
    lamp,
    solve,
)

SCENE = coloured_room((box_mobile(size=0.1),))
PHOTONS = 200_000
POSE = Pose((0.55, 0.5, 0.35))


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))


@pytest.fixture(scope="module")
def truth() -> tuple[np.ndarray, np.ndarray]:
    """Irradiance at the receivers of the fine room by 700 sets of whole paths, and its standard error."""
    model = Model(fine_room())
    return reference_irradiance(model.scene, *model.evaluation_points, 700, 5)


def final(scene: Scene, seed: int = 0, threads: int = 2) -> tuple[Radiosity, np.ndarray]:
    """Return the gathering at a scene's static receivers, and their areas."""
    model = Model(scene, threads)
    rows = model.surfaces.receiver_range(0)
    points, normals = (a[rows] for a in evaluation_points(model.surfaces, model.object_receivers))
    areas = model.object_receivers.areas[rows]
    return Radiosity(model, seed, points, normals, areas), areas


def pairs(gather: Radiosity, count: int) -> None:
    """Gather so many pairs."""
    for _ in range(count):
        gather.add_pair()


def test_closed_room_of_glowing_walls_has_the_light_of_the_geometric_series():
    """E = pi Le / (1 - rho) in every direction, so without noise."""
    walls = Scene(box((0, 0, 0), (1, 1, 1), 3, 0, inward=True), (lamp(2.0, 0.7),), up=(0, 0, 1))
    gather, areas = final(walls)
    pairs(gather, 2)
    assert gather.paths == 16 + 32
    assert np.allclose(gather.mean, np.pi * 2.0 / (1 - 0.7), rtol=0.03)
    assert relative_error(gather.mean, np.full_like(gather.mean, np.pi * 2.0 / 0.3), areas).l1 < 0.01


def test_delta_lights_are_exact_however_many():
    """Twelve bulbs in a black box, lamp by lamp: they come from fixed points, not from one path each."""
    places = [(0.2 + 0.2 * (k % 4), 0.25 + 0.25 * (k // 4), 0.7) for k in range(12)]
    bulbs = tuple(PointLight(f"b{k}", p, (1.0 + k, 2.0, 0.5)) for k, p in enumerate(places))
    gather, areas = final(Scene(box((0, 0, 0), (1, 1, 1), 3, 0, inward=True), (grey(0.0),), (), bulbs, up=(0, 0, 1)))
    exact = np.zeros((len(areas), 12, 3))
    for k, bulb in enumerate(bulbs):
        way = np.array(bulb.position) - gather._starts[0]
        cosine, d2 = (way * gather._starts[1]).sum(axis=1), (way**2).sum(axis=1)
        exact[:, k] = (np.maximum(cosine, 0) / d2**1.5 / (4 * np.pi))[:, None] * bulb.flux
    pairs(gather, 1)
    lit = gather._lit
    assert len(lit) > 40 and not gather.lamp_error.any()
    assert np.allclose(gather.per_lamp.reshape(exact.shape)[lit], exact[lit], rtol=1e-6)


def test_open_receivers_see_the_sky():
    walls, sky = box((0, 0, 0), (1, 1, 1), 3, 0), SkyLight("sky", (1.0, 2.0, 3.0))
    gather, areas = final(Scene(walls, (grey(0.7),), (), (sky,), up=(0, 0, 1)))
    pairs(gather, 4)
    top = np.flatnonzero(gather._starts[1][:, 2] > 0.99)
    assert len(top) and np.allclose(gather.mean[top], np.pi * np.array([1.0, 2.0, 3.0]), rtol=1e-9)


@pytest.mark.slow
def test_early_light_has_no_clouds():
    """Local deviation, median and 90th percentile, in a room lit through one deep window: of the first picture, of the
    last one before more photons, and of all radiosity. In living_room they come 0, 1.3 and 9.5 s after the first."""
    scene = classroom(0.5)
    solver, shown = Solver(scene, light="best"), {}
    for progress in solver.solve_steps():
        if progress.picture:
            shown.setdefault(solver.frame_light.static.gathered._radiosity.paths, solver.static_irradiance)
    n, r = len(solver.static_irradiance), solver.model.object_receivers
    truth, error = reference_irradiance(scene, *(a[:n] for a in solver.model.evaluation_points), 1000, 3)
    places = r.positions[:n], r.normals[:n], r.areas[:n]
    for paths, most in ((16, (0.08, 0.25)), (112, (0.05, 0.15)), (1008, (0.03, 0.1))):
        deviation = local_deviation(shown[paths], truth, places, 0.1 * solver.scene_size, luminance(error))
        assert (np.array(deviation) < most).all(), (paths, deviation)


@pytest.mark.slow
def test_radiosity_equals_the_reference_within_its_noise(truth):
    """Walls have many receivers, so that interpolation between them is accurate."""
    scene = fine_room()
    gather, areas = final(scene)
    truth, error = truth
    assert relative_error(truth + error, truth, areas).l1 < 0.03
    pairs(gather, 1)
    first = relative_error(gather.mean, truth, areas).l1
    assert 0.7 < gather.noise / first < 1.4
    more, _ = final(scene)
    pairs(more, radiosity.PAIRS)
    assert more.is_complete and relative_error(more.mean, truth, areas).l1 < 0.6 * first
    assert np.allclose(more.mean.sum(axis=0), truth.sum(axis=0), rtol=0.02)


def test_a_dropped_pair_is_gathered_again_with_the_same_light():
    whole, dropped = final(SCENE, 7)[0], final(SCENE, 7)[0]
    pairs(whole, 2)
    pairs(dropped, 1)
    list(zip(range(5), steps(lambda: pairs(dropped, 1)), strict=False))
    pairs(dropped, 1)
    assert np.array_equal(whole.per_lamp, dropped.per_lamp) and np.array_equal(whole.lamp_error, dropped.lamp_error)


@pytest.mark.parametrize(("paths", "pairs"), [(1, 1), (16, 1), (47, 1), (48, 2), (240, 4), (10_000, 6)])
def test_hits_of_many_receivers_are_bounded(paths, pairs, monkeypatch):
    gather, _ = final(SCENE)
    monkeypatch.setattr(radiosity, "MOST_HITS", paths * len(gather._lit))
    assert final(SCENE)[0]._most_pairs == pairs


def test_threads_and_mobiles_change_nothing():
    results = []
    for scene, threads, seed in ((SCENE, 1, 7), (SCENE, 3, 7), (coloured_room(()), 2, 7), (SCENE, 1, 8)):
        gather, _ = final(scene, seed, threads)
        pairs(gather, 2)
        results.append(gather.mean)
    assert all(np.array_equal(results[0], other) for other in results[1:3])
    assert not np.array_equal(*results[2:])


def noisy(**settings) -> Solver:
    """Return a solver with discs so small that photons miss most of them."""
    solver = Solver(SCENE, photons=PHOTONS, radius=0.004)
    solver.configure(light="best", **settings)
    return solver


def until_gathered(solver: Solver) -> None:
    solver.solve()
    for progress in solver.gather_steps():
        if progress.picture:
            break


@pytest.mark.slow
def test_frames_over_gathered_light_equal_from_scratch():
    solver = noisy()
    until_gathered(solver)
    g = solver.frame_light.static.gathered
    assert g.state is None and not g.enough and 0 < g.fraction < 0.5
    assert np.array_equal(solver.static_irradiance, g.estimate.irradiance)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    solver.move("box", POSE)
    assert np.array_equal(solver.irradiance, solver.from_scratch())


@pytest.mark.slow
def test_radiosity_beats_photons_and_whole_paths_replace_it(truth, monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 0.013)
    solver = solve(fine_room(), photons=50_000, radius=0.02, light="best")
    truth, _ = truth
    photons = relative_error(solver.static_irradiance, truth, solver.receivers.areas).l1
    noises, off, fractions, g = [], [], [], None
    for progress in solver.gather_steps():
        g = solver.frame_light.static.gathered
        fractions.append(progress.fraction)
        if progress.picture and g.state is None:
            noises.append(g.estimate.noise)
            off.append(relative_error(g.estimate.irradiance, truth, g.weights).l1)
    assert len(noises) >= 2 and noises == sorted(noises, reverse=True) and noises[-1] <= 1.4 * 0.013
    assert off[0] < 0.5 * photons and off[-1] < 0.25 * photons
    assert g.enough and g.estimate.noise <= 0.013 and fractions[-1] == 1.0
    assert fractions == sorted(fractions)


def test_gathering_needs_no_photons(monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 0.1)
    solver = solve(SCENE, photons=0, radius=0.05, light="best")
    list(solver.gather_steps())
    g = solver.frame_light.static.gathered
    assert g.enough and g._radiosity.paths > 0


def test_scene_of_mobiles_alone_gathers_nothing():
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int32))
    lights = PointLight("p", (0.5, 0.5, 0.9), (1.0,) * 3), PointLight("q", (-0.5, -0.5, -0.9), (1.0,) * 3)
    scene = Scene(nothing, (grey(0.5), grey(0.5)), (box_mobile(size=0.2),), lights, up=(0, 0, 1))
    solver = solve(scene, photons=2000, radius=0.05, light="best")
    assert (
        len(list(solver.gather_steps())) <= 2 and solver.frame_light.static.gathered.enough and solver.irradiance.any()
    )


@pytest.mark.slow
def test_whole_paths_replace_single_bounces_of_any_bias(monkeypatch):
    """Walls of few vertices: single bounces keep an error that their noise does not show."""
    monkeypatch.setattr(static, "ENOUGH", 0.01)
    solver = complete(noisy())
    for progress in solver.gather_steps():
        g = solver.frame_light.static.gathered
        if progress.picture and g.state is None:
            early = g.estimate.irradiance
    points, normals = (a[: len(g.estimate.irradiance)] for a in evaluation_points(solver.surfaces, solver.receivers))
    bare = Scene(SCENE.static, SCENE.materials, (), SCENE.lights, up=SCENE.up)
    truth, _ = reference_irradiance(bare, points, normals, 1000, 5)
    first, last = (relative_error(E, truth, g.weights).l1 for E in (early, g.estimate.irradiance))
    assert g.enough and g.estimate.noise <= 0.01 and first > 0.04 and last < 0.03
