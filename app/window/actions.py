"""What keys and buttons ask for, done: one name an action, see app/window/keys.py and the panel's sections."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from app.draw import metering
from app.draw.renderer import Renderer
from app.session.log import Log
from app.session.reload import Succession
from app.session.session import Session
from app.window import screenshot
from app.window.viewport import Viewport


class Window(Protocol):
    """The window's parts that actions use."""

    params: Any  # of hello_imgui
    help_open: bool
    log: Log
    session: Session
    succession: Succession
    viewport: Viewport
    renderer: Renderer | None
    estimators: dict[str, str]


def act(viewer: Window, action: str) -> None:
    """Do what is asked for; until there is a scene, only what needs none."""
    if action == "quit":
        viewer.params.app_shall_exit = True
    elif action == "help":
        viewer.help_open = not viewer.help_open
    elif action == "cancel":
        if not viewer.viewport.cancel_drag():
            viewer.help_open = False
    elif action == "toggle panel":
        panel = viewer.params.docking_params.dockable_window_of_name("Panel")
        panel.is_visible = not panel.is_visible
    elif viewer.session.ready:
        _act_on_scene(viewer, action)


def _act_on_scene(viewer: Window, action: str) -> None:
    session, viewport = viewer.session, viewer.viewport
    if action == "play":
        session.toggle_play()
    elif action in ("reset view", "reset all", "reset poses"):
        if action != "reset view":
            viewport.cancel_drag()
            session.reset_poses()
        if action != "reset poses":
            viewport.go_home()
    elif action in ("undo", "redo"):
        viewport.cancel_drag()
        getattr(session, action)()
    elif action == "load again":
        viewer.succession.again(session)
    elif action == "reference":
        session.want(replace(session.settings, reference=not session.settings.reference))
    elif action == "clear chart":
        session.appraisal.points.clear()
    elif action == "meter":
        exposure = metering.metered(session, viewport.camera)
        session.want(replace(session.settings, exposure=exposure))
        viewer.log(f"metered: {exposure:+.1f} EV")
    elif action == "screenshot":
        path = screenshot.next_free(Path.cwd())
        look = viewport.look(outlined=False)
        viewer.log(f"saved {screenshot.save(viewer.renderer, look, session, viewport.camera, path)}")
        viewport.redraw()
    elif action.startswith("estimator "):
        names = list(viewer.estimators)
        k = int(action.removeprefix("estimator "))
        if k < len(names):
            session.want(session.settings.of_estimator(names[k]))
