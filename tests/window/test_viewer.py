"""The window: opening, failures, closing, screenshots, and the message without OpenGL."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image

from app.draw.renderer import Renderer
from app.session.opening import Opening
from app.session.solver_thread import SolverThread
from app.window import overlay, window
from gi_core.photons.paths import PathStore
from gi_core.retrace import cuts
from gi_core.scene import SceneError
from tests.support import viewer_support as support
from tests.support.viewer_hand import BLOCK_FRONT, errors, in_window, keys

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("gl", "folder")]


def test_frames_continue_while_the_scene_opens(play):
    """Frames continue during a slow load, its phase is shown, and then its light."""
    seen = threading.Event()
    drawn = []

    def slow(settings):
        assert seen.wait(support.PATIENCE), "no frames while the loader waits"
        return support.room()

    def script(hand, viewer):
        opening = viewer.session.opening
        hand.wait(lambda: opening.phase == "loading scene")
        before = viewer.clock.frames
        hand.ctx.yield_(20)
        drawn.append((opening.phase, viewer._ready, viewer.clock.frames - before))
        seen.set()
        hand.wait_for_light()
        assert viewer.session.light._solver.frame.photons == support.SETTINGS.photons

    viewer = play(script, open_with=lambda s: Opening(s, load=slow))
    [(phase, ready, frames)] = drawn
    assert phase == "loading scene"
    assert not ready
    assert frames >= 20
    assert errors(viewer) == []


@in_window()
def test_frame_times_are_those_of_new_pictures_in_a_row(hand, viewer, monkeypatch):
    added = []
    hand.wait(lambda: not viewer.viewport.is_redrawn)
    monkeypatch.setattr(viewer.frame_seconds, "add", added.append)
    hand.ctx.yield_(3)
    assert not added, "a picture shown again does not count"
    draw = viewer.viewport.draw
    monkeypatch.setattr(viewer.viewport, "draw", lambda *given: (viewer.viewport.redraw(), draw(*given)))
    hand.ctx.yield_(3)
    in_a_row = len(added)
    viewer.clock.slept = True
    hand.ctx.yield_()
    assert 0 < in_a_row == len(added), "the frame after a wait does not count"
    hand.ctx.yield_()
    assert len(added) > in_a_row, "the next one does"


@in_window()
def test_the_time_of_slow_drawing_counts(hand, viewer, monkeypatch):
    """The status said 48 frames per second where a software renderer took seconds per picture."""
    added = []
    draw = viewer.viewport.draw
    monkeypatch.setattr(
        viewer.viewport, "draw", lambda *given: (time.sleep(0.06), viewer.viewport.redraw(), draw(*given))
    )
    monkeypatch.setattr(type(viewer), "_is_still", property(lambda _: False))
    hand.ctx.yield_(2)
    monkeypatch.setattr(viewer.frame_seconds, "add", added.append)
    viewer.may_sleep = True
    hand.ctx.yield_(4)
    viewer.may_sleep = False
    assert added and min(added) >= 0.06


@in_window()
def test_light_has_as_much_time_as_slow_drawing(hand, viewer, monkeypatch):
    """Each result of work at rest was drawn: a software renderer took all time, and light came to 1 % in 110 s."""
    frames, drawn = [], 0.1
    monkeypatch.setattr("app.window.viewer.LINGER", 0.0)
    viewer.clock.awake_until = 0.0  # of earlier input
    draw, kind = viewer.viewport.draw, type(viewer)

    def slow(*given):
        frames.append(time.perf_counter())
        time.sleep(drawn)
        viewer.viewport.redraw()
        draw(*given)

    monkeypatch.setattr(viewer.viewport, "draw", slow)
    for name in ("_is_still", "_has_news"):
        monkeypatch.setattr(kind, name, property(lambda _: True))
    viewer.session.light.all_done = False
    monkeypatch.setattr(viewer.session, "tick", lambda *_, **__: None)
    hand.ctx.yield_(2)
    viewer.may_sleep = True
    frames.clear()
    hand.ctx.yield_(5)
    viewer.may_sleep = False
    between = np.diff(frames)[1:]
    assert len(between) and between.min() >= 1.9 * drawn
    assert between.max() < 10 * drawn


@in_window()
def test_new_light_waits_while_slow_drawing_has_had_its_time(hand, viewer, monkeypatch):
    """Not for a hand that moves something, nor for the end of all work."""
    draws, draw = [], Renderer.draw
    monkeypatch.setattr(Renderer, "draw", lambda self, look: (draws.append(look), draw(self, look)))
    monkeypatch.setattr("app.window.viewer.LINGER", 0.0)
    viewer.clock.awake_until = 0.0  # of earlier input
    hand.wait(lambda: viewer.session.light.all_done)
    hand.ctx.yield_(30)
    viewer.session.light.all_done, viewer.clock.light_until = False, time.perf_counter() + 1000
    monkeypatch.setattr(viewer.session, "tick", lambda *_, **__: None)
    count = len(draws)
    viewer.session.light.version += 1
    hand.ctx.yield_(10)
    assert len(draws) == count and viewer.painter.uploaded == viewer.session.version - 1
    viewer.session.light.all_done = True
    hand.ctx.yield_(3)
    assert len(draws) > count and viewer.painter.uploaded == viewer.session.version
    viewer.session.light.all_done, viewer.clock.light_until = False, time.perf_counter() + 1000
    viewer.session.light.version += 1
    hand.ctx.yield_(3)
    assert viewer.painter.uploaded < viewer.session.version
    viewer.painter.adopt(viewer.session)
    hand.ctx.yield_(3)
    assert viewer.painter.uploaded == viewer.session.version, "an edited scene was black until light had its time"
    viewer.clock.light_until = time.perf_counter() + 1000  # light of the next picture waits
    viewer.session.light.version += 1
    hand.ctx.yield_(3)
    assert viewer.painter.uploaded < viewer.session.version
    viewer.session.motion.playing = True
    hand.ctx.yield_(3)
    assert viewer.painter.uploaded == viewer.session.version


@pytest.mark.parametrize("where", ["draw", "draw_status"])
@in_window(problems=None)
def test_exception_in_a_part_of_the_window_is_logged_and_the_others_are_drawn(hand, viewer, monkeypatch, capfd, where):
    """It comes between begin and end of a child window, in every frame."""

    def broken(*_):
        imgui.begin_child("broken", (50, 50))
        imgui.push_id("broken")
        raise ZeroDivisionError("of a part")

    del viewer._draw_part  # as in the program
    with monkeypatch.context() as patch:
        patch.setattr(overlay, where, broken)
        hand.ctx.yield_(5)
        assert sum("of a part" in text for text in errors(viewer)) == 1, "one line, not one a frame"
        hand.ctx.set_ref("Panel")
        hand.ctx.item_input_value("##Exposure", 1.5)
        assert viewer.session.settings.exposure == 1.5, "the panel works"
    frames = viewer.clock.frames
    hand.ctx.yield_(5)
    assert viewer.clock.frames >= frames + 5
    assert capfd.readouterr().err.count("ZeroDivisionError: of a part") == 1


@in_window(problems=None)
def test_exception_in_a_stage_is_logged_and_frames_continue(hand, viewer):
    draw = viewer.painter.renderer.draw

    def broken(look):
        raise RuntimeError("GL has lost its mind")

    viewer.painter.renderer.draw = broken
    viewer.viewport.redraw()
    hand.ctx.yield_(5)
    assert "GL has lost its mind" in viewer.log.last.text
    assert len(viewer.log.entries) == 2, "one line, not one a frame"
    viewer.painter.renderer.draw = draw
    viewer.viewport.redraw()
    hand.ctx.yield_(5)
    frames = viewer.clock.frames
    hand.ctx.yield_(5)
    assert viewer.clock.frames >= frames + 5


FULL = "memory is full (Unable to allocate 9 GiB): take fewer photons, or simplify the scene"


@in_window(problems=(f"refining: {FULL}", f"moving: {FULL}"))
def test_full_memory_keeps_the_picture_and_the_program(hand, viewer, monkeypatch):
    """Allocations fail in the solver's thread: while more photons are stored, then in the frames of a drag."""
    hand.wait(lambda: viewer.painter.is_done)  # drawn with all samples
    session, picture = viewer.session, hand.pixels()
    light, start, front = session.irradiance, session.poses["block"], hand.at(BLOCK_FRONT)
    full = Mock(side_effect=MemoryError("Unable to allocate 9 GiB"))

    def old_picture_stays(problems: int) -> None:
        hand.wait(lambda: len(errors(viewer)) == problems)
        hand.wait(lambda: viewer.painter.is_done)
        assert session.irradiance is light and session.poses["block"] == start
        assert np.array_equal(hand.pixels(), picture)

    with monkeypatch.context() as patch:
        patch.setattr(PathStore, "append", full)
        session.want(replace(session.settings, photons=40_000))
        old_picture_stays(1)
    with monkeypatch.context() as patch:
        patch.setattr(cuts, "follow", full)
        hand.drag(front, (front[0] + 60, front[1]))
        hand.move((5, 5))
        old_picture_stays(2)
    hand.drag(front, (front[0] + 60, front[1]))
    hand.wait_for_light()
    assert session.poses["block"] != start and session.light.snapshot.photons == 40_000
    assert hand.light_is_that_from_scratch()


