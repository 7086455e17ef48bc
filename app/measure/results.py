"""Rows of measurements: measured so that one failure costs no other, kept on disk; conditions of the machine."""

from __future__ import annotations

import csv
import io
import os
import sys
from collections.abc import Callable
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


FILE = "results.csv"
KEY = ("scene", "commit", "processor", "seed", "frames", "asked_points", "lamps")  # conditions of a row


class Results:
    """The rows of one folder. Rows of other conditions stay in the file and are not used."""

    def __init__(self, folder: Path, under: dict[str, object], fields: tuple[str, ...], numbers=()) -> None:
        """`under`: the conditions, by KEY; `fields`: columns of a setting; `numbers`: columns of numbers.

        Raises OSError, UsageError for a damaged file.
        """
        self.file, self.under, self._fields = folder / FILE, under, fields
        self._under = {k: _text(v) for k, v in under.items()}
        self.every: list[dict] = []
        if self.file.exists():
            self.every = self._read(numbers)

    def _read(self, numbers: tuple[str, ...]) -> list[dict]:
        try:
            with open(self.file, newline="", encoding="utf-8") as file:
                rows = list(csv.DictReader(file, restkey=""))
        except (ValueError, csv.Error):  # no UTF-8, a zero byte
            rows = [{"": ""}]
        for line, row in enumerate(rows, 2):
            bad = next((k for k, v in row.items() if not k or v is None), None)
            if bad is None and self._is_own(row):
                bad = next((k for k in self._fields if k not in row), None)
                bad = bad or next((k for k in numbers if not isinstance(_value(row.get(k, "")), int | float)), None)
            if bad is not None:
                what = f'the column "{bad}"' if bad else "its cells"
                rule = "delete the line, or name another folder with --out"
                raise UsageError(f"{self.file} is damaged in line {line}, in {what}: {rule}")
        return rows

    def _is_own(self, row: dict) -> bool:
        """Return whether a row has these conditions."""
        return all(row.get(k, "") == v for k, v in self._under.items())

    @property
    def rows(self) -> list[dict]:
        """Rows of these conditions, with typed values."""
        return [_typed(r) for r in self.every if self._is_own(r)]

    def has(self, setting: dict) -> bool:
        """Return whether a setting has been measured."""
        wanted = {k: _text(setting[k]) for k in self._fields}
        return any(all(_text(r[k]) == v for k, v in wanted.items()) for r in self.rows)

    def add(self, numbers: dict) -> None:
        """Write the file with one more row. Raises OSError."""
        every = [*self.every, self._under | {k: _text(v) for k, v in numbers.items()}]
        columns = dict.fromkeys(k for row in every for k in row)
        self.every = [{k: row.get(k, "") for k in columns} for row in every]
        text = io.StringIO()
        writer = csv.DictWriter(text, list(columns))
        writer.writeheader()
        writer.writerows(self.every)
        write_whole(self.file, text.getvalue())


def _text(value: object) -> str:
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def _typed(row: dict) -> dict:
    return {k: _value(v) for k, v in row.items()}


def _value(text: str):
    if text in ("True", "False"):
        return text == "True"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


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
