"""Automatic settings: error models are recovered from synthetic trials, and the choice is the best setting."""

import math
import shlex
from dataclasses import replace

import numpy as np
import pytest

from app import __main__ as cli
from app.cli.options import settings_of
from app.commands.tune import _models, command_line
from app.measure.tuning import Tuned, compared, tune
from app.settings import LampLevel, Settings
from gi_core.estimators import ESTIMATORS
from gi_core.estimators.base import Setting
from gi_core.scene import Pose
from gi_core.solver import Solver
from gi_core.tuning import (
    ErrorModel,
    Trial,
    TunedChoice,
    fitted,
    mean_scatter,
    over_radii,
    reference_samples,
    trial,
    within_error,
    within_time,
)
from tests.support.scene_builders import box_mobile, coloured_room, plane_scene, solve

COUNTS = np.array([8192, 16384, 32768, 65536, 131072])


def setting(radius: float = 0.1) -> Setting:
    return Setting("tangent_plane", radius, 50)


def made(model: ErrorModel) -> Trial:
    alone = np.array([model.error(n) ** 2 for n in COUNTS])
    moving = np.array([model.error(COUNTS[-1], n) ** 2 for n in COUNTS])
    return Trial(model.setting, COUNTS, alone, moving, np.array([model.seconds(n) for n in COUNTS]))


def like_photons(radius: float) -> ErrorModel:
    """Return a model as in theory: noise as 1 / r, bias as r^2, time as r."""
    return ErrorModel(setting(radius), 10 / radius**2, 2 / radius**2, 4 * radius**2, 1e-3, 1e-6 * radius)


def test_a_model_is_recovered():
    model = ErrorModel(setting(), noise=900.0, moving=100.0, bias=0.03, start=2e-3, slope=1e-7)
    found = fitted(made(model))
    assert found[1:] == pytest.approx(model[1:], rel=1e-6)
    without = model._replace(bias=0.0, start=0.0)
    assert fitted(made(without))[1:] == pytest.approx(without[1:], rel=1e-6, abs=1e-5)


def test_noise_in_a_trial_leaves_the_model_about_right():
    model = ErrorModel(setting(), noise=900.0, moving=100.0, bias=0.03, start=2e-3, slope=1e-7)
    rng, exact = np.random.default_rng(0), made(model)
    shaken = exact._replace(alone=exact.alone * rng.normal(1, 0.1, 5), seconds=exact.seconds * rng.normal(1, 0.1, 5))
    found = fitted(shaken)
    assert found.error(1e6) == pytest.approx(model.error(1e6), rel=0.3)
    assert found.seconds(1e6) == pytest.approx(model.seconds(1e6), rel=0.3)


def test_the_scatter_of_a_trial_is_that_of_its_errors():
    model, rng = ErrorModel(setting(), 900.0, 100.0, 0.03, 2e-3, 1e-7), np.random.default_rng(1)
    exact, found = made(model), []
    for _ in range(200):
        shaken = exact._replace(alone=exact.alone * rng.normal(1, 0.06, 5))  # of squares: 3 % of errors
        found.append(fitted(shaken))
    assert mean_scatter(found) == pytest.approx(0.03, rel=0.15)
    one = exact._replace(photons=COUNTS[:1], alone=exact.alone[:1], moving=exact.moving[:1], seconds=exact.seconds[:1])
    assert math.isnan(fitted(one).scatter)


@pytest.mark.parametrize("scatter, marked", [(0.0, [False] * 4), (0.05, [False, True, True, False])])
def test_settings_that_the_trials_cannot_tell_apart_are_in_noise(scatter, marked, capsys):
    """Errors in motion of 10, 5.2, 5 and 8 %: the second differs from the third by less than 5 % of both."""
    errors, choice = (0.1, 0.052, 0.05, 0.08), TunedChoice(setting(), 10**6, 10**6, 0.05, 0.05, 0.01, True)
    models = tuple(ErrorModel(setting(), 1e-6, 0.0, bias, 1e-3, 1e-9, scatter) for bias in errors)
    lines = _models(found := Tuned(choice, models, {}), 16.0)
    predicted, in_noise = zip(*compared(found, 0.016), strict=True)
    assert predicted == pytest.approx(errors, rel=1e-3) and [bool(scatter) and m for m in in_noise] == marked
    assert [", in noise" in line for line in lines[1:5]] == marked
    assert lines[2].endswith("5.2 %, in noise" if scatter else "5.2 %") and len(lines) == 5 + bool(scatter)


