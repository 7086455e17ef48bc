"""One thread for the solver's work, so that the window never waits for a long piece of it.

Most pieces take some milliseconds, but an index of a large scene, or a move among a million photons,
takes longer. One job runs at a time, and nobody else touches the solver while it does.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import NamedTuple

PATIENCE = 0.25  # s: how long closing waits for a step under way


class Task(NamedTuple):
    """A short piece of work for the background thread."""

    name: str  # of the job that it is a piece of; the log uses it when the piece fails
    run: Callable[[], object]


class Job:
    """A call under way in the background thread."""

    def __init__(self, future: Future) -> None:
        self._future: Future | None = future

    def wait(self, seconds: float) -> bool:
        """Wait so long at most; tell whether it is done. The interpreter lock is free meanwhile."""
        return self._future.done() or bool(wait([self._future], timeout=max(seconds, 0)).done)

    def result(self):
        """Return what the call returned, or raise what it raised; once."""
        future, self._future = self._future, None
        try:
            return future.result()
        finally:
            del future  # else what is raised would hold it, and it that


class Worker:
    """A thread that does not outlive the program: the standard library's pools wait for what they are doing.

    It begins with the first call: a scene that is never shown, given up or refused while it is opened, has none.
    """

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[tuple[Future, Callable] | None] = queue.SimpleQueue()
        self._started = False

    def submit(self, call: Callable) -> Job:
        if not self._started:
            self._started = True
            threading.Thread(target=_work, args=(self._calls,), name="solver", daemon=True).start()
        future: Future = Future()
        self._calls.put((future, call))
        return Job(future)

    def close(self) -> None:
        """End the thread after what it is doing."""
        self._calls.put(None)


def _work(calls: queue.SimpleQueue) -> None:
    while (item := calls.get()) is not None:
        future, call = item
        try:
            future.set_result(call())
        except BaseException as problem:
            future.set_exception(problem)
        item = future = call = None  # what the call held is free while the thread waits


def without_frames(problem: BaseException) -> BaseException:
    """Return an exception that can be kept: its traceback would hold what was being done, a whole scene, in a ring."""
    link: BaseException | None = problem
    while link is not None:
        link.__traceback__, link = None, link.__cause__ or link.__context__
    return problem