def test_unusable_scene_closes_the_window_with_its_sentence(monkeypatch):
    import app.window.viewer

    def bad(settings):
        raise SceneError("room.toml: flux must be three numbers >= 0, got [-1, 0, 2]")

    monkeypatch.setattr(app.window.viewer, "Opening", lambda s: Opening(s, load=bad))
    monkeypatch.setattr("app.window.viewer.LINGER", 0.0)  # as if reading had taken long ...
    monkeypatch.setattr(app.window.window, "wait_for_input", lambda seconds: False)  # ... and nobody had moved a mouse
    with pytest.raises(SceneError, match="flux must be"):
        app.window.viewer.run(support.SETTINGS)


def test_defect_at_the_start_is_shown_in_the_window(play):
    def broken(settings):
        raise ZeroDivisionError("division by zero")

    def script(hand, viewer):
        hand.wait(lambda: viewer.session.problem is not None)
        hand.ctx.yield_(5)
        assert not viewer.params.app_shall_exit
        hand.press(keys().h)
        assert viewer.help_open

    viewer = play(script, open_with=lambda s: Opening(s, load=broken))
    assert errors(viewer) == ["opening: division by zero"]
    from app.window.viewer import finish

    assert finish(viewer) == 1


def test_run_for_a_number_of_frames_and_a_picture_of_the_window(monkeypatch, folder):
    import app.window.viewer

    monkeypatch.setattr(app.window.viewer, "Opening", lambda s: Opening(s, load=lambda _: support.room()))
    assert app.window.viewer.run(support.SETTINGS, frames=5) == 0
    assert app.window.viewer.run(support.SETTINGS, screenshot=folder / "window.png") == 0
    with Image.open(folder / "window.png") as picture:
        assert picture.size == support.SETTINGS.size
        assert len(np.unique(np.asarray(picture)[..., :3].reshape(-1, 3), axis=0)) > 500
    assert (folder / "config").is_dir(), "the ini file is the user's, not the working folder's"
    assert not list(folder.glob("*.ini"))


