"""Progress on stderr for commands without a window, silent unless stderr is a terminal; warnings about the light."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from app.settings import Settings
from gi_core.scene import Scene

if TYPE_CHECKING:
    from gi_core.solver import Solver

REDRAW_SECONDS = 0.1


class Bar:
    """`bar("tracing", 0.3)` shows a stage and its fraction; `bar.close()` clears the line."""

    def __init__(self, stream=None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._shown = bool(getattr(self._stream, "isatty", lambda: False)())
        self._drawn = 0  # characters on the line
        self._last = -REDRAW_SECONDS
        self._stage = ""

    def __call__(self, stage: str, fraction: float) -> None:
        bar_characters = 28
        now = time.monotonic()
        if not self._shown or (now - self._last < REDRAW_SECONDS and stage == self._stage):
            return
        self._last, self._stage = now, stage
        done = int(bar_characters * min(max(fraction, 0.0), 1.0))
        text = f"{stage:<12.40} [{'=' * done}{' ' * (bar_characters - done)}] {100 * fraction:3.0f} %"
        print(text.ljust(self._drawn), end="\r", file=self._stream, flush=True)
        self._drawn = len(text)

    def begin(self, line: str) -> None:
        """Print a line about work of minutes where no bar is shown."""
        if not self._shown:
            self.say(line)

    def say(self, line: str) -> None:
        """Print a permanent line, to a terminal or a file."""
        self.close()
        print(line, file=self._stream, flush=True)

    def close(self) -> None:
        if self._drawn:
            print(" " * self._drawn, end="\r", file=self._stream, flush=True)
            self._drawn = 0

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_) -> None:
        self.close()


def time_left(seconds: float | None) -> str:
    """Return ", 3 min left" to append to a stage; "" for an unknown time."""
    if seconds is None:
        return ""
    return f", {seconds:.0f} s left" if seconds < 90 else f", {seconds / 60:.0f} min left"


def compile_kernels(bar: Bar, rays: str | None = None, scene: Scene | None = None) -> None:
    """Compile kernels that this machine has not compiled yet, showing progress: about a minute, once.

    scene: its kinds of surfaces need more of them.
    """
    from gi_core.base.kernel_cache import problems
    from gi_core.instruments import compile_ahead

    kinds = [compile_ahead.DIFFUSE] if scene is None else [compile_ahead.DIFFUSE, compile_ahead.surfaces_of(scene)]
    for kind in dict.fromkeys(kinds):
        if not compile_ahead.is_warm(rays, kind):
            bar.begin("gi-viewer: compiling kernels, once per machine: about a minute")
            for name, fraction in compile_ahead.compile_kernels(rays, kind):
                bar(f"compiling {name}", fraction)
    for problem in problems:
        bar.say(f"gi-viewer: {problem}")


@contextmanager
def opened(settings: Settings, open_scene: Callable[[Settings], Scene]) -> Iterator[tuple[Bar, Scene]]:
    """Open a scene and compile kernels; yield the progress bar and the scene. Raises SceneError, UsageError."""
    with Bar() as bar:
        bar("loading", 0.0)
        scene = open_scene(settings)
        compile_kernels(bar, settings.rays, scene)
        yield bar, scene


def solve(solver: Solver, bar: Bar) -> None:
    """Trace all requested photons, showing progress; print the scene's notes before, warnings after."""
    for note in solver.scene.notes:
        bar.say(f"gi-viewer: {note}")
    for progress in solver.solve_steps(pictures=False):
        bar(progress.stage, progress.fraction)
    for text in warnings_of(solver).values():
        bar.say(f"gi-viewer: {text}")


def warnings_of(solver: Solver) -> dict[str, str]:
    """Return one sentence per kind of warning: "memory", "escapes", "behind"; empty without any."""
    from gi_core.files.completion import lit_by_stand_ins

    sentences, chosen = {}, solver.chosen
    if solver.frame.store.memory_full:
        wanted = f"{solver.frame.photons:,} of the {solver.photons:,} photons wanted"
        sentences["memory"] = f"memory holds no more than {wanted}"
    # Lights that opening added cannot be turned.
    if chosen.escaped_first > 0.8 and not lit_by_stand_ins(solver.scene):
        sentences["escapes"] = (
            f"{100 * chosen.escaped_first:.0f} % of the light leaves the scene at its first flight; close it, or turn "
            "its lights inwards: most photons are wasted and the picture is noisier than necessary"
        )
    if chosen.behind_first > 0.5:  # 0.5 of them, absorbed by backs of one-sided faces
        sentences["behind"] = (
            f"{100 * chosen.behind_first:.0f} % of the light first meets backs of one-sided faces, which are black; "
            "turn these faces over, or make their materials two-sided"
        )
    return sentences
