"""The viewer end to end: a window without a screen, driven with ImGui's test engine as a hand would."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import viewer_support as support

from app import drag
from app.png import read_parameters
from gi_core.scene import SceneError

pytestmark = pytest.mark.gl

BLOCK_FRONT = (0.5, 0.3, 0.62)  # a point on the mobile that the camera sees


@pytest.fixture(autouse=True)
def gl():
    reason = support.screenless()
    if reason:
        support.need_gl(reason)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path


class Hand:
    """The test engine's context with words for what a user does."""

    def __init__(self, viewer, ctx) -> None:
        self.viewer, self.ctx = viewer, ctx
        self._jobs = []
        viewer.params.callbacks.pre_new_frame = self._run_jobs

    def _run_jobs(self) -> None:
        while self._jobs:
            self._jobs.pop()()

    def wait(self, what, seconds: float = 20.0) -> None:
        """Let frames pass until something holds."""
        limit = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < limit, "waited too long"
            self.ctx.yield_()

    def wait_for_light(self) -> None:
        self.wait(lambda: self.viewer._ready and not self.viewer.session.refining)
        self.ctx.yield_(2)

    def at(self, point) -> tuple[float, float]:
        """Return where a point of the scene is in the window."""
        v = self.viewer.viewport
        x, y = v.camera.project(point, v.aspect)
        return v.origin[0] + x * v.size[0], v.origin[1] + y * v.size[1]

    def move(self, to) -> None:
        self.ctx.mouse_move_to_pos(to)
        self.ctx.yield_(2)

    def drag(self, start, end, button: int = 0, modifier=None, steps: int = 3) -> None:
        self.move(start)
        if modifier is not None:
            self.ctx.key_down(modifier)
            self.ctx.yield_()
        self.ctx.mouse_down(button)
        for k in range(1, steps + 1):
            self.move([a + (b - a) * k / steps for a, b in zip(start, end, strict=True)])
        self.ctx.mouse_up(button)
        if modifier is not None:
            self.ctx.key_up(modifier)
        self.ctx.yield_(2)

    def press(self, key) -> None:
        self.ctx.key_press(key)
        self.ctx.yield_(3)

    def pixels(self) -> np.ndarray:
        """Read the picture back, on the window's thread: this one, the engine's, has no GL context."""
        self.ctx.yield_(2)
        read = []
        self._jobs.append(lambda: read.append(self.viewer.renderer.pixels().copy()))
        self.wait(lambda: read)
        return read[0]


@pytest.fixture
def play():
    """Return a function that runs a script(hand, viewer) in a viewer of the small room."""

    def run(script, settings=support.SETTINGS, open_with=None, quits=False):
        from app.viewer import Viewer

        viewer = Viewer(settings, open_with or support.opening(support.room()))
        failed = []

        def test(ctx):
            try:
                script(Hand(viewer, ctx), viewer)
            except BaseException as problem:  # the engine would lose the traceback
                failed.append(problem)

        support.drive(viewer, test, quits)
        if failed:
            raise failed[0]
        return viewer

    return run


def keys():
    from imgui_bundle import imgui

    return imgui.Key


def errors(viewer) -> list[str]:
    return [e.text for e in viewer.log.entries if e.level == "error"]


def test_the_window_lives_while_the_scene_opens(play):
    """Frames go on behind a loader that takes its time, its phase is shown, and then there is light."""
    from app.opening import Opening

    frames = []

    def slow(settings):
        time.sleep(0.4)
        return support.room()

    def script(hand, viewer):
        hand.wait(lambda: viewer._ready or frames.append(viewer.session.opening and viewer.session.opening.phase))
        hand.wait_for_light()
        assert viewer.session.solver.photons_traced == support.SETTINGS.photons

    viewer = play(script, open_with=lambda s: Opening(s, load=slow))
    assert frames.count("loading scene") > 15
    assert errors(viewer) == []


