"""The parts of a frame's light share one setting; a twin has its own.

A twin of a solver: shared photons, separate settings and poses.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from gi_core.display.dilation import NONE_UNREACHED, UnreachedReceivers
from gi_core.frames import static_light
from gi_core.frames.frame_light import FrameLight
from gi_core.frames.light_setting import LIST, QUADTREE, LightSetting
from gi_core.frames.static_light import StaticLight
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.estimate import Estimate, Source
from gi_core.gather.static import StaticGather
from gi_core.geometry.error import luminance
from gi_core.model import Model
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Pose
from tests.support import scene_builders
from tests.support import viewer_support as support
from tests.support.scene_builders import box_mobile, coloured_room, solve


@pytest.fixture(scope="module")
def model() -> Model:
    return Model(coloured_room((box_mobile(size=0.2),)), threads=1)


def gathered(model: Model) -> StaticGather:
    g = StaticGather(model, 0)
    n, channels = len(g.weights), model.emitters.lamps.channels
    light = np.ones((n, channels)), np.zeros((n, channels // 3))
    g.noise, g.estimate = 0.01, Estimate(Source.WHOLE_PATHS, *light, 0.01, 0.01)
    return g


def show(light: FrameLight) -> None:
    light.setting.choose("best", None)
    light.static.gathered = gathered(light._model)
    light.static.best = light.static.gathered.estimate


def test_a_bad_choice_changes_nothing():
    setting = LightSetting(np.ones((1, 3)))
    for bad in ({"light": "dark"}, {"subset_only": 2}, {"gloss": "none"}):
        with pytest.raises(SceneError):
            setting.choose(**{"light": None, "subset_only": None} | bad)
    assert (setting.light, setting.subset_only, setting.gloss) == ("photons", False, QUADTREE)


def test_single_rays_and_subsets_take_no_gathered_gloss():
    setting = LightSetting(np.ones((1, 3)), "best")
    assert setting.takes_gathered and setting.takes_gathered_gloss
    setting.choose(None, None, LIST)
    assert setting.takes_gathered and not setting.takes_gathered_gloss
    setting.choose(None, True, QUADTREE)
    assert not setting.takes_gathered and not setting.takes_gathered_gloss


@pytest.mark.parametrize("problem", [ValueError, KeyboardInterrupt])
def test_an_exception_takes_levels_back(problem):
    setting = LightSetting(before := np.ones((1, 3)))
    with pytest.raises(problem), setting.dimmed_to(np.zeros((1, 3))):
        raise problem
    assert setting.levels is before


def test_mobiles_are_lit_as_before_once_an_exception_has_taken_levels_back(model):
    light, at = FrameLight(model, 0), model.transforms(model.start_poses())
    E = np.ones((len(model.object_receivers.areas), 3))
    light.mobiles.replace_in(E, at, E, 8, light.setting.levels)
    with pytest.raises(KeyboardInterrupt), light.setting.dimmed_to(0.0 * light.setting.levels):
        dark = np.ones_like(E)
        light.mobiles.replace_in(dark, at, dark, 8, light.setting.levels)
        raise KeyboardInterrupt
    again = np.ones_like(E)
    light.mobiles.replace_in(again, at, again, 8, light.setting.levels)
    assert not np.array_equal(dark, E) and np.array_equal(again, E)


def test_all_parts_of_a_twin_read_its_own_setting(model):
    light = FrameLight(model, 0)
    show(light)
    twin = light.twin(fresh=False)
    assert twin.static.gathered is light.static.gathered and twin.is_gathered
    twin.setting.choose("photons", None)
    assert (twin.size(9).paths, light.size(9).paths) == (0, 64)
    assert not twin.is_gathered and light.is_gathered
    at = model.transforms(model.start_poses())
    assert not twin.deviation(at, None).any() and light.gathered_at(at) is None
    assert twin.gloss.source is light.gloss.source  # cells of photons are collected once


def test_a_fresh_twin_has_no_gathered_light(model):
    light = FrameLight(model, 0)
    show(light)
    twin = light.twin(fresh=True)
    assert twin.static.best is None and not twin.is_gathered
    assert light.static.best is not None and light.is_gathered


def test_gathered_light_is_mixed_once_per_levels(model):
    static, levels = StaticLight(model, 0, DirectLight(model, 0)), model.emitters.lamps.full()
    static.best = gathered(model).estimate
    first = static.irradiance(None, levels)
    assert static.irradiance(None, levels.copy()) is first
    assert np.array_equal(static.irradiance(None, 0.5 * levels), 0.5 * first)


@pytest.mark.parametrize(
    ("error", "noise", "of_sample", "better"),
    [(0.06, 0.02, 0.05, True), (0.06, 0.02, 0.0, True), (0.06, 0.05, 0.01, True), (0.05, 0.02, 0.01, False)],
    ids=["blurred photons", "no sample yet", "noisy photons", "little error"],
)
def test_gathered_light_is_used_unless_photons_have_much_less_error(
    error, noise, of_sample, better, model, monkeypatch
):
    """The photons' error is their noise, or what whole paths find: discs may blur light without any noise.

    Before whole paths find any, photons do not replace early light. Errors of photons are clouds, and count twice.
    """
    static = StaticLight(model, 0, DirectLight(model, 0))
    static.gathered = gathered(model)
    static.gathered.estimate = static.gathered.estimate._replace(error=error)
    monkeypatch.setattr(static.gathered, "error_of", lambda E: of_sample)
    monkeypatch.setattr(type(static.gathered), "is_measured", of_sample > 0)
    monkeypatch.setattr(static_light, "noise_from_subset", lambda *of: noise)
    shown = SimpleNamespace(
        estimate=SimpleNamespace(photons=1 << 14, subsets=(1 << 13, 1 << 14)), irradiance=lambda *of: None
    )
    assert static.compare(shown) is better and (static.best is static.gathered.estimate) is better
    few = SimpleNamespace(estimate=SimpleNamespace(photons=1 << 14, subsets=(1 << 14,)))
    assert static.compare(few), "their noise is not known"


def test_before_the_search_no_receiver_is_unreached(model):
    unreached, E = UnreachedReceivers(model), np.ones((len(model.object_receivers.areas), 3))
    drawn = unreached.drawn(E, model.transforms(model.start_poses()))
    assert unreached.static is NONE_UNREACHED and drawn.irradiance is E and drawn.weights is None


def test_twin_shares_photons_but_not_settings():
    """Settings and poses are separate; both equal a solver without a twin, bit for bit."""
    solver = solve(support.room(), photons=8192, radius=0.06)
    before, pose = solver.irradiance, solver.poses["block"]
    twin = solver.twin()
    twin.configure(estimator="photon_map", neighbours=20)
    twin.solve()
    twin.move("block", pose._replace(position=(0.6, 0.3, 0.5)))
    assert np.array_equal(twin.irradiance, twin.from_scratch())
    assert solver.setting.estimator == "tangent_plane" and solver.poses["block"] == pose and solver.irradiance is before
    alone = solve(support.room(), "photon_map", photons=8192, radius=0.06, neighbours=20)
    twin.move("block", pose)
    assert np.array_equal(twin.irradiance, alone.irradiance)
    solver.move("block", pose)
    assert np.array_equal(solver.irradiance, before)
    # Photons traced by the twin are available to both.
    twin.configure(photons=10_000)
    twin.solve()
    solver.configure(photons=10_000)
    solver.solve()
    assert np.array_equal(solver.irradiance, solver.from_scratch()) and solver.frame.photons == 10_000


def test_a_change_of_lamps_has_little_noise(monkeypatch):
    """Light dimmed by a tenth less that before it: its error is that of a tenth of the light, above its scatter."""
    monkeypatch.setattr("gi_core.gather.static.ENOUGH", 0.03)
    changes, stated, apart = [], [], []
    for seed in range(5):
        solver = solve(coloured_room((box_mobile(size=0.2),), grid=6), photons=20_000, light="best", seed=seed)
        for _ in solver.gather_steps():
            pass
        levels, n = solver.levels, len(solver.static_irradiance)
        before, none = solver.since(solver.poses, levels)
        assert np.array_equal(before, solver.irradiance) and (none[:n] <= solver.deviation[:n] * np.sqrt(2)).all()
        solver.set_lamps(dict.fromkeys(solver.lamps.names, 0.9))
        before, deviation = solver.since(solver.poses, levels)
        changes.append(luminance(solver.irradiance - before)[:n])
        stated.append(deviation[:n])
        apart.append(np.sqrt(2) * solver.deviation[:n])
    scatter, stated = np.std(changes, axis=0, ddof=1), np.mean(stated, axis=0)
    assert 0.2 * stated.sum() < scatter.sum() < 1.1 * stated.sum() and stated.sum() < 0.5 * np.mean(apart, axis=0).sum()


def test_a_change_of_poses_has_the_noise_of_what_mobiles_change(monkeypatch):
    """Errors of the same static light cancel: stated error is near the scatter, and far below both lights' own."""
    monkeypatch.setattr("gi_core.gather.static.ENOUGH", 0.05)
    changes, stated, apart = [], [], []
    for seed in range(3):
        solver = solve(coloured_room((box_mobile(),), grid=16), photons=50_000, light="best", seed=seed)
        solver.move("box", Pose((0.5, 0.5, 0.3)))
        for _ in solver.gather_steps():
            pass
        poses, n = solver.poses, len(solver.static_irradiance)
        solver.move("box", Pose((0.3, 0.3, 0.2)))
        before, deviation = solver.since(poses, solver.levels)
        changes.append(luminance(solver.irradiance - before)[:n])
        stated.append(deviation[:n])
        apart.append(np.sqrt(2) * solver.deviation[:n])
    assert np.isfinite(stated).all()
    scatter = np.sqrt(np.var(changes, axis=0, ddof=1).mean())
    assert 0.6 < np.sqrt(np.square(stated).mean()) / scatter < 2.0
    assert np.mean(stated) < 0.6 * np.mean(apart)


