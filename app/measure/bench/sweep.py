"""`gi-viewer bench SCENE --sweep --out DIR`: many rows into sweep.json and sweep.md.

Both files are whole at any time: written aside, then put in place. A sweep that was stopped goes on with the rows
that are not there yet; rows that failed are tried again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

from app.cli.progress import Bar
from app.measure.bench.row import Failed, run_apart
from app.measure.bench.rows import rows
from app.measure.bench.tables import markdown
from app.measure.machine import commit, processor
from app.settings import Settings, UsageError

FORMAT = "gi-viewer sweep 1"


def sweep(settings: Settings, frames: int, out: Path, large: bool = False, run: Callable = run_apart) -> dict:
    """Measure what is missing in `out`/sweep.json, write it and sweep.md; return the former's contents.

    `run(spec) -> numbers` measures a row, or raises Failed. Raises UsageError for a folder that holds a sweep of
    something else, OSError for one that cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / "sweep.json"
    started = {"format": FORMAT, "scene": settings.scene, "commit": commit(), "processor": processor()}
    done = {**started, "failed": {}, "rows": {}}
    if file.exists():
        done = _continued(file, started)
    wanted = rows(settings, frames, large)
    with Bar() as bar:
        for k, row in enumerate(wanted):
            kept = done["rows"].get(row.key)
            if kept is not None and kept["asked"] == row.spec():
                continue
            bar(f"row {k + 1} of {len(wanted)}: {row.key}", k / len(wanted))
            done["failed"].pop(row.key, None)
            try:
                done["rows"][row.key] = {**run(row.spec()), "asked": row.spec()}
            except Failed as problem:
                done["failed"][row.key] = str(problem)
            _write(file, json.dumps(done, indent=1) + "\n")
            _write(out / "sweep.md", markdown(done))
    _write(out / "sweep.md", markdown(done))
    return done


def _continued(file: Path, started: dict) -> dict:
    """Return the sweep that was begun, if it is one of the same scene and program."""
    try:
        have = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:
        have = None
    if not isinstance(have, dict) or have.get("format") != FORMAT:
        raise UsageError(f"{file} is not a sweep that this program wrote: give another folder with --out")
    for name in ("scene", "commit", "processor"):
        if have.get(name) != started[name]:
            raise UsageError(
                f"{file} was measured with {name} {have.get(name)}, now it is {started[name]}: "
                "give another folder with --out, or delete it"
            )
    return have


def _write(file: Path, text: str) -> None:
    """Write aside, then replace: whoever reads or interrupts finds a whole file."""
    aside = file.with_name(file.name + ".part")
    aside.write_text(text, encoding="utf-8")
    os.replace(aside, file)