def test_ctrl_c_closes_the_window_as_its_button_does(monkeypatch):
    """While the scene is still being opened; afterwards the earlier handler is restored."""
    import app.window.viewer

    never = threading.Event()
    loaded = []
    monkeypatch.setattr(
        app.window.viewer, "Opening", lambda s: Opening(s, load=lambda _: loaded.append(never.wait(support.PATIENCE)))
    )
    before = signal.getsignal(signal.SIGINT)

    drawing, begin = threading.Event(), app.window.viewer.Viewer._begin_frame
    monkeypatch.setattr(app.window.viewer.Viewer, "_begin_frame", lambda viewer: (begin(viewer), drawing.set()))

    def interrupt() -> None:
        assert drawing.wait(support.PATIENCE)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    assert app.window.viewer.run(support.SETTINGS) == 0
    assert not loaded, "not until the loader is done"
    assert signal.getsignal(signal.SIGINT) is before
    never.set()


def test_a_long_job_does_not_outlive_the_program():
    code = """
        import time
        from app.worker import Worker
        worker = Worker()
        assert worker.submit(lambda: 6 * 7).wait(600)
        job = worker.submit(lambda: time.sleep(600))
        worker.close()
        assert not job.wait(0.1)
    """
    run = [sys.executable, "-c", textwrap.dedent(code)]
    subprocess.run(run, cwd=str(support.ROOT), check=True, timeout=300)  # less than the job takes


