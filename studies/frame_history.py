"""Frame times of twelve fixed cases, to compare commits: one row per case and run, and a plot of all rows.

    python -m studies.frame_history --out bench/history.csv

It takes minutes. A process of its own measures each case, and its row is appended at once.
"""

from __future__ import annotations

import argparse
import csv
import platform
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from app.cli.progress import Bar
from app.cli.terminal import OK, USAGE, fail
from app.cli.writable import check_writable
from app.measure.bench.row import ROOT, Failed, run_apart
from app.measure.bench.rows import PHOTONS, Row
from app.measure.chart.figure import need_matplotlib
from app.settings import Settings, UsageError
from gi_core.estimators import ESTIMATORS

COLUMNS = ("date", "commit", "machine", "processor", "load", "case", "frame_ms", "cpu_ms", "first_frame_ms",
           "from_scratch_ms")  # fmt: skip
FRAMES = 60


def cases() -> list[Row]:
    """Return the tree by estimator and photons without control, and three rooms whose mobiles gather light."""
    out = []
    for estimator in ESTIMATORS:
        for photons in PHOTONS:
            settings = Settings("tree", photons=photons, estimator=estimator, control=False, light="photons")
            out.append(Row(f"tree, {estimator}, {photons:,} photons", settings, FRAMES, {}))
    for scene in ("cornell", "living_room", "gallery"):
        settings = Settings(scene, photons=16_384, light="best")
        out.append(Row(f"{scene}, best light, {settings.photons:,} photons", settings, FRAMES, {}))
    return out


def history(file: Path, rows: Sequence[Row], run: Callable[[dict], dict] = run_apart) -> Path:
    """Append a row per case, as soon as it is measured; return the SVG file of the plot.

    `run(spec) -> numbers` measures a row, or raises Failed. Raises UsageError for a file of other columns, OSError.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    check_writable("--out", file)
    need_matplotlib()
    if file.exists() and _read(file)[0] != list(COLUMNS):
        raise UsageError(f"{file} has other columns than a history of this program: give another file with --out")
    with Bar() as bar:
        for k, row in enumerate(rows):
            bar(row.key, k / len(rows))
            try:
                _append(file, row.key, run(row.spec()))
            except Failed as problem:
                raise UsageError(f"{row.key} could not be measured: {problem}") from None
    return draw(file)


def _append(file: Path, case: str, n: dict) -> None:
    machine = f"{platform.system()} {platform.machine()}, {n['threads']} threads"
    date = datetime.now(UTC).isoformat(timespec="seconds")
    times = n["frame_ms"]["median"], n["frame_ms"]["cpu"], n["first_frame_ms"], n["from_scratch_ms"]
    values = date, n["commit"] or "unknown", machine, n["processor"], n["load"], case, *(f"{ms:.4g}" for ms in times)
    new = not file.exists()
    with open(file, "a", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows(([COLUMNS] if new else []) + [values])


def _read(file: Path) -> tuple[list[str], list[dict]]:
    with open(file, newline="", encoding="utf-8") as lines:
        reader = csv.DictReader(lines)
        rows = list(reader)
        return list(reader.fieldnames or ()), rows


def draw(file: Path) -> Path:
    """Draw the median frame time [ms] of each case over commits, in the order of the file; return the SVG file."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    _, rows = _read(file)
    commits = list(dict.fromkeys(row["commit"] for row in rows))
    figure, axis = pyplot.subplots(figsize=(11, 6), layout="constrained")
    for case in dict.fromkeys(row["case"] for row in rows):
        own = [row for row in rows if row["case"] == case]
        axis.plot([commits.index(r["commit"]) for r in own], [float(r["frame_ms"]) for r in own], "o-", label=case)
    axis.set(yscale="log", ylabel="GI frame, median [ms]", title="Frame time by commit")
    axis.set_xticks(range(len(commits)), commits, rotation=45, ha="right")
    axis.grid(axis="y", linewidth=0.4)
    figure.legend(loc="outside right upper", fontsize=9)
    out = file.with_suffix(".svg")
    figure.savefig(out, metadata={"Date": None})
    pyplot.close(figure)
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "bench" / "history.csv", metavar="FILE.csv")
    arguments = parser.parse_args()
    try:
        print(history(arguments.out, cases()))
    except (UsageError, OSError) as error:
        return fail(error, USAGE)
    return OK


if __name__ == "__main__":
    sys.exit(main())
