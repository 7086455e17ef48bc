"""Splitting work over Python threads: kernels and embree release the GIL.

numba's own parallel loops take milliseconds to wake for tiny jobs, and their `workqueue` layer aborts when two threads
enter. No sum of floats crosses a split: sums over threads are integers, so results do not depend on the split.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache


def available_cores() -> int:
    """Return the number of cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _State(threading.local):
    """State of a thread."""

    busy = False  # it works on a part
    beside: Future | None = None  # work that overlaps with its own


_state = _State()

CHEAP = 2048  # items per thread at least: starting a thread takes 30 us, and some have sums of their own ...
COSTLY = 256  # ... and of items that trace rays or visit neighbours


@cache
def _pool(workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, thread_name_prefix="gi")


def split(n: int, parts: int, grain: int) -> list[tuple[int, int]]:
    """Return at most `parts` ranges (start, stop) that cover range(n), of at least `grain` items each."""
    parts = max(1, min(parts, n // max(grain, 1)))
    bounds = [n * k // parts for k in range(parts + 1)]
    return list(zip(bounds[:-1], bounds[1:], strict=True))


def usable(threads: int) -> int:
    """Return how many of so many threads run_ranges() uses here; later in the same part or context, as many or more."""
    if _state.busy:
        return 1
    return threads - (_state.beside is not None and not _state.beside.done())


def run_ranges(work: Callable[[int, int, int], object], n: int, threads: int, grain: int) -> list:
    """Call work(part, start, stop) on ranges of at least `grain` items of range(n), in parallel; return the results.

    Results are in the order of the ranges. Nested calls run in the thread of their part.
    """
    ranges = split(n, usable(threads), grain)
    if len(ranges) == 1:
        return [work(0, *ranges[0])]
    pool = _pool(threads)
    later = [pool.submit(_run_part, work, k, *r) for k, r in enumerate(ranges[1:], 1)]
    try:
        return [_run_part(work, 0, *ranges[0]), *(f.result() for f in later)]
    except BaseException:
        wait(later)  # no part may go on writing after the exception has left
        raise


def _run_part(work: Callable[[int, int, int], object], k: int, start: int, stop: int):
    _state.busy = True
    try:
        return work(k, start, stop)
    finally:
        _state.busy = False


@contextmanager
def overlapped(calls: Sequence[Callable[[], object]], threads: int) -> Iterator[None]:
    """Make calls in turn in another thread while the context runs, which meanwhile uses one of `threads` fewer.

    The context ends with the call that is in progress; calls after it are left out. A single thread makes none.
    """
    if not calls or usable(threads) == 1:
        yield
        return
    ended = threading.Event()

    def work(*_):
        for call in calls:
            if ended.is_set():
                return
            call()

    _state.beside = _pool(threads).submit(_run_part, work, 0, 0, 0)
    try:
        yield
    finally:
        ended.set()
        later, _state.beside = _state.beside, None
        if not later.cancel():
            later.result()