def test_dragging_a_mobile_moves_it_and_its_light_in_the_same_frame(play):
    K = keys()
    seen = []

    def script(hand, viewer):
        session, viewport = viewer.session, viewer.viewport
        hand.wait_for_light()
        start, before = session.poses["block"], hand.pixels()

        # Hovering tells what a drag would do.
        hand.move(hand.at(BLOCK_FRONT))
        assert viewport.hover is not None and "Shift: up and down" in viewport.hint()
        hand.pixels()

        # A plain drag: another place at the same height. Each frame's picture belongs to that frame's pose.
        upload = viewer.renderer.set_colours

        def watched(o, front, back):
            if o == 0:
                seen.append((session.version, session.poses["block"], session.irradiance))
            upload(o, front, back)

        viewer.renderer.set_colours = watched
        start_at = hand.at(BLOCK_FRONT)
        hand.drag(start_at, (start_at[0] + 90, start_at[1] - 8))
        moved = session.poses["block"]
        assert moved.position[0] > start.position[0] + 0.08
        assert moved.position[1] == pytest.approx(start.position[1], abs=1e-12)
        assert len(seen) >= 3
        for version, _, irradiance in seen[:-1]:
            assert irradiance is not session.irradiance or version == session.version
        assert np.array_equal(session.irradiance, session.solver.from_scratch()), "the light of this very pose"
        hand.move(hand.at((0.1, 0.9, 0.1)))
        after = hand.pixels()
        assert (np.abs(after.astype(int) - before).max(axis=2) > 8).mean() > 0.02

        # Undo and redo.
        hand.press(K.mod_ctrl | K.z)
        assert session.poses["block"] == start
        hand.press(K.mod_ctrl | K.mod_shift | K.z)
        assert session.poses["block"] == moved

        # Shift: vertically. Alt: in the picture. Ctrl: turned in place.
        at = hand.at((moved.position[0], 0.3, moved.position[2] + 0.1))
        hand.drag(at, (at[0] + 30, at[1] - 50), modifier=K.mod_shift)
        lifted = session.poses["block"]
        assert lifted.position[1] > moved.position[1] + 0.05
        assert lifted.position[0] == moved.position[0] and lifted.position[2] == moved.position[2]
        at = hand.at((lifted.position[0], lifted.position[1], lifted.position[2] + 0.1))
        hand.drag(at, (at[0] - 40, at[1] + 30), modifier=K.mod_alt)
        facing = session.poses["block"]
        assert facing.position[0] < lifted.position[0] and facing.position[1] < lifted.position[1]
        at = hand.at((facing.position[0], facing.position[1], facing.position[2] + 0.1))
        hand.drag(at, (at[0] + 40, at[1]), modifier=K.mod_ctrl)
        assert session.poses["block"].quaternion != facing.quaternion
        assert session.poses["block"].position == facing.position

        # Esc puts it back while the button is still down.
        current = session.poses["block"]
        at = hand.at((current.position[0], current.position[1], current.position[2]))
        hand.move(at)
        hand.ctx.mouse_down(0)
        hand.move((at[0] - 60, at[1]))
        assert viewport.grab is not None and viewport.grab.mode == drag.SLIDE
        assert session.poses["block"] != current
        hand.press(K.escape)
        assert session.poses["block"] == current
        hand.move((at[0] - 90, at[1]))
        hand.ctx.mouse_up(0)
        assert session.poses["block"] == current

        # R: everything as at the start.
        hand.press(K.r)
        assert session.poses["block"] == start

    assert errors(play(script)) == []


def test_camera_by_mouse(play):
    K = keys()

    def script(hand, viewer):
        viewport = viewer.viewport
        hand.wait_for_light()
        home, pose = viewport.camera, dict(viewer.session.poses)
        wall = hand.at((0.15, 0.8, 0.0))
        hand.drag(wall, (wall[0] + 60, wall[1] + 20))
        orbited = viewport.camera
        assert orbited.yaw != home.yaw and orbited.pitch != home.pitch and orbited.pivot == home.pivot
        hand.drag(wall, (wall[0] + 60, wall[1]), modifier=K.mod_shift)
        panned = viewport.camera
        assert panned.pivot != home.pivot and panned.yaw == orbited.yaw
        hand.drag(wall, (wall[0], wall[1] + 30), button=2)
        assert viewport.camera.pivot != panned.pivot
        hand.ctx.mouse_wheel_y(2)
        hand.ctx.yield_(2)
        assert viewport.camera.distance < home.distance
        hand.press(K.home)
        hand.wait(lambda: viewport._flight is None)
        assert viewport.camera == home

        # A double click makes the point under the cursor the pivot.
        hand.move(hand.at((0.2, 0.6, 0.0)))
        hand.ctx.mouse_double_click(0)
        hand.ctx.yield_(2)
        hand.wait(lambda: viewport._flight is None)
        assert viewport.camera.pivot == pytest.approx((0.2, 0.6, 0.0), abs=0.03)
        assert viewer.session.poses == pose, "no camera motion moves an object"

    assert errors(play(script)) == []


