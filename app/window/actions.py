"""Actions of the window, one table: name, function, keys, help text. The panel's buttons use the same names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from imgui_bundle import imgui

from app.draw.renderer import Renderer
from app.session.log import Log
from app.session.reload import Reload
from app.session.session import Session
from app.window import screenshot
from app.window.viewport import Viewport

K = imgui.Key
ESTIMATOR_KEYS = (K._1, K._2, K._3, K._4, K._5, K._6, K._7, K._8, K._9)


class Window(Protocol):
    """The window's parts that actions use."""

    params: Any  # of hello_imgui
    help_open: bool
    log: Log
    session: Session
    reload: Reload
    viewport: Viewport
    renderer: Renderer | None
    estimators: dict[str, str]


class Action(NamedTuple):
    """A function of the window and the keys that call it."""

    run: Callable[[Window], None]
    chords: tuple[int, ...] = ()  # any of them
    keys: str = ""  # as the help shows them; "": not in the help
    help: str = ""
    needs_scene: bool = True


def act(window: Window, name: str) -> None:
    """Run an action; without a scene, only one that needs none."""
    action = ACTIONS[name]
    if window.session.ready or not action.needs_scene:
        action.run(window)


def _quit(window: Window) -> None:
    window.params.app_shall_exit = True


def _toggle_help(window: Window) -> None:
    window.help_open = not window.help_open


def _cancel(window: Window) -> None:
    if not window.viewport.cancel_drag():
        window.help_open = False


def _toggle_panel(window: Window) -> None:
    panel = window.params.docking_params.dockable_window_of_name("Panel")
    panel.is_visible = not panel.is_visible


def _reset_poses(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.reset_poses()


def _reset_all(window: Window) -> None:
    _reset_poses(window)
    window.viewport.go_home()


def _undo(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.undo()


def _redo(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.redo()


def _toggle_reference(window: Window) -> None:
    settings = window.session.settings
    window.session.want(replace(settings, reference=not settings.reference))


def _meter(window: Window) -> None:
    exposure = window.session.metered(window.viewport.camera)
    window.session.want(replace(window.session.settings, exposure=exposure))
    window.log(f"metered: {exposure:+.1f} EV")


def _save_picture(window: Window) -> None:
    viewport, renderer = window.viewport, window.renderer
    metadata = viewport.picture.metadata(window.session.light.snapshot)
    look, path = viewport.look(outlined=False), screenshot.next_free(Path.cwd())
    screenshot.save(renderer, look, viewport.legend, metadata, path)
    window.log(f"saved {path}")
    viewport.redraw()


def _choose_estimator(k: int, window: Window) -> None:
    if k < len(window.estimators):
        window.session.choose_estimator(list(window.estimators)[k])


ACTIONS = {
    "play": Action(lambda w: w.session.toggle_play(), (K.space,), "Space", "play or pause the motion"),
    "reset all": Action(_reset_all, (K.r,), "R", "reset mobiles and view"),
    "reset poses": Action(_reset_poses),
    "reset view": Action(lambda w: w.viewport.go_home(), (K.home,), "Home", "reset the view"),
    "cancel": Action(_cancel, (K.escape,), "Esc", "cancel the drag", needs_scene=False),
    "undo": Action(_undo, (K.mod_ctrl | K.z,), "Ctrl+Z", "undo the last move"),
    "redo": Action(_redo, (K.mod_ctrl | K.mod_shift | K.z, K.mod_ctrl | K.y), "Ctrl+Shift+Z, Ctrl+Y", "redo it"),
    "reference": Action(_toggle_reference, (K._0,), "0", "switch between estimate and reference"),
    "meter": Action(_meter, (K.a,), "A", "meter the exposure from the view"),
    "reload": Action(lambda w: w.reload.again(w.session), (K.f5,), "F5", "reload the scene's files"),
    "clear chart": Action(lambda w: w.session.points.clear()),
    "toggle panel": Action(_toggle_panel, (K.tab,), "Tab", "hide or show the panel", needs_scene=False),
    "save picture": Action(_save_picture, (K.p, K.f12), "P, F12", "save picture and parameters as PNG here"),
    "help": Action(_toggle_help, (K.h,), "H", "hide or show this help", needs_scene=False),
    "quit": Action(_quit, (K.mod_ctrl | K.q,), "Ctrl+Q", "quit", needs_scene=False),
    **{f"estimator {k}": Action(partial(_choose_estimator, k), (key,)) for k, key in enumerate(ESTIMATOR_KEYS)},
}
