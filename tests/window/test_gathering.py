"""Static light gathered at rest: it reaches the picture, waits for a drag, and is saved."""

import time
from dataclasses import replace

import numpy as np
import pytest

from app.rest import scheduler
from app.rest.jobs import first_task
from app.rest.reference_store import StaticStore
from app.session.log import Log
from app.session.opening import Opened, Opening
from app.session.session import Session
from app.settings import LampLevel, Settings
from gi_core.gather import static
from gi_core.lights.lamps import mix
from gi_core.scene import Pose
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, coloured_room, solve
from tests.support.viewer_support import PATIENCE

SCENE = coloured_room((box_mobile(size=0.2),))


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    monkeypatch.setattr(static, "ENOUGH", 0.1)


def opened(light: str = "best", photons: int = 3000) -> Session:
    settings = Settings(
        estimator="tangent_plane",
        photons=photons,
        radius=0.06,
        neighbours=20,
        exposure=0.0,
        light=light,
        measure_errors=False,
    )
    solver = Solver(SCENE, photons=photons, radius=0.06, light=light)
    session = Session(settings, Log(), open_with=lambda settings: None)
    session.adopt(Opened(settings, solver, None, ()))
    return session


def rest_until(session: Session, done) -> None:
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end, gathered(session)
        session.tick(1 / 60)


def gathered(session: Session):
    return session.light.snapshot.rest.gathered


def is_finished(session: Session) -> bool:
    return gathered(session).used and session.light.all_done


def test_static_light_is_shown_saved_and_loaded_again():
    first = opened()
    rest_until(first, lambda: is_finished(first))
    first.tick(1 / 60)
    assert gathered(first).used and gathered(first).error <= 0.1
    assert np.array_equal(first.irradiance, first.light._solver.irradiance)
    assert np.array_equal(
        first.light._solver.static_irradiance, first.light._solver.frame_light.static.gathered.estimate.irradiance
    )
    first.close()

    again = opened()
    assert StaticStore(again.light._solver.model, again.light._solver.seed).load() is not None
    rest_until(again, lambda: gathered(again).used)
    assert np.array_equal(
        again.light._solver.frame_light.static.gathered.estimate.irradiance,
        first.light._solver.frame_light.static.gathered.estimate.irradiance,
    )
    again.move({"box": Pose((0.6, 0.5, 0.4))})
    rest_until(again, lambda: gathered(again).fraction == 1 and not again.refining and not again.light.partial)
    again.close()  # its thread may be at work at rest: only one at a time uses the solver
    assert np.array_equal(again.light._solver.irradiance, again.light._solver.from_scratch())


def test_switched_on_and_off_in_the_panel():
    session = opened("photons")
    rest_until(session, lambda: not session.refining)
    plain = session.irradiance
    assert first_task((session.light._work.gathering,), session.settings) is None
    session.want(replace(session.settings, light="best"))
    rest_until(session, lambda: is_finished(session))
    session.tick(1 / 60)
    assert not np.array_equal(session.irradiance, plain)
    session.want(replace(session.settings, light="photons"))
    rest_until(session, lambda: np.array_equal(session.irradiance, plain))
    session.want(replace(session.settings, light="best"))
    rest_until(session, lambda: not np.array_equal(session.irradiance, plain))
    session.close()


def test_interrupted_gathering_keeps_its_state(monkeypatch):
    solver = solve(SCENE, photons=100, radius=0.06, light="best")
    calls = []

    def bar(stage, fraction):
        g = solver.frame_light.static.gathered
        if g is not None and g.state is not None:  # nothing is kept of single bounces
            calls.append(fraction)
        if len(calls) == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        scheduler.gather(solver, 3600.0, bar)
    kept = StaticStore(solver.model, solver.seed).load()
    assert kept is not None and np.array_equal(kept.state.mean, solver.frame_light.static.gathered.state.mean)


