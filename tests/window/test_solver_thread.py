"""Only the solver's thread touches a solver once its scene is on show."""

from __future__ import annotations

import threading
from dataclasses import replace

from app.draw.camera import from_camera, scene_bounds
from app.session.log import Log
from app.session.picture import Picture
from app.session.reload import Reload
from app.session.session import Session
from app.settings import ERRORS, REFERENCE
from app.window import view_content
from app.window.panel.facts import facts_of
from gi_core.scene import Pose
from tests.support import viewer_support as support

RECORDS = ("scene", "model", "chosen")  # they never change


class Guarded:
    """A solver that raises if another thread reads anything but its records."""

    def __init__(self, solver):
        self._solver = solver

    def __getattr__(self, name: str):
        if name not in RECORDS and threading.current_thread().name != "solver":
            raise AssertionError(f"solver.{name} was read by {threading.current_thread().name}")
        return getattr(self._solver, name)


def test_a_window_session_reads_snapshots_alone(monkeypatch, tmp_path):
    """Opening, drag, settings, panel, metering, wipe, error map and the parameters of a picture."""
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    opened = support.opened(replace(support.SETTINGS, photons=2000, budget=16.0), support.room(1))
    session = Session(opened.settings, Log(), open_with=lambda settings: None)
    session.adopt(opened._replace(solver=Guarded(opened.solver)))
    camera = from_camera(session.scene.camera, session.scene.up, scene_bounds(session.model, session.poses))
    reload = Reload(lambda settings: None)
    seen = set()

    def frame(**tick) -> None:
        session.tick(0.02, budget=0.02, **tick)
        what = view_content.shown(session)
        seen.update(side.label.split(",")[0] for side in what.sides)
        for mesh in session.meshes:
            view_content.paint(mesh, what.sides[-1], what.errors, True)
        facts_of(session, reload, {}, 0.02, 0.0)
        session.metered(camera)
        session.models()

    def until(done) -> None:
        for _ in range(3000):
            frame()
            if done():
                return
        raise AssertionError(f"only {seen} came; {[e.text for e in session.log.entries]}")

    until(lambda: not session.refining)
    session.begin_drag()
    for k in range(5):
        session.move({"block": Pose((0.4 + 0.02 * k, 0.3, 0.5))})
        frame()
    session.end_drag()
    until(lambda: not session.refining)
    session.want(replace(session.settings, radius=0.08, exposure=0.0))
    until(lambda: session.light.snapshot.setting.radius == 0.08 and not session.refining)
    session.want(replace(session.settings, compare="impact_count"))
    until(lambda: "Impact count" in seen)
    session.want(replace(session.settings, compare=REFERENCE, show=ERRORS))
    until(lambda: "Reference" in seen)
    entries = Picture(session.settings, camera).metadata(session.light.snapshot)
    assert entries["photons"] == "2000" and entries["radius"] == "0.08 m"
    session.close()
    assert not [e.text for e in session.log.entries if e.level == "error"]
