"""Few malloc arenas: glibc keeps an arena per thread, up to a limit, and returns little free space.

Two arenas hold less free space and do not slow frames. Other C libraries have no such setting.
"""

from __future__ import annotations

import ctypes

ARENAS = 2  # so that the window does not wait for the solver's malloc
M_ARENA_MAX = -8  # mallopt's name for their number


def limit_arenas() -> None:
    """Limit malloc to few arenas for any number of threads; call it before threads start."""
    try:
        library = ctypes.CDLL(None)
    except (OSError, TypeError):  # Windows accepts no None
        return
    if hasattr(library, "gnu_get_libc_version"):
        library.mallopt(M_ARENA_MAX, ARENAS)
