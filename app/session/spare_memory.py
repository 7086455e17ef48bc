"""Memory that malloc keeps for later, given back to the system where nobody waits for it.

glibc has an arena for each of a few threads, and each stays as large as it ever was: after a while of drags, settings
and scenes half of what is resident is free space. So there are ARENAS of them, and whole pages are given back now and
then, which takes some 10 ms; no frame is slower for either. Other C libraries do so by themselves, or cannot be
asked: there nothing is done.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

ARENAS = 2  # the window need not wait for the solver's malloc
M_ARENA_MAX = -8  # mallopt's name for their number
PAUSE = 5.0  # s, at least, from one time to the next
SOON = 0.5  # s after a scene has come: it leaves much behind, and by then the one before it has gone


class SpareMemory:
    """Says when it is time: something has been done since, and not too soon. One a scene on show."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._not_before = clock() + SOON
        self._used = False  # memory, since then

    def used(self) -> None:
        self._used = True

    def due(self) -> bool:
        """Tell whether to give memory back now; whoever asks does so if it is."""
        due = self._used and self._clock() >= self._not_before
        if due:
            self._not_before, self._used = self._clock() + PAUSE, False
        return due


def limit_arenas() -> None:
    """Have malloc use few arenas, whatever threads there will be; to be called before they are."""
    limit = _of_glibc("mallopt")
    if limit is not None:
        limit(M_ARENA_MAX, ARENAS)


def give_back() -> None:
    """Have malloc give whole free pages back to the system; other threads go on, but for their own malloc."""
    trim = _of_glibc("malloc_trim")
    if trim is not None:
        trim(0)


@cache
def _of_glibc(name: str) -> Callable | None:
    """Return a function of glibc, None where there is no such thing."""
    try:
        library = ctypes.CDLL(None)
        return getattr(library, name) if hasattr(library, "gnu_get_libc_version") else None
    except (OSError, TypeError):  # Windows takes no None
        return None
