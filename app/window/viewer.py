"""The viewer: one window, one loop: input, light, draw; times of frames; its run, from open to exit code."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from imgui_bundle import hello_imgui, imgui, immapp, implot

from app.draw.picture_files import write_png
from app.session.lights import EXPOSURE_STAYS, changes_exposure, flux_of
from app.session.log import WARNING, Log
from app.session.opening import COMPILING, Opening
from app.session.reload import Reload
from app.session.session import LIGHT_TIME, Session
from app.session.solver_thread import MovingMedian
from app.settings import Settings, UsageError
from app.window import menus, method_marks, overlay, panel, readout_marks, spot_card, window
from app.window.actions import act
from app.window.actions.files import drop, open_files
from app.window.files import Files
from app.window.menus import Menus
from app.window.painter import Painter
from app.window.viewport import Viewport
from app.worker import limit_arenas
from gi_core.scene import SceneError

LONGEST_WAIT = 0.02  # s per frame for refinement if drawing is slow
DOUBLE_CLICK = 0.3  # s, ImGui's default
LINGER = 1.0  # s of frames after the last input: tooltips come and fade


class FrameClock:
    """`begin` and `end` with each frame."""

    def __init__(self) -> None:
        self.frames = 0
        self.slept = False  # between the last frame and this one
        self.seconds = 0.0  # since the frame before, at most 0.1
        self.light_seconds = 0.0  # of the last frame: refinement or a move
        self.light_until = 0.0  # without input, light has its time until then
        self.awake_until = 0.0  # after input
        self._before = time.perf_counter()

    def begin(self, has_input: bool) -> float:
        """Begin a frame; return the time [s] since the last one began."""
        now = time.perf_counter()
        seconds, self._before = now - self._before, now
        self.seconds = min(seconds, 0.1)  # an animation does not jump after a pause
        self.frames += 1
        if has_input:
            self.awake_until = now + LINGER
        return seconds

    def drew(self) -> None:
        """Give light as much time as this frame's picture took."""
        now = time.perf_counter()
        # Light gets as much time as slow drawing takes, up to 4 s without a new picture.
        self.light_until = now + min(now - self._before - self.light_seconds, 4.0)

    def wake(self) -> None:
        """End a sleep: it does not count as time of a frame."""
        self._before = max(self._before, time.perf_counter() - LONGEST_WAIT)

    @property
    def is_awake(self) -> bool:
        """Whether input was a moment ago."""
        return time.perf_counter() < self.awake_until

    @property
    def is_lights_turn(self) -> bool:
        """Whether light has its time, before the next picture."""
        return time.perf_counter() < self.light_until

    def budget(self, moving: bool) -> float:
        """Return the time that a frame waits for refinement [s]: as long as its other work takes, within bounds.

        moving: whether the camera moves. Slow drawing shares the cores with light, which gets half of the time at rest.
        """
        return LIGHT_TIME if moving else min(max(self.seconds - self.light_seconds, LIGHT_TIME), LONGEST_WAIT)


REFRESH = 0.5  # s between frames while work at rest changes numbers alone


