"""Files of the open scene, watched for changes on disk."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

PERIOD = 1.0  # s between two looks at the disk

State = dict[str, tuple[int, int]]  # path -> time of the last change [ns], size


class Watch:
    """Call `changed` often: it looks at the disk once per PERIOD."""

    def __init__(self) -> None:
        self._files: list[str] = []
        self._known: State = {}
        self._last: State = {}  # at the last look
        self._due = 0.0

    def follow(self, files: Iterable[str]) -> None:
        """Watch files that exist, from their present state on."""
        self._known = _state(files)
        self._files = list(self._known)
        self._last = self._known

    def changed(self, now: float) -> bool:
        """Return whether files have changed and rest since the last look: a program may be writing them. now: [s]."""
        if now < self._due:
            return False
        self._due = now + PERIOD
        before, self._last = self._last, _state(self._files)
        if self._last != before or self._last == self._known or len(self._last) < len(self._files):
            return False
        self._known = self._last
        return True


def _state(files: Iterable[str]) -> State:
    state = {}
    for name in files:
        try:
            stat = Path(name).stat()
        except OSError:
            continue  # replaced at this moment, or gone
        state[name] = (stat.st_mtime_ns, stat.st_size)
    return state
