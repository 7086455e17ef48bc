"""Light gathered within a time: the window's own work at rest, without a window."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from app import settings
from app.cli.progress import time_left
from app.rest.scheduler import RestWork

if TYPE_CHECKING:
    from gi_core.solver import Solver

NO_ERRORS = settings.Settings(measure_errors=False)


def gather(
    solver: Solver,
    seconds: float | None,
    bar: Callable[[str, float], None],
    at_poses: bool = True,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Gather light for at most `seconds`, and one task more; show the time left, save static light as the window does.

    seconds: None for the default, `app.settings.SECONDS`; at_poses: also with mobiles in place; without it only the
    static part's light, for pictures of other poses. Light is saved after an exception too. Nothing is gathered without
    seconds, and by a solver of light "photons".
    """
    seconds = settings.SECONDS if seconds is None else seconds
    work, began = RestWork(solver, clock), clock()
    try:
        while (left := seconds - (clock() - began)) > 0:
            task = work.next_task(NO_ERRORS) if at_poses else work.next_static()
            if task is None:
                break
            bar(f"gathering light{time_left(left)}", 1 - left / seconds)
            task.run()
    finally:
        work.gathering.keep()