def test_light_gathered_here_is_changed_as_frames_say():
    """Where light was gathered at the poses on show alone, a change has the share that frames find."""
    solver = scene_builders.gathered(solve(coloured_room((box_mobile(size=0.3),)), photons=5_000, light="best"))
    poses = solver.poses
    before = solver.irradiance.copy()
    solver.move("box", Pose((0.3, 0.3, 0.3)))
    frame = solver.frame
    better, some = frame.irradiance.copy(), np.arange(len(before)) % 3 == 0
    better[some] *= 1.5
    solver.frame = frame._replace(irradiance=better)
    E, _ = solver.since(poses, solver.levels)
    fell = some[:, None] & (before < frame.own)
    assert fell.any() and E[fell] == pytest.approx(1.5 * before[fell])
    assert np.array_equal(E[~some], before[~some])
    E, _ = solver.since(solver.poses, 3.0 * solver.levels)  # brighter lamps: by the same factor, too
    assert E[some] == pytest.approx(3.0 * better[some])


def test_light_of_an_earlier_state_is_that_of_a_solver_there():
    solver = solve(coloured_room((box_mobile(size=0.2),)), photons=5_000, light="best")
    poses, levels, before = solver.poses, solver.levels, solver.irradiance
    there = {"box": poses["box"]._replace(position=(0.2, 0.0, 0.1))}
    solver.move_all(there)
    solver.set_lamps(dict.fromkeys(solver.lamps.names, 0.3))
    now = solver.irradiance
    E, _ = solver.since(poses, levels)
    assert np.array_equal(E, before) and not np.array_equal(E, now)
    assert np.array_equal(solver.irradiance, now) and solver.poses == there


def test_the_error_of_a_frame_counts_bias_and_the_change_by_mobiles(model):
    """In shadow, static light's error is as small as the light; that of mobiles lit by paths is unknown."""
    light, at = FrameLight(model, 0), model.transforms(model.start_poses())
    show(light)
    n, G = light.static.best.variance.shape
    light.static.best = light.static.best._replace(variance=np.ones((n, G)), error=0.03)
    E, change = np.ones((len(model.object_receivers.areas), 3)), np.zeros(n)
    E[:n] = light.static_irradiance(None, 0)
    lit = np.flatnonzero(E[:n].any(axis=1))[:3]
    E[lit[0]] *= 0.5
    change[lit[1]] = 4 * np.sqrt(G)
    error = light.deviation(at, None, (E, change))
    assert np.isnan(error[n:]).all() and light.deviation(at, None)[lit[0]] == np.sqrt(G)
    assert error[lit] == pytest.approx(np.array([1.5, 5.0, 3.0]) * np.sqrt(G))
