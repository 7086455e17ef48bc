"""The log of the window: messages for the status line."""

from __future__ import annotations

import time
import traceback
from collections import deque
from typing import NamedTuple

from gi_core.base.memory import sentence
from gi_core.scene.errors import one_line

INFO, WARNING, ERROR = "info", "warning", "error"


class LogEntry(NamedTuple):
    level: str
    text: str  # one line
    when: float  # monotonic seconds


class Log:
    def __init__(self) -> None:
        self.entries: deque[LogEntry] = deque(maxlen=200)

    def __call__(self, text: str, level: str = INFO) -> None:
        entry = LogEntry(level, one_line(text), time.monotonic())
        if self.last is not None and self.last[:2] == entry[:2]:  # an error in every frame is one entry
            self.entries.pop()
        self.entries.append(entry)

    def error(self, doing: str, problem: BaseException) -> None:
        """Log an error as one line, without a traceback."""
        reason = sentence(problem) if isinstance(problem, MemoryError) else str(problem) or type(problem).__name__
        self(f"{doing}: {reason}", ERROR)

    def failure(self, doing: str, problem: BaseException) -> None:
        """Log an error of the program: one line here, its traceback on stderr; full memory is not such an error.

        The traceback of an error in every frame is printed once.
        """
        before = self.last
        self.error(doing, problem)
        repeated = before is not None and before[:2] == self.entries[-1][:2]
        if not isinstance(problem, MemoryError) and not repeated:
            traceback.print_exception(problem)

    @property
    def last(self) -> LogEntry | None:
        return self.entries[-1] if self.entries else None
