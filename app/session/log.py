"""What the window tells in its log line: the last message, and a few before it."""

from __future__ import annotations

import time
import traceback
from collections import deque
from typing import NamedTuple

KEPT = 200
INFO, WARNING, ERROR = "info", "warning", "error"


class Entry(NamedTuple):
    level: str
    text: str  # one line
    when: float  # monotonic seconds


class Log:
    def __init__(self) -> None:
        self.entries: deque[Entry] = deque(maxlen=KEPT)

    def __call__(self, text: str, level: str = INFO) -> None:
        line = " ".join(str(text).split())
        if self.entries and self.entries[-1][:2] == (level, line):  # an error that comes back every frame is one line
            self.entries[-1] = Entry(level, line, time.monotonic())
            return
        self.entries.append(Entry(level, line, time.monotonic()))

    def error(self, doing: str, problem: BaseException) -> None:
        """Tell what failed and why, without a traceback."""
        self(f"{doing}: {problem or type(problem).__name__}", ERROR)

    def failure(self, doing: str, problem: BaseException) -> None:
        """Log an error of the program: one line here, its traceback on stderr."""
        traceback.print_exception(problem)
        self.error(doing, problem)

    @property
    def last(self) -> Entry | None:
        return self.entries[-1] if self.entries else None