class Viewer:
    """The program behind the window. HelloImGui calls `draw_viewport` and the other parts once per frame."""

    def __init__(self, settings: Settings, open_with: Callable | None = None) -> None:
        limit_arenas()
        self.log = Log()
        self.session = Session(settings, self.log, open_with or Opening)
        self.reload = Reload(open_with or Opening)
        self.viewport = Viewport(self.session)
        self.painter = Painter()
        self.files = Files()
        self.menus = Menus(self.files, self._do, self.open_scene)
        self.params = window.runner_params(
            settings,
            viewport=self.draw_viewport,
            panel=lambda: self._draw_part("panel", self._draw_panel),
            status=lambda: self._draw_part("status", self._draw_status),
            menus=lambda: self._draw_part("menus", lambda: self.menus.draw(self.session)),
        )
        self._may_leave = False  # without a question
        self.params.callbacks.show_gui = self._begin_frame
        self.params.callbacks.after_swap = self._end_frame
        self.folds = panel.Folds()
        self.params.callbacks.post_init = self._begin
        self.params.callbacks.before_exit = self._close
        self.frame_seconds = MovingMedian()
        self.clock = FrameClock()
        self.frames_left: int | None = None
        self.exit_when_refined = False
        self.keyboard = menus.Keyboard()
        self.help_open = False
        self.may_sleep = True  # between frames in which nothing changes
        self._ready = False
        self._news = ""  # for the log: how the scene on show came
        self._waits_for_save = False

    # HelloImGui's callbacks -------------------------------------------------------------------------

    def _begin(self) -> None:
        implot.create_context()
        self.menus.load_preferences()
        self.folds.load()
        self.files.load_preferences()
        window.on_drop(self.reload.dropped.extend)

    def _begin_frame(self) -> None:
        has_input = bool(len(imgui.get_current_context().input_events_trail)) or imgui.is_any_item_active()
        seconds = self.clock.begin(has_input)
        if not self.holds_field:
            self.session.history.press = self.clock.frames
        # ImGui takes one event of the mouse per frame: press, release and press need three
        io = imgui.get_io()
        io.mouse_double_click_time = max(DOUBLE_CLICK, 3 * seconds)
        io.mouse_single_click_delay = io.mouse_double_click_time + DOUBLE_CLICK  # ImGui asks for a longer one
        if self.clock.frames == 1:
            self.painter.open()
        if self.viewport.is_redrawn and not self.clock.slept:  # frames that repeat a picture would hide slow ones
            self.frame_seconds.add(seconds)
        self.clock.slept = False
        if self.params.app_shall_exit and not self._may_leave:  # the window's close button
            self.params.app_shall_exit = False
            window.refuse_to_close()
            self.leave()
        pressed = self.keyboard.pressed()
        for action in () if self.viewport.control.is_looking else pressed:
            self._do(action)
        self._guard("files", self._draw_dialogs)
        if self.help_open:
            (x, y), (w, h) = self.viewport.view.origin, self.viewport.view.size
            self.help_open = menus.draw_help(self._ready, (x, y, w, h), self.help_open)
        self._guard("opening", self._replace_session)
        if is_user_error(self.session.problem) and self.reload.coming is None:  # printed on the terminal, see `run`
            self.leave(ask=False)
        if self._ready and self.frames_left is not None:
            self.frames_left -= 1
            if self.frames_left <= 0:
                self.leave(ask=False)
        if self._ready and self.exit_when_refined and not self.session.refining and self.painter.is_done:
            self.leave(ask=False)

    @property
    def holds_field(self) -> bool:
        """Whether the mouse holds a field of the panel, or the mark of a lamp."""
        return imgui.is_any_item_active() or self.viewport.lamps.held is not None

    def _end_frame(self) -> None:
        self.painter.finish()
        if self.viewport.is_redrawn:
            self.clock.drew()
        if self.may_sleep:
            self._sleep()

    @property
    def _is_still(self) -> bool:
        """Whether the next frame would equal the last one; one that closes the window is still to come."""
        failed = self.session.problem is not None and not is_user_error(self.session.problem)
        unchanged = self.painter.is_done and not self.viewport.is_fading if self._ready else failed
        waits = self.session.opening is None and self.reload.coming is None and not self.params.app_shall_exit
        return bool(unchanged and waits and not self._is_counted and not self.clock.is_awake)

    @property
    def _is_counted(self) -> bool:
        """Whether the window closes by itself, after some frames or with all photons."""
        return self.frames_left is not None or self.exit_when_refined

    @property
    def _has_news(self) -> bool:
        """Whether there is light that no picture shows."""
        return self.session.version != self.painter.uploaded

    @property
    def _holds(self) -> bool:
        """Whether new light is not yet drawn: light has as much time as slow drawing, while nobody waits for it."""
        active = self.viewport.control.is_moving or self.session.motion.is_active
        waits = self.clock.is_lights_turn and not self.clock.is_awake
        return waits and not (active or self._is_counted or self.session.light.all_done)

    def _sleep(self) -> None:
        """Wait for input or new light while nothing changes; work at rest goes on."""
        if not self._ready and self.session.opening is not None:
            # frames of software GL took a seventh of two cores from the compilation
            window.wait_for_input(0.25 if self.session.opening.phase in COMPILING.values() else 0.05)
        refresh = time.perf_counter() + REFRESH
        while self._is_still:
            self.clock.slept = True
            resting = self._ready and not self.session.light.all_done
            if resting:
                self._guard("light", lambda: self.session.tick(0.0, budget=LONGEST_WAIT))
            # An idle window checks for signals twice per second.
            if window.wait_for_input(0.0 if resting else 0.5) or self.files.dialog.is_open:
                break
            if self.files.changed_on_disk(time.monotonic()):
                self._do("reload")
                break
            due = self._has_news or time.perf_counter() >= refresh
            if resting and (self.session.light.all_done or (due and not self.clock.is_lights_turn)):
                break
        if self.clock.slept:
            self.clock.wake()

    def draw_viewport(self) -> None:
        """Handle input, update the light, draw: the picture shows the poses of this frame."""
        flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse
        imgui.push_style_var(imgui.StyleVar_.window_padding, (0, 0))
        imgui.begin("Viewport", None, flags)
        imgui.pop_style_var()
        self._draw_part("input", lambda: self.viewport.handle_input(self.clock.seconds))
        editing = imgui.is_any_item_active() and not self.session.motion.dragging  # in which the window is active
        still = not (self.viewport.control.is_moving or self.reload.is_editing)
        started, budget = time.perf_counter(), self.clock.budget(self.viewport.control.is_moving)
        self._guard("light", lambda: self.session.tick(self.clock.seconds, editing, budget, still))
        self.clock.light_seconds = time.perf_counter() - started
        if self.session.ready and not self._ready:
            self._ready = True  # one attempt, even a failed one
            self._guard("start", lambda: self._adopt(self.session))
        if self._ready:
            self._guard("drawing", lambda: self.painter.draw(self.session, self.viewport, self._holds))
        elif (opening := self.session.opening) is not None and (look := opening.look) is not None:
            settings = self.session.settings
            self._guard("first look", lambda: self.painter.draw_look(look, settings))
        self._draw_part("overlay", self._draw_over)
        imgui.end()

    def _draw_over(self) -> None:
        """Draw marks, texts and buttons over the picture."""
        if self._ready:
            self.viewport.lamps.draw(self.session, self.viewport.view)
            readout_marks.draw(self.viewport)
            spot_card.draw(self.viewport)
            method_marks.draw(self.viewport, self.session.light.method)
        if self._ready and self.session.settings.cells:
            self.painter.ray_cells.draw(self.viewport)
        overlay.draw(self.viewport, self.session, self.reload, self._ready)

    def _draw_panel(self) -> None:
        if not self._ready:
            imgui.text_wrapped("The controls appear with the first light that they can change.")
            return
        wanted, actions = panel.draw(self, self.folds)
        self.session.take(wanted, held=imgui.is_any_item_active())
        for action in actions:
            self._do(action)

    def _draw_status(self) -> None:
        state = ""
        if self._ready and self.session.ready:
            state = panel.quality.status_of(self.session).text
            if self.session.in_motion or self.viewport.control.is_moving:  # at rest, few new pictures are needed
                state += f"  ·  {panel.quality.frame_rate(self.frame_seconds.value)}"
        overlay.draw_status(self.log, self.viewport.readout(), state, time.monotonic())

    def _draw_dialogs(self) -> None:
        """Draw open dialogs and act on their answers."""
        self.files.dialog.poll()
        self.files.dialog.draw()
        s = self.session.settings
        answer = self.files.question.draw(Path(s.document or s.scene).name)
        if answer == "save":
            self._do("save")
            self._waits_for_save = True
        elif answer == "discard":
            self.files.question.go_on()
        if self._waits_for_save and not self.files.dialog.is_open:
            self._waits_for_save = False
            if not self.files.has_changed(self.session):  # else the dialog was cancelled, or saving has failed
                self.files.question.go_on()
        if self.files.changed_on_disk(time.monotonic()) and self.session.ready:
            self._do("reload")

    def open_scene(self, scene: str) -> None:
        open_files(self, [scene])

    def leave(self, ask: bool = True) -> None:
        if ask and self.files.has_changed(self.session) and not self.files.question.is_open:
            self.files.question.ask("Quit without saving", lambda: self.leave(ask=False))
            return
        self._may_leave = self.params.app_shall_exit = True

    def _close(self) -> None:
        self.menus.save_preferences()
        self.folds.save()
        self.files.save_preferences()
        implot.destroy_context()
        self.reload.close()
        self.session.close()

    # A frame ----------------------------------------------------------------------------------------

    def _replace_session(self) -> None:
        """Open files that were dropped or that wait; show a newly opened scene once it is ready."""
        if dropped := self.reload.dropped:
            files, dropped[:] = list(dropped), []
            drop(self, files)
        if self.reload.waiting and self.session.opening is None:
            files, self.reload.waiting = self.reload.waiting, []
            open_files(self, files)
        now, new = self.session, self.reload.tick(self.session)
        if new is not None:
            same = self.reload.same and now.ready
            brighter = same and changes_exposure(*(flux_of(s.model.emitters, s.settings) for s in (now, new)))
            try:
                self._adopt(new)
            except Exception as problem:
                self.reload.problem = f"{problem}"
                new.close(0.0)
                raise
            self._ready = True
            self._news = self.reload.news(new) or self._news
            if brighter and set(new.model.emitters.lamps.names) - set(now.model.emitters.lamps.names):
                self._do("meter")  # a new lamp is to be seen, a changed one to be compared
            elif brighter:
                self.log(f"{self._news}; {EXPOSURE_STAYS}", WARNING)
                self._news = ""
        if self._news and not (self.holds_field or self.reload.is_editing):  # once per held slider
            self.log(self._news)
            self._news = ""

    def _adopt(self, new: Session) -> None:
        """Show a ready session with its own geometry, camera and exposure."""
        self.painter.adopt(new)
        old, self.session = self.session, new
        self.viewport.adopt(new, keep_view=old is not new and self.reload.same)
        if old is not new:
            old.close(0.0)
            window.rename(new.settings.document or new.settings.scene)
        if self.painter.software:
            new.light.grace = 0.2  # s per frame for a move if drawing takes the same cores
        if new.settings.exposure is None:
            default = new.scene.defaults.exposure
            exposure = new.metered(self.viewport.view.camera) if default is None else default
            new.want(replace(new.settings, exposure=exposure))
        new.start_exposure = new.settings.exposure
        self.files.adopt(new, same=old is not new and self.reload.same)

    def _guard(self, stage: str, work: Callable[[], None]) -> None:
        """Run a stage of the frame; log its exception, the window goes on."""
        try:
            work()
        except Exception as problem:
            report = self.log.error if is_user_error(problem) else self.log.failure
            report(stage, problem)

    def _draw_part(self, stage: str, work: Callable[[], None]) -> None:
        """Draw a part of the window, as _guard(); after an exception, end its open groups."""
        begun, failed = imgui.internal.ErrorRecoveryState(), True
        imgui.internal.error_recovery_store_state(begun)

        def draw() -> None:
            nonlocal failed
            work()
            failed = False

        self._guard(stage, draw)
        if failed:
            imgui.get_io().config_error_recovery_enable_assert = False
            imgui.internal.error_recovery_try_to_recover_state(begun)

    # Actions ----------------------------------------------------------------------------------------

    def _do(self, action: str | tuple) -> None:
        """Run an action by its name, or by its name and values."""
        name, *values = (action,) if isinstance(action, str) else action
        self._guard(name, lambda: act(self, name, *values))