@pytest.mark.parametrize(
    ("found", "package"),
    [("libX11.so.6: cannot open shared object file", "libx11-6"), ("libGL.so.1: cannot open", "libgl1")],
)
def test_a_missing_library_is_named_with_its_package(monkeypatch, found, package):
    def missing(name):
        raise ImportError(found)

    monkeypatch.setattr(window, "import_module", missing)
    sentence = window.why_no_window()
    assert f"apt install {package}" in sentence and "gi-viewer render" in sentence and "\n" not in sentence


def test_without_a_display_the_reason_is_one_sentence():
    """In a separate process: this one is set up without a screen."""
    script = """
        import os
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_SESSION_TYPE"):
            os.environ.pop(name, None)
        from app.window.window import why_no_window
        print(why_no_window())
    """
    if not sys.platform.startswith("linux"):
        pytest.skip("a screen is always there")
    root = str(support.ROOT)
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, timeout=60, cwd=root
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.strip().splitlines()) == 1
    assert "display" in done.stdout and "gi-viewer render" in done.stdout


def test_the_title_is_the_scenes_or_the_documents(play):
    """ImGui takes UTF-8 alone: a name that is none was a TypeError, and no window."""
    names = ("some/kitchen.glb", "", "kitchen"), ("some/kitchen.glb", "some/kitchen-eve.toml", "kitchen-eve")
    for scene, document, title in (*names, ("/rooms/r\udcff.obj", "", "r\ufffd")):
        viewer = play(lambda hand, _: hand.wait_for_light(), replace(support.SETTINGS, scene=scene, document=document))
        assert viewer.params.app_window_params.window_title == f"{title} - gi-viewer" and errors(viewer) == []


def test_the_panel_is_as_wide_on_a_screen_of_another_scale(monkeypatch, folder):
    """The ini file has its width in pixels: a file written at 96 dots per inch is not read at 192."""
    import glfw

    names = set()
    for scale in (1.0, 1.5, 2.0):
        monkeypatch.setattr(glfw, "get_primary_monitor", lambda: "screen")
        monkeypatch.setattr(glfw, "get_monitor_content_scale", lambda _, s=scale: (s, s))
        params = window.runner_params(support.SETTINGS, *[lambda: None] * 4)
        names.add(os.path.basename(params.ini_filename))
        assert not params.ini_disable
    assert names == {"window.ini", "window-1.5x.ini", "window-2x.ini"}
    monkeypatch.setattr(glfw, "get_primary_monitor", lambda: None)
    assert window.screen_scale() == 1