def test_estimators_keep_their_light():
    """Keys 1, 2, 3, 1: gathered light comes back with the estimator that it was shown with."""
    session = opened()
    rest_until(session, lambda: is_finished(session))
    light = session.irradiance
    for name in ("tangent_plane", "photon_map", "impact_count", "tangent_plane"):
        session.choose_estimator(name)
        assert session.settings.light == ("best" if name == "tangent_plane" else "photons")
        session.tick(1 / 60)
        rest_until(session, lambda: not session.refining)
    assert gathered(session).used and np.array_equal(session.irradiance, light)
    session.choose_estimator("photon_map")
    session.want(replace(session.settings, light="best"))
    session.choose_estimator("impact_count")
    session.choose_estimator("photon_map")
    assert session.settings.light == "best"
    session.close()


def test_a_setting_changed_and_changed_back_shows_the_same_light():
    session = opened()
    rest_until(session, lambda: is_finished(session))
    light, start = session.irradiance, session.settings
    changes = (
        {"photons": 500}, {"photons": 5000}, {"radius": 0.2}, {"radius": 0.03}, {"control": False},
        {"search": "kd_tree"}, {"light": "photons"}, {"reference": True},
        {"estimator": "photon_map"}, {"estimator": "photon_map", "neighbours": 5, "textbook": True},
        {"estimator": "impact_count", "light": "photons", "photons": 1000},
    )  # fmt: skip
    for change in changes:
        session.want(replace(start, **change))
        session.tick(1 / 60)
        rest_until(session, lambda: not session.refining)
        session.want(start)
        session.tick(1 / 60)
        rest_until(session, lambda: not session.refining)
        assert gathered(session).used and np.array_equal(session.irradiance, light), change
    session.close()


def test_work_at_rest_is_stored_at_quit(monkeypatch):
    """Nothing is saved by the clock: PATIENCE is less than a year."""
    monkeypatch.setattr("app.rest.jobs.SAVE_SECONDS", 3e7)
    session = opened()
    rest_until(
        session, lambda: (g := session.light._solver.frame_light.static.gathered) and g.state and g.state.sets.any()
    )
    store = StaticStore(session.light._solver.model, session.light._solver.seed)
    assert store.load() is None
    session.close(patience=PATIENCE)
    assert np.array_equal(store.load().state.sets, session.light._solver.frame_light.static.gathered.state.sets)


STAGES = {
    "single bounces": lambda s: (g := s.light._solver.frame_light.static.gathered) and g.estimate,
    "whole paths": lambda s: gathered(s).fraction > 0.5,  # two rounds
    "complete": lambda s: is_finished(s),
}


@pytest.mark.parametrize("stage", STAGES)
def test_the_light_last_on_show_is_in_the_first_picture(stage, monkeypatch):
    """Single bounces were lost, and so were whole paths before the second round at every receiver."""
    monkeypatch.setattr(static, "ENOUGH", 0.1 if stage == "complete" else 0.02)
    first = opened(photons=100_000)
    rest_until(first, lambda: STAGES[stage](first))
    first.close(patience=PATIENCE)
    solver = first.light._solver
    before = solver.frame_light.static
    g = before.gathered
    shown, paths = before.best, g and g.state
    for lamps in ((), (LampLevel(solver.lamps.names[0], 0.3),)):
        again = Opening(replace(first.settings, lamps=lamps), load=lambda settings: SCENE)
        again._thread.join()
        now = again.result.solver
        light = now.frame_light.static
        assert now.frame.photons < 100_000 and now.frame_light.is_gathered
        assert light.best.source is shown.source and light.best.error == shown.error
        assert np.array_equal(now.static_irradiance, mix(shown.light, now.levels))
        assert paths is None or (light.gathered.state.sets >= paths.sets).all()
        assert light.gathered.enough == (stage == "complete")


def test_nothing_stored_delays_no_first_picture():
    opening = Opening(Settings(scene="room", photons=3000, radius=0.06, light="best"), load=lambda settings: SCENE)
    opening._thread.join()
    assert opening.result.solver.frame_light.static.gathered is None
