"""`gi-viewer bench SCENE --sweep --out DIR`: settings of a scene, into sweep.json and sweep.md.

Both files are whole at any time. A sweep that was stopped resumes with the rows that are missing or failed. A separate
process measures each row: it has its own peak memory, and its failure ends no other row.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from app.cli.progress import Bar
from app.cli.version import commit
from app.cli.writable import write_whole
from app.measure.results import Failure, attempted, processor
from app.measure.tables import Column, cells, digits, fixed, markdown_table, section, times
from app.settings import STEP_PER_FRAME, Settings, UsageError
from gi_core.estimators import DEFAULT, ESTIMATORS
from gi_core.instruments import child

COUNTS = (10_000, 100_000, 1_000_000)
SLOW = f"{COUNTS[-1]} photons, {DEFAULT}, slow drag"


class Row(NamedTuple):
    """One measurement."""

    key: str
    settings: Settings
    frames: int
    step: float  # of a mobile per frame / scene size

    def spec(self) -> dict:
        """Return the input of a row's process as JSON returns it: lists for tuples."""
        spec = {"settings": asdict(self.settings), "frames": self.frames, "step": self.step}
        return json.loads(json.dumps(spec))


def rows(settings: Settings, frames: int) -> list[Row]:
    """Return all rows, cheap ones first; artifact control is off except in its own rows."""
    base = replace(settings, control=False, neighbours=settings.neighbours or 50)
    out = []

    def add(key: str, photons: int, estimator=DEFAULT, control=False, step=STEP_PER_FRAME) -> None:
        wanted = replace(base, photons=photons, estimator=estimator, control=control)
        out.append(Row(key, wanted, frames, step))

    for photons in COUNTS:
        for estimator in ESTIMATORS:
            add(photons_key(photons, estimator), photons, estimator)
        add(photons_key(photons, DEFAULT, control=True), photons, control=True)
    add(SLOW, COUNTS[-1], step=0.003)  # of the scene size: 3 mm in a room of 1 m
    return out


def photons_key(photons: int, estimator: str, control: bool = False) -> str:
    return f"{photons} photons, {estimator}" + (", artifact control" if control else "")


def run_apart(spec: dict) -> dict:
    """Measure a row by a separate process, which ends with this one. Raises UsageError."""
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as errors:
        process = child.start(__name__, stdout=said, stderr=errors)
        with child.killed_at_end(process):
            process.stdin.write(json.dumps([os.getcwd(), spec]).encode() + b"\n")
            process.stdin.flush()
            process.wait()
        for file in (said, errors):
            file.seek(0)
        if process.returncode:
            lines = errors.read().strip().splitlines()
            raise UsageError(lines[-1] if lines else f"ended with code {process.returncode}")
        return json.load(said)


def main() -> int:
    """Measure the row of the first line of the input, print its numbers as JSON; return the exit code."""
    from gi_core.scene import SceneError

    folder, spec = json.loads(sys.stdin.readline())
    os.chdir(folder)  # child.start() begins elsewhere
    child.prepare()
    try:
        print(json.dumps(measure_row(spec)))
    except (SceneError, UsageError, OSError, MemoryError) as problem:
        print(" ".join(str(problem).split()) or type(problem).__name__, file=sys.stderr)
        return 1
    return 0


def measure_row(spec: dict) -> dict:
    """Open the scene, measure. Raises SceneError, UsageError."""
    from app.cli.progress import compile_kernels
    from app.measure.bench.measure import measure, warm_up
    from app.settings import open_moving_scene

    settings = Settings(**{name: _tuples(value) for name, value in spec["settings"].items()})
    scene = open_moving_scene(settings)
    with Bar() as bar:
        compile_kernels(bar, settings.rays)
        warm_up(scene, settings)
        return measure(scene, settings, spec["frames"], bar, spec["step"])


def _tuples(value):
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


FORMAT = "gi-viewer sweep 4"