def test_unwritable_config_folder_disables_window_settings(monkeypatch, folder):
    nowhere = folder / "file"
    nowhere.write_text("")
    monkeypatch.setattr("platformdirs.user_config_dir", lambda *_, ensure_exists, **__: (nowhere / "x").mkdir())
    assert window.config_folder() is None
    assert window.runner_params(support.SETTINGS, *[lambda: None] * 4).ini_disable
    monkeypatch.setattr(window, "config_folder", lambda: folder)
    (folder / window.ini_name(window.screen_scale())).mkdir()  # HelloImGui ended the program
    assert window.runner_params(support.SETTINGS, *[lambda: None] * 4).ini_disable


@in_window(lit=False)
def test_no_frame_is_drawn_while_nothing_changes(hand, viewer, monkeypatch):
    """Between two events the window waits; each event makes one frame, and no frame a picture or a job."""
    waits, draws, jobs, draw, begin = [], [], [], Renderer.draw, SolverThread._begin
    monkeypatch.setattr(Renderer, "draw", lambda self, look: (draws.append(look), draw(self, look)))
    monkeypatch.setattr(SolverThread, "_begin", lambda self, job, *stop: (jobs.append(job), begin(self, job, *stop)))

    def wait(seconds: float) -> bool:
        waits.append((viewer.clock.frames, len(draws), len(jobs), seconds))
        return len(waits) % 50 == 0

    monkeypatch.setattr("app.window.viewer.LINGER", 0.0)
    viewer.clock.awake_until = 0.0  # of earlier input
    monkeypatch.setattr("app.window.window.wait_for_input", wait, raising=False)
    hand.wait_for_light()
    # Each frame asks again for work at rest; it waits for the answer, not for its budget.
    monkeypatch.setattr(viewer.clock, "budget", lambda moving: support.PATIENCE)
    hand.wait(lambda: viewer.session.light.all_done)
    hand.ctx.yield_(30)
    viewer.may_sleep = True
    hand.ctx.yield_(6)  # the first may still fade a message
    viewer.may_sleep = False
    frames, drawn, begun, seconds = zip(*waits, strict=True)
    assert len(waits) >= 150 and all(frames.count(n) == 50 for n in set(frames[:150]))
    assert draws and jobs and len(set(drawn)) == 1
    assert len(set(zip(frames, begun, strict=True))) == len(set(frames)), "work without an event"
    assert min(seconds) > 0.1, "waits of 0 s would use a core"
    hand.press(keys().space)
    viewer.may_sleep = True
    count = len(waits)
    hand.ctx.yield_(10)
    assert len(waits) == count, "it plays"
    viewer.may_sleep = False


@in_window(measure_errors=True, lit=False)
def test_work_at_rest_goes_on_between_frames(hand, viewer, monkeypatch):
    """Errors are measured to the end while no input comes; the frames between would show new numbers alone."""
    ticks, waits = [], []

    def wait(seconds):  # the twentieth ends with input
        waits.append(viewer.clock.frames)
        return waits.count(viewer.clock.frames) == 20

    monkeypatch.setattr("app.window.viewer.LINGER", 0.0)
    viewer.clock.awake_until = 0.0  # of earlier input
    monkeypatch.setattr("app.window.viewer.REFRESH", 1e9)
    monkeypatch.setattr("app.window.window.wait_for_input", wait)
    monkeypatch.setattr("app.rest.live_error.FINAL_NOISE", 0.0)  # measuring lasts until the script ends it
    monkeypatch.setattr("app.rest.live_error.NOISE_OF_ERROR", 0.0)
    hand.wait_for_light()
    session, tick = viewer.session, viewer.session.tick
    hand.wait(lambda: viewer.painter.is_done and session.light.snapshot.rest.report is not None)
    session.tick = lambda *given, **more: (ticks.append(viewer.clock.frames), tick(*given, **more))
    viewer.may_sleep = True
    hand.wait(lambda: waits)
    assert not session.light.all_done
    monkeypatch.setattr("app.rest.live_error.FINAL_NOISE", 1.0)
    hand.wait(lambda: session.light.all_done)
    viewer.may_sleep = False
    assert session.light.snapshot.rest.report.done
    assert ticks.count(waits[0]) >= 20, "tasks without a frame"
