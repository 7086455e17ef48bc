"""Running of the viewer: the window opens, runs until it is closed, and gives an exit code.

run(settings)                       runs until the window is closed
run(settings, frames=N)             closes N frames after the first picture
run(settings, screenshot=path)      saves the whole window once all photons are traced, then closes
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from imgui_bundle import hello_imgui, immapp

from app.settings import Settings
from app.window import window
from app.window.viewer import Viewer, is_user_error


def run(
    settings: Settings,
    *,
    frames: int | None = None,
    screenshot: str | Path | None = None,
    open_with: Callable | None = None,
) -> int:
    """Run the window until it closes. Return 0, or 1 if a defect of the program kept the scene from opening.

    open_with: opens scenes in place of Opening.
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
        _write_window(Path(screenshot))
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


def _write_window(path: Path) -> None:
    from app.draw.picture_files import write_png

    write_png(path, hello_imgui.final_app_window_screenshot(), {"software": "gi-viewer"})