def test_models_that_leave_their_law_make_a_comparison_uncertain():
    choice = TunedChoice(setting(), 10**6, 10**6, 0.05, 0.05, 0.01, True)
    law = tuple(ErrorModel(setting(r), 1e-6, 0.0, bias, 1e-3, 1e-9) for r, bias in ((0.1, 0.05), (0.2, 0.06)))
    tried = (law[0]._replace(bias=0.07), law[1]._replace(bias=0.05))  # 40 % above, 17 % below
    assert [m for _, m in compared(Tuned(choice, tried, {}, None, tried), 0.016)] == [False, False]
    assert [m for _, m in compared(Tuned(choice, tried, {}, None, law), 0.016)] == [True, True]


def test_one_photon_count_is_enough_for_a_rough_model():
    found = fitted(Trial(setting(), COUNTS[:1], np.array([0.01]), np.array([0.01]), np.array([4e-3])))
    assert found.error(4 * 8192) == pytest.approx(0.05)
    assert found.seconds(2 * 8192) == pytest.approx(8e-3)


def test_radius_exponents_are_fitted_and_interpolated():
    radii = (0.05, 0.07, 0.1, 0.14)
    models, exponents = over_radii([like_photons(r) for r in radii])
    assert exponents == pytest.approx({"A": -2, "M": -2, "B": 2, "s": 0, "c": 1}, abs=1e-6)
    assert models[0].setting.radius == 0.05 and models[-1].setting.radius == 0.14
    for model in models:
        assert model.error(1e5) == pytest.approx(like_photons(model.setting.radius).error(1e5), rel=0.02)


@pytest.mark.parametrize("budget", [2e-3, 5e-3, 30e-3])
def test_the_choice_for_a_time_is_the_best_of_all(budget):
    models = [like_photons(r) for r in np.linspace(0.02, 0.3, 40)]
    choice = within_time(models, budget, photons=1_000_000)
    assert choice.met and choice.seconds <= budget * (1 + 1e-9)
    others = [model.error(1e6, min(model.photons_within(budget), 1e6)) for model in models]
    assert choice.moving_error == pytest.approx(min(others), rel=1e-3)


def test_more_time_selects_smaller_discs():
    models = [like_photons(r) for r in np.linspace(0.02, 0.3, 40)]
    radii = [within_time(models, t, 10_000_000).setting.radius for t in (1.2e-3, 5e-3, 100e-3)]
    assert radii[0] > radii[1] > radii[2]


def test_unreachable_time_is_reported():
    choice = within_time([like_photons(0.1)], 0.5e-3, 100_000)
    assert not choice.met and choice.frame > 0 and math.isfinite(choice.moving_error)


def test_choice_for_an_error_is_the_fastest_within_it():
    models = [like_photons(r) for r in np.linspace(0.02, 0.3, 40)]
    choice = within_error(models, 0.05, 16e-3, most=10_000_000)
    assert choice.met and choice.error <= 0.05
    fitting = [model.seconds(model.photons_for(0.05)) for model in models if model.photons_for(0.05) <= 10_000_000]
    model = next(model for model in models if model.setting == choice.setting)
    assert model.seconds(choice.photons) == pytest.approx(min(fitting), rel=1e-3)


def test_unreachable_error_gives_the_least_error():
    models = [like_photons(r) for r in (0.1, 0.2)]
    choice = within_error(models, 1e-4, 16e-3, most=1_000_000)
    assert not choice.met and choice.photons == 1_000_000
    assert choice.error == pytest.approx(min(model.error(1e6) for model in models))


SCENE = coloured_room((box_mobile(size=0.2),))


@pytest.fixture(scope="module")
def solver() -> Solver:
    return solve(SCENE, photons=60_000, radius=0.08)


def test_trial_predicts_the_error_of_more_photons(solver, monkeypatch):
    """From 16,384 photons to 60,000: noise falls to about half."""
    judge = solver.twin()
    samples = reference_samples(judge, [{"box": Pose((0.55, 0.5, 0.35))}], lambda done: None)
    _, sample = samples[0]
    assert len(sample.rows) > 30 and 0 < sample.noise < 0.05
    assert sample.weights.sum() == 300, "large receivers are drawn more than once"
    monkeypatch.setattr("gi_core.tuning.TRIAL_PHOTONS", 16_384)
    law = fitted(trial(judge, samples, radius=0.08))
    assert law.noise > 0 and law.slope >= 0
    before = solver.irradiance.copy()
    monkeypatch.setattr("gi_core.tuning.TRIAL_PHOTONS", 60_000)
    large = trial(judge, samples, radius=0.08)
    assert law.error(60_000) == pytest.approx(math.sqrt(large.alone[-1]), rel=0.5)
    assert np.array_equal(solver.irradiance, before), "trials leave the solver alone"
    solver.move_all({})
    assert np.array_equal(solver.irradiance, before)


