"""The solver's thread, and others behind the window, which never waits for a long task.

Most calls last milliseconds; the index of a large scene or a move among a million photons lasts longer. They run one
at a time, and no other thread uses the solver meanwhile.
"""

from __future__ import annotations

import atexit
import ctypes
import queue
import threading
import time
import weakref
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import NamedTuple

PATIENCE = 0.25  # s that closing waits for a running step
ARENAS = 2  # so that the window does not wait for the solver's malloc


class Task(NamedTuple):
    """A short piece of work for the solver's thread."""

    name: str  # of the task's job; the log names it after a failure
    run: Callable[[], bool]  # returns whether the light on show has changed


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

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[tuple[Future, Callable] | None] = queue.SimpleQueue()
        self._started = self._closed = False

    def submit(self, call: Callable) -> Call:
        """Run a call after those submitted before; after close() it fails at once."""
        future: Future = Future()
        if self._closed:
            future.set_exception(RuntimeError("the solver's thread has ended"))
            return Call(future)
        if not self._started:
            self._started = True
            daemon("solver", _work, self._calls).start()
            _queues.add(self._calls)
        self._calls.put((future, call))
        return Call(future)

    def close(self) -> None:
        """End the thread after the submitted calls."""
        self._closed = True
        self._calls.put(None)


def _work(calls: queue.SimpleQueue) -> None:
    while (item := calls.get()) is not None:
        future, call = item
        try:
            future.set_result(call())
        except BaseException as problem:
            future.set_exception(problem)
        item = future = call = None  # frees the call's objects while the thread waits


def daemon(name: str, target: Callable, *arguments) -> threading.Thread:
    """Return a daemon thread, not started, that the end of the program awaits for 5 s.

    Before version 3.14, Python's end unwinds a daemon thread where it takes the interpreter's lock. Within np.unique,
    which is C++, the process then aborts: "terminate called without an active exception", in 4 of 8 runs.
    """
    thread = threading.Thread(target=target, args=arguments, name=name, daemon=True)
    _threads.add(thread)
    return thread


_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()
_queues: weakref.WeakSet[queue.SimpleQueue] = weakref.WeakSet()  # of Workers


@atexit.register
def _await_threads() -> None:
    for calls in list(_queues):
        calls.put(None)
    end = time.monotonic() + 5.0
    for thread in list(_threads):
        if thread.is_alive():
            thread.join(max(end - time.monotonic(), 0))


def without_frames(problem: BaseException) -> BaseException:
    """Return the exception without tracebacks, which would keep a whole scene alive in a reference cycle."""
    link: BaseException | None = problem
    while link is not None:
        link.__traceback__, link = None, link.__cause__ or link.__context__
    return problem


def limit_arenas() -> None:
    """Limit malloc to few arenas for any number of threads; call it before threads start.

    glibc keeps an arena per thread, up to a limit, and returns little free space. Two arenas hold less free space and
    do not slow frames. Other C libraries have no such setting.
    """
    try:
        library = ctypes.CDLL(None)
    except (OSError, TypeError):  # Windows accepts no None
        return
    if hasattr(library, "gnu_get_libc_version"):
        library.mallopt(-8, ARENAS)  # -8: mallopt's M_ARENA_MAX
