"""Rows of measurements: measured so that one failure costs no other, written as CSV; conditions of the machine."""

from __future__ import annotations

import csv
import io
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

from app.cli.writable import write_whole
from app.settings import UsageError
from gi_core.scene import SceneError

Row = TypeVar("Row")


class Failure(NamedTuple):
    """A row that could not be measured."""

    name: str
    reason: str

    def __str__(self) -> str:
        return f"{self.name} could not be measured: {self.reason}"


def attempted(name: str, measure: Callable[[], Row]) -> Row | Failure:
    """Return a measured row, or why it failed: no error of one row, whichever it is, may cost the others."""
    try:
        return measure()
    except Exception as error:
        is_sentence = isinstance(error, SceneError | UsageError | OSError)
        return Failure(name, " ".join(str(error).split()) if is_sentence and str(error) else repr(error))


def write_rows(file: Path, rows: Sequence[dict]) -> None:
    """Write rows as CSV, floats to seven digits. Raises OSError."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(k for row in rows for k in row)))
    writer.writeheader()
    writer.writerows({k: f"{v:.7g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    write_whole(file, text.getvalue())


def peak_rss_mb() -> float | None:
    """Return the peak resident memory of this process [MB], None where it is unknown (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def load() -> float | None:
    """Return the mean number of threads that ran or waited in the last minute, None where unknown (Windows)."""
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):
        return None


def processor() -> str:
    """Return the name of the processor, else its architecture."""
    import platform

    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