def test_panel_controls(play):
    from imgui_bundle import imgui

    from gi_core.estimators import ESTIMATORS

    K = keys()

    def script(hand, viewer):
        session, ctx = viewer.session, hand.ctx
        hand.wait_for_light()
        names = list(ESTIMATORS)

        # Estimators by combo and by key, without tracing anything again.
        before = hand.pixels()
        ctx.set_ref("Panel")
        ctx.combo_click(f"##Estimator/{names[-1].replace('_', ' ').capitalize()}")
        hand.wait_for_light()
        assert session.solver.estimator == session.settings.estimator == names[-1]
        assert (hand.pixels() != before).any()
        for k, name in enumerate(names[:3]):
            hand.press((K._1, K._2, K._3)[k])
            hand.wait_for_light()
            assert session.solver.estimator == name

        # Values typed in.
        ctx.item_input_value("##Radius", 0.1)
        ctx.item_input_value("##k", 12)
        ctx.item_input_value("##Photons", 30_000)
        hand.wait_for_light()
        assert session.solver.radius == pytest.approx(0.1)
        assert session.solver.neighbours == 12
        assert session.solver.photons_traced == 30_000

        # Exposure by slider, then metered again.
        metered = session.settings.exposure
        ctx.item_input_value("##Exposure", metered - 2)
        dark = hand.pixels()
        ctx.item_click("Meter")
        ctx.yield_(2)
        assert session.settings.exposure == pytest.approx(metered, abs=0.3)
        assert hand.pixels().mean() > dark.mean() + 20

        ctx.combo_click("##Tone map/Clip")
        ctx.combo_click("##Show/Irradiance only")
        ctx.item_uncheck("##Doll's house")
        ctx.yield_(2)
        s = session.settings
        assert (s.tone_map, s.show, s.cull) == ("clip", "irradiance", False)
        from app.renderer import UNLIT

        grey = np.round(255 * np.array(UNLIT)).astype(int)
        middle = hand.pixels()[viewer.renderer.size[1] // 2, viewer.renderer.size[0] // 2]
        assert np.array_equal(middle, grey), f"{middle}, not {grey}: the closed room from outside, its walls drawn"

        # Every control tells what it does.
        for ref in ("##Estimator", "##Photons", "##Radius", "##k", "##Exposure", "Meter", "##Tone map", "##Show",
                    "##Doll's house", "###Play", "Reset pose", "Reset view"):  # fmt: skip
            ctx.mouse_move(ref)
            ctx.sleep_no_skip(0.7, 0.1)
            windows = [w for w in imgui.get_current_context().windows if w.name.startswith("##Tooltip") and w.active]
            assert windows, f"{ref} has no tooltip"

    assert errors(play(script)) == []


def test_a_slider_drag_never_holds_a_frame_up(play):
    """While Radius is dragged to and fro the solver is left alone; then its steps run beside the window's thread.

    How long a frame may wait for them is counted in test_session.py, on a clock that no busy machine disturbs.
    """
    threads, configured, waited = set(), [], []

    def script(hand, viewer):
        session, ctx = viewer.session, hand.ctx
        hand.wait_for_light()
        solver = session.solver
        configure, solve_steps, tick = solver.configure, solver.solve_steps, session.tick

        def watched_steps():
            for progress in solve_steps():
                threads.add(threading.get_ident())
                yield progress

        def watched_tick(*arguments):
            started = time.perf_counter()
            tick(*arguments)
            waited.append(time.perf_counter() - started)
            windows_thread.add(threading.get_ident())

        windows_thread = set()
        solver.configure = lambda **changes: (configured.append(changes), configure(**changes))
        solver.solve_steps, session.tick = watched_steps, watched_tick
        info = ctx.item_info("//Panel/##Radius")
        low, high = info.rect_full.min, info.rect_full.max
        y = (low.y + high.y) / 2
        ctx.mouse_move_to_pos((low.x + 40, y))
        ctx.mouse_down(0)
        for k in range(40):
            ctx.mouse_move_to_pos((low.x + 40 + (high.x - low.x - 80) * (k % 20) / 20, y))
        assert configured == [] and threads == set(), "not while it moves"
        ctx.mouse_up(0)
        ctx.yield_(3)
        hand.wait(lambda: not session.refining)
        assert len(configured) == 1 and list(configured[0]) == ["radius"]
        assert session.solver.radius == session.settings.radius != support.SETTINGS.radius
        assert threads and not threads & windows_thread

    assert errors(play(script)) == []
    assert np.quantile(waited, 0.9) < 0.05, "frames come more often than every 50 ms"


def test_keys(play, folder):
    K = keys()

    def script(hand, viewer):
        session = viewer.session
        hand.wait_for_light()
        width = viewer.viewport.size[0]
        hand.press(K.tab)
        assert not viewer._panel.is_visible
        hand.wait(lambda: viewer.viewport.size[0] > width)
        hand.press(K.tab)
        hand.wait(lambda: viewer.viewport.size[0] == width)
        hand.press(K.h)
        assert viewer.help_open
        hand.press(K.h)
        assert not viewer.help_open

        start = session.poses["block"]
        hand.press(K.space)
        assert session.playing
        hand.wait(lambda: session.poses["block"] != start)
        hand.press(K.space)
        assert not session.playing
        moved = session.poses["block"]
        hand.ctx.yield_(3)
        assert session.poses["block"] == moved

        hand.press(K.p)
        hand.press(K.f12)
        assert "gi-viewer-002.png" in viewer.log.last.text
        hand.press(K.a)
        assert "metered" in viewer.log.last.text
        hand.press(K.mod_ctrl | K.q)

    viewer = play(script, quits=True)
    assert errors(viewer) == []
    assert viewer.params.app_shall_exit
    told = read_parameters(folder / "gi-viewer-001.png")
    assert told["scene"] == "room" and told["estimator"] == "tangent_plane" and told["photons"] == "20000"
    assert told["radius"] == "0.06 m" and told["neighbours"] == "40" and told["seed"] == "0"
    assert told["pose block"].count(",") == 6 and "EV" in told["exposure"]
    assert told["camera"].startswith("position 0.5,0.55,2.9 target 0.5,0.45,0.5")
    from PIL import Image

    with Image.open(folder / "gi-viewer-001.png") as picture:
        assert picture.size == tuple(map(round, viewer.viewport.size))
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(colours, axis=0)) > 500, "a lit room"


