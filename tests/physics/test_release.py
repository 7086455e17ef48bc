"""Objects of a scene are freed when it is closed, without the cycle collector.

It runs when a quarter of all objects are new: hardly ever, as compiled kernels alone are hundreds of thousands.
"""

import functools
import gc
import threading
import time
import weakref

import pytest

from app.session.log import Log
from app.session.opening import Opening
from app.session.session import Session
from app.settings import Settings
from app.worker import Worker
from gi_core.scene import Scene, SceneError
from tests.support import viewer_support as support

SETTINGS = Settings(photons=3_000, radius=0.1, neighbours=20, exposure=0.0)


@pytest.fixture(autouse=True)
def uncollected(tmp_path, monkeypatch):
    """Without the collector, in a separate folder."""
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def are_freed(*refs: weakref.ref) -> bool:
    """Return whether all of them are freed, at the latest when threads have ended."""
    end = time.monotonic() + support.PATIENCE
    while any(ref() is not None for ref in refs) and time.monotonic() < end:
        time.sleep(0.01)
    return all(ref() is None for ref in refs)


def opened(settings=SETTINGS, load=lambda settings: support.room()) -> Session:
    s = Session(settings, Log(), functools.partial(Opening, load=load))
    until(s, lambda: s.ready)
    return s


def until(s: Session, true, still: bool = True) -> None:
    end = time.monotonic() + support.PATIENCE
    while not true():
        assert time.monotonic() < end and s.problem is None
        s.tick(1 / 60, still=still)
        time.sleep(0.001)


def at(s: Session, x: float) -> dict:
    return {name: pose._replace(position=(x, *pose.position[1:])) for name, pose in s.poses.items()}


def held_by(s: Session) -> list[weakref.ref]:
    return [weakref.ref(thing) for thing in (s.light._solver, s.light._solver.model, s.light, s.light._work)]


def test_rested_scene_is_freed_with_its_references():
    """Rounds of the reference are in progress for several poses; each refers to the whole scene."""
    s = opened()
    for x in (0.5, 0.6):
        s.move(at(s, x))
        poses = dict(s.poses)
        until(
            s, lambda poses=poses: (t := s.light._work.live_error.reference(poses, False)) is not None and t.rounds > 0
        )
    refs = held_by(s)
    s.close()
    s = None
    assert are_freed(*refs)


def test_cancelled_load_is_freed():
    kept, gate = [], threading.Event()

    def load(settings):
        gate.wait(support.PATIENCE)
        scene = support.room()
        kept.append(weakref.ref(scene.static.vertices))
        return scene

    opening = Opening(SETTINGS, load=load)
    opening.cancel(0.0)
    gate.set()
    while not opening.done:
        time.sleep(0.01)
    assert f"{opening.problem}" == "cancelled" and kept
    del opening
    assert are_freed(*kept)


@pytest.mark.parametrize("refused", [False, True])
def test_scenes_never_shown_leave_no_thread(refused):
    """Cancelled while opening, or refused: an hour of either must not fill the program with threads."""
    gate, before = threading.Event(), threading.active_count()

    def load(settings):
        gate.wait(support.PATIENCE)
        raise SceneError("room.toml: no such thing")

    sessions = [Session(SETTINGS, Log(), functools.partial(Opening, load=load)) for _ in range(3)]
    assert threading.active_count() >= before + 3
    if not refused:
        for s in sessions:
            s.close(0.0)
    gate.set()
    end = time.monotonic() + support.PATIENCE
    while refused and any(s.problem is None for s in sessions):
        for s in sessions:
            s.tick(0.0)
    while threading.active_count() > before and time.monotonic() < end:
        time.sleep(0.01)
    assert threading.active_count() == before


def test_failed_load_is_freed_although_its_error_is_kept():
    kept = []

    def load(settings) -> Scene:
        scene = support.room()
        kept.append(weakref.ref(scene.static.vertices))
        try:
            raise ValueError(f"of {len(scene.mobiles)}")
        except ValueError as problem:
            raise SceneError("room.toml: no such thing") from problem

    opening = Opening(SETTINGS, load=load)
    while not opening.done:
        time.sleep(0.01)
    reason = opening.problem
    assert f"{reason}" == "room.toml: no such thing" and f"{reason.__cause__}" == "of 1"
    del opening
    assert are_freed(*kept)


def test_scene_with_a_failed_step_is_freed(monkeypatch):
    s = opened()
    until(s, lambda: not s.refining)

    def fails(*_, **__):
        raise ValueError("no light")

    monkeypatch.setattr(s.light._solver, "move_all", fails, raising=False)
    s.move(at(s, 0.7))
    until(s, lambda: s.log.last is not None and s.log.last.text == "moving: no light")
    monkeypatch.undo()
    refs = held_by(s)
    s.close()
    s = None
    assert are_freed(*refs)


def test_failed_job_holds_no_reference():
    class Thing:
        pass

    worker, thing = Worker(), Thing()
    ref = weakref.ref(thing)

    def fail(thing):
        raise ValueError("it fails")

    job = worker.submit(functools.partial(fail, thing))
    with pytest.raises(ValueError, match="it fails"):
        take(job)
    del thing, job
    worker.close()
    assert are_freed(ref)


def take(job) -> None:
    while not job.wait(0.1):
        pass
    job.result()
