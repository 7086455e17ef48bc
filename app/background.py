"""One thread for the solver's work, so that the window never waits for a long piece of it.

Most pieces take some milliseconds, but an index of a large scene, or a move among a million photons,
takes longer. One job runs at a time, and nobody else touches the solver while it does.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait

PATIENCE = 2.0  # s: how long closing waits for a step under way


class Job:
    """A call under way in the background thread."""

    def __init__(self, future: Future) -> None:
        self._future = future

    def wait(self, seconds: float) -> bool:
        """Wait so long at most; tell whether it is done. The interpreter lock is free meanwhile."""
        return self._future.done() or bool(wait([self._future], timeout=max(seconds, 0)).done)

    def result(self):
        """Return what the call returned, or raise what it raised."""
        return self._future.result()


class Worker:
    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="solver")

    def submit(self, call: Callable) -> Job:
        return Job(self._pool.submit(call))

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)