def test_an_exception_in_a_stage_is_told_in_the_window_which_lives_on(play):
    def script(hand, viewer):
        hand.wait_for_light()
        draw = viewer.renderer.draw

        def broken(look):
            raise RuntimeError("GL has lost its mind")

        viewer.renderer.draw = broken
        viewer.viewport.redraw()
        hand.ctx.yield_(5)
        assert "GL has lost its mind" in viewer.log.last.text
        assert len(viewer.log.entries) == 2, "one line, not one a frame"
        viewer.renderer.draw = draw
        viewer.viewport.redraw()
        hand.ctx.yield_(5)
        frames = viewer.frames
        hand.ctx.yield_(5)
        assert viewer.frames >= frames + 5

    play(script)


def test_a_scene_that_cannot_be_used_closes_the_window_with_its_sentence(monkeypatch):
    import app.viewer
    from app.opening import Opening

    def bad(settings):
        raise SceneError("room.toml: flux must be three numbers >= 0, got [-1, 0, 2]")

    monkeypatch.setattr(app.viewer, "Opening", lambda s: Opening(s, load=bad))
    with pytest.raises(SceneError, match="flux must be"):
        app.viewer.run(support.SETTINGS)


def test_a_failure_of_our_own_at_the_start_is_shown_and_the_window_stays(play):
    from app.opening import Opening

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
    from app.viewer import finish

    assert finish(viewer) == 1


def test_run_for_a_number_of_frames_and_a_picture_of_the_window(monkeypatch, folder):
    import app.viewer
    from app.opening import Opening

    monkeypatch.setattr(app.viewer, "Opening", lambda s: Opening(s, load=lambda _: support.room()))
    assert app.viewer.run(support.SETTINGS, frames=5) == 0
    assert app.viewer.run(support.SETTINGS, screenshot=folder / "window.png") == 0
    from PIL import Image

    with Image.open(folder / "window.png") as picture:
        assert picture.size == support.SETTINGS.size
        assert len(np.unique(np.asarray(picture)[..., :3].reshape(-1, 3), axis=0)) > 500
    assert (folder / "config").is_dir(), "the ini file is the user's, not the working folder's"
    assert not list(folder.glob("*.ini"))


def test_the_window_opens_where_one_can_be_had():
    from app.window import why_no_window

    assert why_no_window() is None
    assert why_no_window() is None, "and again"


@pytest.mark.parametrize(
    ("found", "package"),
    [("libX11.so.6: cannot open shared object file", "libx11-6"), ("libGL.so.1: cannot open", "libgl1")],
)
def test_a_missing_library_is_named_with_its_package(monkeypatch, found, package):
    from app import window

    def missing(name):
        raise ImportError(found)

    monkeypatch.setattr(window, "import_module", missing)
    sentence = window.why_no_window()
    assert f"apt install {package}" in sentence and "gi-viewer render" in sentence and "\n" not in sentence


def test_without_a_display_the_reason_is_one_sentence():
    """In a process of its own: this one has been told to do without a screen."""
    script = """
        import os
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_SESSION_TYPE"):
            os.environ.pop(name, None)
        from app.window import why_no_window
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


def test_settings_survive_in_the_title(play):
    def script(hand, viewer):
        hand.ctx.yield_(2)

    viewer = play(script, settings=replace(support.SETTINGS, scene="some/kitchen.glb"))
    assert viewer.params.app_window_params.window_title == "kitchen - gi-viewer"