def sweep(settings: Settings, frames: int, out: Path, run: Callable = run_apart) -> dict:
    """Measure the missing rows of `out`/sweep.json, write it and sweep.md; return the contents of sweep.json.

    `run(spec) -> numbers` measures a row. Raises UsageError for a folder that holds a sweep of another scene, commit or
    processor, OSError for one that cannot be written.
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
            made = attempted(row.key, partial(run, row.spec()))
            if isinstance(made, Failure):
                done["failed"][row.key] = made.reason
            else:
                done["rows"][row.key] = {**made, "asked": row.spec()}
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
    try:
        [row["asked"] for row in have["rows"].values()]
        markdown(have)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise UsageError(f"{file} is damaged: delete it, or give another folder with --out") from None
    return have


def markdown(sweep: dict) -> str:
    """Return the whole report."""
    have = sweep["rows"]
    parts = [_head(sweep), _rows(have), _stages(have)]
    parts.append(section("Failed", "\n".join(f"- {key}: {why}" for key, why in sweep["failed"].items())))
    return "\n\n".join(p for p in parts if p) + "\n"


def _head(sweep: dict) -> str:
    rows = sweep["rows"].values()
    threads = ", ".join(sorted({str(r["threads"]) for r in rows})) or "unknown"
    wrong = [key for key, r in sweep["rows"].items() if not r["bits_equal"]]
    bits = "Every row's last frame has the same bits as from scratch." if rows and not wrong else ""
    if wrong:
        bits = f"**The last frame differs from scratch in: {'; '.join(wrong)}.**"
    loads = [r["load"] for r in rows if r.get("load") is not None]
    busy = f" Up to {max(loads):.1f} threads ran or waited in the minute before a row." if loads else ""
    machine = f"{sweep['processor']}, {threads} threads, commit {sweep['commit'] or 'unknown'}. Times in ms, medians"
    return f"# Sweep of {sweep['scene']}\n\n{machine}; artifact control off unless stated.{busy} {bits}".rstrip()


def _cut(row: dict) -> float:
    return row["share_cut"] * row["photons"]


def _scan(row: dict) -> float:
    return sum(ms for name, ms in row["stages_ms"].items() if "scan" in name)


ROW = (
    Column("row", lambda r: r["key"]),
    Column("cut", _cut, "{:,.0f}".format),
    Column("frame", lambda r: r["frame_ms"]["median"], digits),
    Column("95 %", lambda r: r["frame_ms"]["p95"], digits),
    Column("CPU", lambda r: r["frame_ms"]["cpu"], digits),
    Column("scan", _scan, digits),
    Column(
        "all else, us per cut photon",
        lambda r: 1e3 * (r["frame_ms"]["median"] - _scan(r)) / _cut(r) if _cut(r) else None,
        fixed,
    ),
    Column("from scratch", lambda r: r["from_scratch_ms"], digits),
    Column("ratio", lambda r: r["from_scratch_ratio"], times),
    Column("first frame", lambda r: r["first_frame_ms"], digits),
    Column("peak MB", lambda r: r["peak_rss_mb"], "{:,.0f}".format),
)


def _rows(have: dict) -> str:
    """Return the table of all rows; frames should grow with the photons cut, plus a scan."""
    return section("Rows", markdown_table(*cells(ROW, [r | {"key": k} for k, r in have.items()])))


def _stages(have: dict) -> str:
    """Return the time of each stage at the largest number of photons measured."""
    counts = [n for n in COUNTS if photons_key(n, DEFAULT) in have]
    if not counts:
        return ""
    r = have[photons_key(max(counts), DEFAULT)]
    lines = [[name, digits(ms)] for name, ms in (r["stages_ms"] | {"whole frame": r["frame_ms"]["median"]}).items()]
    return section(
        f"Stages of a frame at {max(counts):,} photons ({DEFAULT})", markdown_table(["stage", "took"], lines)
    )


if __name__ == "__main__":
    sys.exit(main())
