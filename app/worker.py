"""Threads behind the window, first of all the solver's: the window never waits for a long task.

Most calls last milliseconds; the index of a large scene or a move among a million photons lasts longer. They run one
at a time, and no other thread uses the solver meanwhile.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import NamedTuple

PATIENCE = 0.25  # s that closing waits for a running step


class Task(NamedTuple):
    """A short piece of work for the solver's thread."""

    name: str  # of the task's job; the log names it after a failure
    run: Callable[[], object]


class Call:
    """A submitted call and its future result."""

    def __init__(self, future: Future) -> None:
        self._future: Future | None = future

    def wait(self, seconds: float) -> bool:
        """Wait at most `seconds`; return whether the call has ended. Waiting releases the interpreter lock."""
        return self._future.done() or bool(wait([self._future], timeout=max(seconds, 0)).done)

    def result(self):
        """Return the call's result or raise its exception; valid once."""
        future, self._future = self._future, None
        try:
            return future.result()
        finally:
            del future  # else exception and future refer to each other


class Worker:
    """A daemon thread that ends with the program; the standard library's pools would wait for a running call.

    It starts with the first call, so a scene that never opens starts no thread.
    """

    def __init__(self, name: str = "solver") -> None:
        self._name = name
        self._calls: queue.SimpleQueue[tuple[Future, Callable] | None] = queue.SimpleQueue()
        self._started = False

    def submit(self, call: Callable) -> Call:
        if not self._started:
            self._started = True
            threading.Thread(target=_work, args=(self._calls,), name=self._name, daemon=True).start()
        future: Future = Future()
        self._calls.put((future, call))
        return Call(future)

    def close(self) -> None:
        """End the thread after the submitted calls."""
        self._calls.put(None)


def _work(calls: queue.SimpleQueue) -> None:
    while (item := calls.get()) is not None:
        future, call = item
        try:
            future.set_result(call())
        except BaseException as problem:
            future.set_exception(problem)
        item = future = call = None  # frees the call's objects while the thread waits


def without_frames(problem: BaseException) -> BaseException:
    """Return the exception without tracebacks, which would keep a whole scene alive in a reference cycle."""
    link: BaseException | None = problem
    while link is not None:
        link.__traceback__, link = None, link.__cause__ or link.__context__
    return problem
