"""`gi-viewer bench SCENE --sweep --out DIR`: many rows into sweep.json and sweep.md.

Both files are whole at any time. A sweep that was stopped resumes with the rows that are missing or failed.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from app.cli.progress import Bar
from app.cli.version import commit
from app.cli.writable import write_whole
from app.measure.bench.row import Failed, run_apart
from app.measure.bench.rows import rows
from app.measure.bench.tables import markdown
from app.measure.machine import processor
from app.settings import Settings, UsageError

FORMAT = "gi-viewer sweep 3"


def sweep(settings: Settings, frames: int, out: Path, run: Callable = run_apart) -> dict:
    """Measure the missing rows of `out`/sweep.json, write it and sweep.md; return the contents of sweep.json.

    `run(spec) -> numbers` measures a row, or raises Failed. Raises UsageError for a folder that holds a sweep of
    another scene, commit or processor, OSError for one that cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / "sweep.json"
    started = {"format": FORMAT, "scene": settings.scene, "commit": commit(), "processor": processor()}
    done: dict = _resumed(file, started) if file.exists() else {**started, "failed": {}, "rows": {}}
    wanted = rows(settings, frames)
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
            write_whole(file, json.dumps(done, indent=1) + "\n")
            write_whole(out / "sweep.md", markdown(done))
    write_whole(out / "sweep.md", markdown(done))
    return done


def _resumed(file: Path, started: dict) -> dict:
    """Return the contents of a sweep of the same scene, commit and processor. Raises UsageError for others."""
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
