"""The static part's light gathered by paths: unbiased, used once it is better, and exact under moves."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.base.pause import steps
from gi_core.files.load import load_scene
from gi_core.frames.static_light import StaticLight
from gi_core.gather import radiosity, reference, static
from gi_core.gather.denoise import denoise
from gi_core.gather.estimate import Estimate, Source
from gi_core.gather.reference import ReferenceState, reference_irradiance
from gi_core.gather.static import Kept, StaticGather
from gi_core.geometry.error import relative_error
from gi_core.geometry.mesh_neighbours import neighbours
from gi_core.geometry.surfaces import evaluation_points
from gi_core.scene import DirectionalLight, PointLight, Pose, Scene, SpotLight
from gi_core.solver import Solver
from tests.support.lit_from_outside import l_room
from tests.support.scene_builders import box, box_mobile, coloured_room, grey, plane_scene, solve
from tests.support.toml_rooms import room_file, table

SCENE = coloured_room((box_mobile(size=0.1),))
POSE = Pose((0.55, 0.5, 0.35))


def solved(photons: int, **settings) -> Solver:
    solver = Solver(SCENE, photons=photons, radius=0.06)
    solver.configure(light="best", **settings)
    solver.solve()
    return solver


def kept(solver: Solver) -> Kept:
    """Return a copy of the whole paths that a solver has gathered, as another session finds them."""
    state = solver.frame_light.static.gathered.state
    return Kept(None, ReferenceState(*(a.copy() for a in state)), None, np.zeros(0), np.array([np.inf, 0, 0, np.inf]))


def going_on(solver: Solver, light: Kept) -> Solver:
    """Return a solver that goes on from light of another session."""
    solver.frame_light.static.gathered = g = StaticGather(solver.model, solver.seed)
    assert g.go_on_from(light)
    return solver


@pytest.fixture(scope="module")
def gathered() -> Solver:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(static, "ENOUGH", 0.02)
        solver = solved(5_000)
        list(solver.gather_steps())
        assert solver.frame_light.static.gathered.enough and solver.frame_light.is_gathered
        yield solver


@pytest.mark.slow
def test_static_gather_equals_the_reference_without_mobiles(gathered):
    bare = Solver(replace(SCENE, mobiles=()), photons=0)
    points, normals = evaluation_points(bare.surfaces, bare.receivers)
    truth, error = reference_irradiance(bare.scene, points, normals, 2000, 5, model=bare.model)
    g = gathered.frame_light.static.gathered
    mean, deviation = g.state.mean[:, :3], g.state.standard_error[:, :3]
    sigma = np.sqrt(error**2 + deviation**2)
    z = ((mean - truth) / np.where(sigma > 0, sigma, np.inf))[:, 1]
    assert len(z) > 60 and abs(z.mean()) < 4 * z.std() / np.sqrt(len(z))
    assert 0.7 < z.std() < 1.6  # few sets a point: their deviations are rough
    smooth = denoise(mean, deviation, neighbours(bare.model.corners(0), len(z)), 0, 1).irradiance
    assert g.estimate.irradiance == pytest.approx(smooth, rel=1e-12), "whole paths have taken over"


def test_radiosity_of_little_noise_is_complete_before_whole_paths(monkeypatch):
    """It counted as early until whole paths had a result: a lamp in a bare room had no fine points for a minute."""
    solver = solved(5_000)
    monkeypatch.setattr(static, "ENOUGH", 10.0)  # at once
    g = StaticGather(solver.model, 3)
    list(steps(lambda: g.gather(early=112)))
    assert g.state is None and not g.is_early(static.ALL_PATHS)


def test_radiosity_of_another_session_does_not_keep_new_radiosity_away():
    """Some pairs of sets, stored at an early end, left photons of 33 % error on show for 20 s: 14.5 % for 5.0 %."""
    solver = solved(5_000)
    first = StaticGather(solver.model, 3)
    list(steps(lambda: first.gather(early=16)))
    g = StaticGather(solver.model, 3)
    assert g.go_on_from(first.kept()) and g.estimate.source is Source.RADIOSITY
    stored = g.noise
    assert g.is_early(112)
    list(steps(lambda: g.gather(early=112)))
    assert not g.is_early(112) and g.noise < stored


def test_early_light_keeps_the_borders_of_sunlight():
    """Only bounced light is denoised: no receiver in the sun has less than its sunlight."""
    sun = DirectionalLight("sun", (-1.0, 0.0, -0.75), (1.0, 1.0, 1.0))
    solver = solve(replace(l_room(), mobiles=(), lights=(sun,)), photons=5_000, light="best")
    g = StaticGather(solver.model, 3)
    list(steps(lambda: g.gather(early=16)))
    exact = g._radiosity.by_delta
    assert g.estimate.source is Source.RADIOSITY and ((exact > 0).any(axis=1).sum() > 20) and (exact == 0).any()
    assert (g.estimate.light >= exact * (1 - 1e-12)).all()


def test_unaffected_receivers_keep_gathered_light_and_frames_equal_scratch(gathered):
    gathered.move("box", POSE)
    mean, photons = (
        gathered.frame_light.static.gathered.estimate.irradiance,
        gathered.frame.background.irradiance(gathered.photons),
    )
    gathered.configure(subset_only=True)
    gathered.move_all({})
    plain = gathered.irradiance[: len(mean)]
    gathered.configure(subset_only=False)
    gathered.move_all({})
    untouched = (plain == photons).all(axis=1)
    assert 0.05 < untouched.mean() < 1
    assert np.array_equal(gathered.irradiance[: len(mean)][untouched], mean[untouched])
    assert np.array_equal(gathered.irradiance, gathered.from_scratch())
    assert np.array_equal(gathered.static_irradiance, mean)
    assert (gathered.irradiance >= 0).all()


@pytest.mark.slow
def test_resumed_run_ends_in_the_same_bits(gathered, monkeypatch):
    monkeypatch.setattr(static, "ENOUGH", 0.02)
    first = solved(5_000)
    whole = 0
    for _ in first.gather_steps():
        whole += first.frame_light.static.gathered.state is not None
        if whole == 5:
            break
    light = kept(first)
    for _ in first.gather_steps():  # as after a drag
        pass
    later = going_on(solved(5_000), light)
    list(later.gather_steps())
    assert np.array_equal(
        first.frame_light.static.gathered.estimate.irradiance, gathered.frame_light.static.gathered.estimate.irradiance
    )
    assert np.array_equal(
        later.frame_light.static.gathered.estimate.irradiance, gathered.frame_light.static.gathered.estimate.irradiance
    )
    assert np.array_equal(later.irradiance, first.irradiance)


@pytest.mark.slow
def test_photons_are_shown_while_they_have_less_error(monkeypatch):
    """The photons' error is 0.0005 until the first gathered light, and 0.01 afterwards."""
    photons = [0.0005]
    monkeypatch.setattr(static, "ENOUGH", 0.01)
    monkeypatch.setattr(StaticLight, "_error_of_photons", lambda *of: photons[0])
    monkeypatch.setattr(static.StaticGather, "error_of", lambda self, E: 0.0)
    solver, seen = solved(20_000), set()
    before = solver.irradiance
    for progress in solver.gather_steps():
        known, used = np.isfinite(solver.frame_light.static.gathered.noise), solver.frame_light.is_gathered
        assert used or (solver.irradiance is before and not progress.picture)
        assert not used or solver.frame_light.static.gathered.estimate.error < 2 * photons[0]
        seen.add((known, used))
        if known:
            photons[0] = 0.01
    assert seen == {(False, False), (True, False), (True, True)}


