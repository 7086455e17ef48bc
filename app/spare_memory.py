"""Memory that malloc keeps for later, given back to the system where nobody waits for it.

glibc has an arena for each of a few threads, and each stays as large as it ever was: after a while of drags, settings
and scenes half of what is resident is free space. So there are ARENAS of them, and whole pages are given back now and
then, which takes some 10 ms; no frame is slower for either. Other C libraries do so by themselves, or cannot be
asked: there nothing is done.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import cache

ARENAS = 2  # the window need not wait for the solver's malloc
M_ARENA_MAX = -8  # mallopt's name for their number
PAUSE = 10.0  # s, at least, from one time to the next


class SpareMemory:
    """Says when it is time: light has come to rest, or all that is done at rest is done."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._given_at = -math.inf
        self._of: object = None  # version of the light then
        self._worked = False  # since then, at rest

    def next_work(self, version: object) -> Callable[[], None] | None:
        """Return what gives memory back if the light is another than at the last time; not too often."""
        if version == self._of or self._clock() - self._given_at < PAUSE:
            return None
        return self._begin(version)

    def last_work(self, version: object) -> Callable[[], None] | None:
        """Return what gives memory back, now that nothing else is left to do; None if nothing was done since."""
        return self._begin(version) if self._worked else None

    def worked(self) -> None:
        """Something has been handed out to be done at rest."""
        self._worked = True

    def _begin(self, version: object) -> Callable[[], None]:
        self._given_at, self._of, self._worked = self._clock(), version, False
        return give_back


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
