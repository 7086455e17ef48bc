"""Only the solver's thread touches a solver once its scene is on show."""

import contextlib
import threading
from dataclasses import replace
from types import SimpleNamespace

from imgui_bundle import imgui, implot

from app.draw.camera import from_camera, scene_bounds
from app.session.log import Log
from app.session.picture import Picture
from app.session.reload import Reload
from app.session.session import Session
from app.session.solver_thread import MovingMedian
from app.settings import ERRORS
from app.window import panel, view_content
from app.window.viewport import Viewport
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


@contextlib.contextmanager
def widgets():
    """Let sections be drawn without a window."""
    context, of_plots = imgui.create_context(), implot.create_context()
    io = imgui.get_io()
    io.display_size, io.delta_time, io.backend_flags = (1000, 4000), 0.02, imgui.BackendFlags_.renderer_has_textures
    io.set_ini_filename("")
    try:
        yield
    finally:
        implot.destroy_context(of_plots)
        imgui.destroy_context(context)


def draw_panel(window) -> None:
    """Draw all sections; none is folded."""
    imgui.new_frame()
    imgui.begin("Panel")
    for section in (*panel.SECTIONS, *panel.RESEARCH):
        if section.visible(window):
            assert section.draw(window.session.settings, window, set()) == window.session.settings
    imgui.end()
    imgui.render()


@widgets()
def test_a_window_session_reads_snapshots_alone(monkeypatch, tmp_path):
    """Opening, drag, settings, panel, metering, error map and the parameters of a picture."""
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    opened = support.opened(replace(support.SETTINGS, photons=2000, budget=16.0, exposure=0.0), support.room(1))
    session = Session(opened.settings, Log(), open_with=lambda settings: None)
    session.adopt(opened._replace(solver=Guarded(opened.solver)))
    camera = from_camera(session.scene.camera, session.scene.up, scene_bounds(session.model, session.poses))
    viewport = Viewport(session)
    viewport.view.camera = camera
    window = SimpleNamespace(
        session=session, viewport=viewport, reload=Reload(lambda settings: None), frame_seconds=MovingMedian()
    )
    window.log = session.log
    seen = set()

    def frame(**tick) -> None:
        session.tick(0.02, budget=0.02, **tick)
        what = view_content.shown(session)
        seen.add(what.side.label.split(",")[0])
        view_content.paint(view_content.lit(session, what), what.errors)
        draw_panel(window)
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
    session.want(replace(session.settings, reference=True, show=ERRORS))
    until(lambda: "Reference" in seen)
    entries = Picture(session.settings, camera).metadata(session.light.snapshot)
    assert entries["photons"] == "2000" and entries["radius"] == "0.08 m"
    session.close()
    assert not [e.text for e in session.log.entries if e.level == "error"]
