"""results.csv: a row a setting, appended when it is measured, so that a run that was stopped goes on."""

from __future__ import annotations

import csv
import os
from pathlib import Path

FILE = "results.csv"
KEY = ("scene", "commit", "processor", "seed", "frames", "asked_points")  # what a row was measured under ...


class Results:
    """The rows of one folder. Rows measured under something else stay in the file and are not looked at."""

    def __init__(self, folder: Path, under: dict[str, object], fields: tuple[str, ...]) -> None:
        """`under` has KEY; `fields`: ... and what makes a setting. Raises OSError."""
        self.file, self.under, self._fields = folder / FILE, under, fields
        self._under = {k: _text(v) for k, v in under.items()}
        self.every = self._read()

    @property
    def rows(self) -> list[dict]:
        """The rows of this run, numbers as numbers."""
        return [_typed(r) for r in self.every if all(r.get(k) == v for k, v in self._under.items())]

    def has(self, setting: dict) -> bool:
        """Tell whether a setting has been measured."""
        wanted = {k: _text(setting[k]) for k in self._fields}
        return any(all(_text(r[k]) == v for k, v in wanted.items()) for r in self.rows)

    def add(self, numbers: dict) -> None:
        """Append a row, on disk before anything else happens. Raises OSError."""
        new = self._under | {k: _text(v) for k, v in numbers.items()}
        columns = list(self.every[0]) if self.every else list(new)
        if self.every and set(new) - set(columns):  # an older program knew less: all rows are written again
            columns += [k for k in new if k not in columns]
            self._write(columns, [*self.every, new])
        else:
            with open(self.file, "a", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, columns, restval="")
                if not self.every:
                    writer.writeheader()
                writer.writerow(new)
                file.flush()
                os.fsync(file.fileno())
        self.every.append({k: new.get(k, "") for k in columns})

    def _read(self) -> list[dict]:
        """Return the whole rows of the file; one that was cut off in the middle is taken out of it."""
        if not self.file.exists():
            return []
        with open(self.file, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
        cut_off = not self.file.read_bytes().endswith(b"\n")
        whole = [r for r in (rows[:-1] if cut_off else rows) if None not in r.values() and None not in r]
        if len(whole) < len(rows):
            self._write(list(reader.fieldnames or ()), whole)
        return whole

    def _write(self, columns: list[str], rows: list[dict]) -> None:
        aside = self.file.with_name(self.file.name + ".part")
        with open(aside, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, columns, restval="")
            writer.writeheader()
            writer.writerows(rows)
        os.replace(aside, self.file)


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
