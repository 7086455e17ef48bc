"""The window's parts that actions and the panel's sections use."""

from __future__ import annotations

from typing import Any, Protocol

from app.session.log import Log
from app.session.reload import Reload
from app.session.session import Session
from app.session.solver_thread import MovingMedian
from app.window.files import Files
from app.window.painter import Painter
from app.window.viewport import Viewport


class Window(Protocol):
    """A window with an open scene, or one that opens."""

    files: Files
    params: Any  # of hello_imgui
    help_open: bool
    log: Log
    session: Session
    reload: Reload
    viewport: Viewport
    painter: Painter
    frame_seconds: MovingMedian  # of frames with a new picture

    def open_scene(self, scene: str) -> None:
        """Open another scene."""

    def leave(self, ask: bool = True) -> None:
        """Close the window; `ask`: after the question about unsaved changes."""
