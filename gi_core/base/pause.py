"""Pauses of long computations.

A long computation is a plain function that calls pause() every few milliseconds. Its caller decides what a pause does:
nothing, break off (`breaking_off`), or hand control back as a coroutine does (`steps`). It costs 0.3 us, or 5 us.
`Pace` fits steps into the time between pauses: an interactive program waits for the step under way.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from greenlet import getcurrent, greenlet

PIECE_ROWS = 2048  # 5 to 10 ms of rays around receivers


class Progress(NamedTuple):
    """State of `Solver.solve_steps` and `Solver.gather_steps`."""

    stage: str
    fraction: float  # 0 .. 1 of the photons wanted
    picture: bool  # irradiance was refreshed


class Interrupted(Exception):
    """A frame was broken off, because its result is no longer wanted."""


class _Rules(threading.local):
    """What pauses do in a thread."""

    stop: Callable[[], bool] | None = None
    undivided = False


class _Steps(greenlet):
    """A computation whose pauses hand control back."""


_rules = _Rules()


def pause(progress: Progress | None = None) -> None:
    """Let the caller hand control back or raise Interrupted. progress: where it has changed."""
    if not _rules.undivided and isinstance(getcurrent(), _Steps):
        getcurrent().parent.switch(progress)  # a variable here would let the computation refer to itself
    elif _rules.stop is not None and _rules.stop():
        raise Interrupted


def pieces(n: int) -> Iterator[slice]:
    """Yield slices of at most PIECE_ROWS rows that cover range(n), with a pause after each."""
    for first in range(0, n, PIECE_ROWS):
        yield slice(first, min(first + PIECE_ROWS, n))
        pause()


def steps(run: Callable[[], object]) -> Generator[Progress, None, None]:
    """Iterate over the pauses of run(). A pause without progress repeats the last one, without a picture.

    A closed or dropped iterator raises GreenletExit at the pause, so contexts end. It belongs to the thread of its
    first step: dropped by another, it ends with the next step there; open when that thread ends, it keeps its memory.
    """
    work, progress = _Steps(run), Progress("", 0.0, False)
    try:
        while True:
            work.parent = getcurrent()
            news = work.switch()
            if work.dead:
                return
            progress = news or progress._replace(picture=False)
            yield progress
    finally:
        try:
            work.parent = getcurrent()
        except ValueError:  # of another thread
            pass
        else:
            work.throw()  # nothing where it has ended


@contextmanager
def breaking_off(stop: Callable[[], bool] | None) -> Iterator[None]:
    """Let pauses of this thread raise Interrupted where stop() returns True, unless they hand control back."""
    before, _rules.stop = _rules.stop, stop
    try:
        yield
    finally:
        _rules.stop = before


@contextmanager
def undivided() -> Iterator[None]:
    """Let no pause hand control back, as other work would meet a state that is being changed; a decorator too."""
    before, _rules.undivided = _rules.undivided, True
    try:
        yield
    finally:
        _rules.undivided = before


STEP = 0.01  # s of a step at rest: a drag waits for one at most


class Pace:
    """Items per step."""

    def __init__(self, first: float, least: int, most: int):
        """first: seconds per item, before measurements; least, most: items per step."""
        self._each, self._least, self._most = first, least, most

    def fit(self, seconds: float) -> int:
        """Return the items that take so long."""
        return int(min(max(seconds / self._each, self._least), self._most))

    def share_of(self, left: int, seconds: float) -> int:
        """Return the items of the next step out of `left`; no step is short."""
        return -(-left // math.ceil(left / self.fit(seconds)))

    def took(self, count: float, seconds: float) -> None:
        """Record the time of a step. Faster steps count in full; slower ones may have been disturbed."""
        self._each = min(seconds / count, 0.5 * (self._each + seconds / count))