def test_light_without_noise_is_used_soon():
    """Bulbs over a box in the open: single bounces are exact, whole paths at the sample never are."""
    bulbs = tuple(PointLight(f"b{k}", (x, 0.5, 2.0), (1.0, 2.0, 3.0)) for k, x in enumerate((-1.0, 0.5, 2.0)))
    scene = Scene(box((0, 0, 0), (1, 1, 1), 4, 0), (grey(0.5),), (), bulbs, up=(0, 0, 1))
    solver = solve(scene, photons=20_000, radius=0.1, light="best")
    for _, progress in zip(range(300), solver.gather_steps(), strict=False):
        if progress.picture:
            break
    static_light = solver.frame_light.static
    assert solver.frame_light.is_gathered and static_light.gathered.noise < 1e-9 and static_light.best.error < 0.02


def test_gathering_leaves_the_light_of_photons_unchanged(gathered):
    solver = going_on(solved(5_000), kept(gathered))
    solver.configure(light="photons")
    before = solver.irradiance
    for progress in solver.gather_steps():
        assert not progress.picture
    assert solver.irradiance is before
    solver.configure(light="best")
    solver.move_all({})
    assert not np.array_equal(solver.irradiance, before)


def test_error_at_levels_is_scaled_as_noise_is():
    """Of two lamps the first brings ten times the light, with a fifth of the relative noise."""
    lamps = PointLight("bright", (0.5, 0.5, 0.9), (10.0,) * 3), PointLight("dim", (0.4, 0.5, 0.9), (1.0,) * 3)
    solver = Solver(replace(SCENE, lights=lamps), photons=100, light="best")
    names, n = solver.lamps.names, solver.surfaces.receiver_range(0).stop
    share = np.array([{"bright": 10.0, "dim": 1.0}.get(name, 0.0) for name in names])
    noise = np.array([{"bright": 0.2, "dim": 0.1}.get(name, 0.0) for name in names])
    light = np.tile(np.repeat(share, 3), (n, 1)), np.tile(noise**2, (n, 1))
    static_light = solver.frame_light.static
    assert static_light.error(solver.levels) == np.inf
    static_light.gathered = g = StaticGather(solver.model, 0)
    g.estimate = Estimate(Source.WHOLE_PATHS, *light, 0.02, 0.03)
    assert static_light.error(solver.levels) == pytest.approx(0.03)
    of_file = np.hypot(0.2, 0.1) / 11
    off = dict.fromkeys(names, 0.0)
    for name, own in (("bright", 0.2 / 10), ("dim", 0.1 / 1)):
        solver.set_lamps(off | {name: 0.5})
        assert static_light.error(solver.levels) == pytest.approx(0.03 * own / of_file)
    solver.set_lamps(off)
    assert static_light.error(solver.levels) == pytest.approx(0.03), "of no light"