def test_an_estimator_without_subsets_is_tried_at_each_number_of_photons(solver, monkeypatch):
    """One number alone gave a model without bias and without a start, which won every comparison of fast frames."""
    monkeypatch.setattr("gi_core.tuning.TRIAL_PHOTONS", 32_768)
    judge = solver.twin()
    samples = reference_samples(judge, [{"box": Pose((0.55, 0.5, 0.35))}], lambda done: None)
    tried = trial(judge, samples, estimator="photon_map", neighbours=80)
    assert tried.photons.tolist() == [4096, 8192, 16_384, 32_768]
    assert tried.alone[-1] < tried.alone[0] and (tried.moving == tried.alone).all()


def test_an_estimator_without_subsets_uses_all_photons_in_motion():
    model = like_photons(0.1)._replace(setting=Setting("photon_map", 0.1, 50))
    choice = within_time([model], 5e-3, photons=1_000_000)
    assert choice.photons == choice.frame < 1_000_000 and choice.seconds == pytest.approx(5e-3, rel=1e-3)
    choice = within_error([model], 0.1, 1e-3, most=1_000_000)
    assert choice.photons == choice.frame and choice.moving_error == choice.error <= 0.1


@pytest.mark.slow
def test_the_static_light_of_all_photons_helps_frames_of_few(monkeypatch):
    """Squared errors, summed over four seeds: at one seed the ratio of few receivers scatters from 0.8 to 1.5."""
    monkeypatch.setattr("gi_core.tuning.TRIAL_PHOTONS", 60_000)
    alone, moving = np.zeros(5), np.zeros(5)
    for seed in range(4):
        solver = solve(coloured_room((box_mobile(size=0.2),), grid=8), photons=60_000, radius=0.08, seed=seed)
        judge = solver.twin()
        samples = reference_samples(judge, [{"box": Pose((0.55, 0.5, 0.35))}], lambda done: None)
        large = trial(judge, samples, radius=0.08)
        alone, moving = alone + large.alone, moving + large.moving
    ratio = moving / alone
    assert (ratio[:2] < 0.8).all(), "few photons gain"
    assert (ratio[2:] < 1.1).all(), "a quarter of them and more lose little by smoothing and shrinkage"


def test_tuned_choice_is_accepted_by_the_solver(solver, monkeypatch):
    monkeypatch.setattr("gi_core.tuning.TRIAL_PHOTONS", 16_384)
    monkeypatch.setattr("gi_core.tuning.MOST_TRIAL_PATHS", 64)
    reports = []
    found = tune(solver, 0.01, lambda *now: reports.append(now), error=0.2)
    shares = [share for _, share in reports]
    assert shares == sorted(shares) and 0 <= shares[0] and shares[-1] < 1
    assert {model.setting.estimator for model in found.models} == set(ESTIMATORS)
    other = Solver(SCENE, photons=0)
    other.configure(photons=found.choice.photons, **found.choice.setting._asdict())
    other.solve()
    assert other.irradiance.any()


@pytest.mark.slow
def test_the_command_prints_trials_and_choice(monkeypatch, capsys):
    monkeypatch.setattr("gi_core.tuning.TRIAL_PHOTONS", 8192)
    monkeypatch.setattr("gi_core.tuning.MOST_TRIAL_PATHS", 32)
    assert cli.main(["tune", "cornell", "--photons", "8192", "--check", "--budget", "30", "--max-edge", "0.2"]) == 0
    text = capsys.readouterr().out
    assert "impact_count" in text and "for frames of 30 ms: " in text and "measured: " in text
    assert "\ngi-viewer cornell --max-edge 0.2 --estimator " in text
    monkeypatch.setattr("app.settings.open_scene", lambda settings: plane_scene())
    assert cli.main(["tune", "plane"]) == 2
    assert "no mobile to move" in capsys.readouterr().err


def test_the_printed_command_line_opens_the_window_with_the_choice():
    from app.__main__ import parse

    chosen = {"estimator": "photon_map", "photons": 123_456, "radius": 0.0123, "neighbours": 80, "control": False}
    asked = Settings(
        scene="my room.glb", mobiles=("chair.glb",), poses=(("chair", (1.0, 0.5, -2.0)),), up="z", seed=3, budget=20.0,
        light="best", rays="octree", lamps=(LampLevel("desk lamp", 0.5), LampLevel("sun", 1.0, (1.0, 0.5, 0.0))),
    )  # fmt: skip
    setting = Setting("photon_map", 0.0123, 80, control=False)
    found = Tuned(TunedChoice(setting, 123_456, 8192, 0.01, 0.02, 0.03, True), (), {}, 16)
    command, *words = shlex.split(command_line(asked, found))
    assert command == "gi-viewer"
    read = settings_of(parse(words))
    assert replace(read, lamps=asked.lamps) == replace(asked, **chosen, light="best")
    assert read.levels(()) == asked.levels(())