def is_user_error(problem: BaseException | None) -> bool:
    """Return whether a problem lies in the user's input; any other is a defect, shown in the window."""
    return isinstance(problem, (SceneError, UsageError, OSError))


def run(
    settings: Settings,
    *,
    frames: int | None = None,
    screenshot: str | Path | None = None,
    open_with: Callable | None = None,
) -> int:
    """Run the window until it closes. Return 0, or 1 if a defect of the program kept the scene from opening.

    frames: closes so many frames after the first picture; screenshot: saves the whole window, once all photons are
    traced if `frames` is None, then closes; open_with: opens scenes in place of Opening.
    Raises SceneError, UsageError or OSError for a scene that cannot be used, after closing the window. The command
    line prints the sentence and exits with its code.
    """
    viewer = Viewer(settings, open_with)
    viewer.frames_left = frames
    viewer.exit_when_refined = screenshot is not None and frames is None
    window.prepare()
    interval = sys.getswitchinterval()
    sys.setswitchinterval(0.001)  # interpreter switch interval; Python's default of 5 ms stutters
    try:
        with interruptible(viewer):
            immapp.run(viewer.params)
    finally:
        sys.setswitchinterval(interval)
    if screenshot is not None:
        write_png(Path(screenshot), hello_imgui.final_app_window_screenshot(), {"software": "gi-viewer"})
    return finish(viewer)


@contextlib.contextmanager
def interruptible(viewer: Viewer):
    """Close the window on Ctrl+C in the terminal, because no exception may cross the GUI's code."""

    def close(*_) -> None:
        viewer.leave(ask=False)

    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set a signal handler
        return
    before = signal.signal(signal.SIGINT, close)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def finish(viewer: Viewer) -> int:
    """Return the exit code of a closed viewer, or raise the user's error that closed it."""
    problem = viewer.session.problem
    if is_user_error(problem):
        raise problem
    return 0 if problem is None else 1