def test_light_of_another_scene_is_refused(gathered):
    light = kept(gathered)
    light = light._replace(state=ReferenceState(*(a[:-1] for a in light.state)))
    assert not StaticGather(gathered.model, gathered.seed).go_on_from(light)


def test_light_without_noise_is_gathered_to_the_end():
    """A bulb over a floor: no path has any variance."""
    bulb = PointLight("p", (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
    solver = solve(plane_scene(bulb, reflectance=0.5), photons=20_000, radius=0.1, light="best")
    list(solver.gather_steps())
    g = solver.frame_light.static.gathered
    assert g.enough and g.estimate.noise == 0 and solver.frame_light.is_gathered


@pytest.mark.slow
def test_stored_light_of_less_noise_than_the_first_single_bounces_goes_on(gathered, monkeypatch):
    """The second launch of a scene: stored paths are in the picture before any photon, and gathering continues."""
    monkeypatch.setattr(static, "ENOUGH", 0.012)
    monkeypatch.setattr(radiosity, "SMALLEST", 0)
    solver = Solver(SCENE, photons=5_000, radius=0.06, light="best")
    for _ in going_on(solver, kept(gathered)).gather_steps():
        if np.isfinite(solver.frame_light.static.gathered.noise):
            break
    stored = solver.frame_light.static.gathered
    assert static.LOW * 0.012 < stored.noise < np.inf and not stored.enough
    solver.solve()
    list(solver.gather_steps())
    assert stored.enough and stored.estimate.noise <= 0.012


def test_light_that_few_paths_find_has_its_noise_stated(monkeypatch):
    """A narrow spot lights a room by its patch on the floor: pilots of most receivers miss it, those beside meet it."""
    monkeypatch.setattr(reference, "PILOT", 1 << 10)
    monkeypatch.setattr(reference, "MOST_PILOT", 8)
    monkeypatch.setattr(reference, "AIM", 0.06)
    spot = SpotLight("spot", (0.5, 0.5, 0.9), (0.0, 0.0, -1.0), (1.0, 1.0, 1.0), 2.5, 3.0)
    room = Scene(box((0, 0, 0), (1, 1, 1), 16, 0, inward=True), (grey(0.5),), lights=(spot,), up=(0, 0, 1))
    by_photons = solve(room, photons=200_000, radius=0.1)
    g = StaticGather(by_photons.model, 0)
    for _ in steps(lambda: g._whole_paths(lambda: None)):
        if g.state is not None and g.state.rounds >= 2:
            break
    pilot = g.state.pilot[:, 1]
    assert (pilot == 0).mean() > 0.3, "pilots that found nothing"
    x, y, z = by_photons.receivers.positions.T
    indirect = g.weights * (np.hypot(x - 0.5, y - 0.5) + z > 0.3)  # elsewhere the patch's edge is blurred by photons
    stated = g._noise_of_paths(g.state) * (g.weights @ g.state.mean[:, 1]) / (indirect @ g.state.mean[:, 1])
    true = relative_error(g.state.mean[:, :3], by_photons.irradiance, indirect).l1
    assert true < 0.7 and 0.7 * true < stated < 1.4 * true


def test_the_bias_of_coarse_faces_is_stated_before_all_photons_are_there(tmp_path):
    """Two triangles per wall: radiosity is half as bright again as the truth, and stated an error of 1 %."""
    scene = load_scene(
        room_file(tmp_path, [4, 5, 2.7], table("light", name="a", position=[0, 0, 2], type="point", flux=[9e3] * 3))
    )
    solver = Solver(scene, photons=1 << 19, light="best")
    list(solver.solve_steps())
    g, areas = solver.frame_light.static.gathered, solver.receivers.areas
    truth, _ = reference_irradiance(scene, *solver.model.evaluation_points, 1024, 5, model=solver.model)
    of_radiosity, shown = (relative_error(E, truth, areas).l1 for E in (g.estimate.irradiance, solver.irradiance))
    assert g.estimate.source is Source.RADIOSITY and of_radiosity > 0.2
    assert g.estimate.error == pytest.approx(of_radiosity, rel=0.2) and shown < 0.1
