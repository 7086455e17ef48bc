"""Frame times of twelve fixed cases, beside those of the last commit with a row, alternating in one run.

    python -m studies.frame_history --out bench/history.csv [--only tree]

It takes minutes. Each side runs `gi-viewer bench` in processes of its own; the earlier commit lies in a git worktree
under a temporary folder, with its own kernels. A row per case is appended at once, and a plot of all rows is drawn.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from app.cli.progress import Bar
from app.cli.terminal import Exit, fail
from app.cli.version import need
from app.cli.writable import check_writable
from app.settings import UsageError
from gi_core.estimators import ESTIMATORS

ROOT = Path(__file__).resolve().parents[1]
COLUMNS = ("date", "commit", "machine", "processor", "load", "case", "frame_ms", "cpu_ms", "first_frame_ms",
           "from_scratch_ms")  # fmt: skip
ROUNDS = 2  # runs of a case at each commit


class Case(NamedTuple):
    """A row of every run."""

    key: str
    words: str  # arguments of `gi-viewer bench`


class Program(NamedTuple):
    """The program at a commit."""

    root: Path
    environment: dict[str, str]


def cases() -> list[Case]:
    """Return the tree by estimator and photons without control, and three rooms whose mobiles gather light."""
    out = []
    for estimator in ESTIMATORS:
        for photons in (10_000, 100_000, 1_000_000):
            words = f"tree --photons {photons} --estimator {estimator} --no-control --light photons --frames 60"
            out.append(Case(f"tree, {estimator}, {photons:,} photons", words))
    for scene in ("cornell", "living_room", "gallery"):
        out.append(Case(f"{scene}, best light, 16,384 photons", f"{scene} --photons 16384 --light best --frames 60"))
    return out


def bench(case: Case, program: Program) -> dict:
    """Return the numbers of a case, measured by a process of the program. Raises UsageError."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bench.json"
        command = [sys.executable, "-m", "app", "bench", *case.words.split(), "--json", str(file)]
        environment = os.environ | {"PYTHONPATH": str(program.root)} | program.environment
        done = subprocess.run(command, cwd=program.root, env=environment, text=True, capture_output=True)
        if done.returncode:
            lines = done.stderr.strip().splitlines() or [f"ended with code {done.returncode}"]
            raise UsageError(f"{case.key} could not be measured in {program.root}: {lines[-1]}")
        return json.loads(file.read_text(encoding="utf-8"))


def last_commit(rows: Sequence[dict]) -> str | None:
    """Return the last commit with a row that the repository has and that is not checked out; None without any."""
    here = _git("rev-parse", "HEAD")
    for commit in dict.fromkeys(row["commit"] for row in reversed(rows)):
        full = _git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}")
        if full and full != here:
            return full
    return None


def _git(*words: str) -> str:
    """Return what git prints, empty where it fails."""
    return subprocess.run(["git", "-C", str(ROOT), *words], text=True, capture_output=True).stdout.strip()


@contextmanager
def checked_out(commit: str) -> Iterator[Program]:
    """Check a commit out into a temporary worktree; remove it with its kernels at the end."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "tree"
        if subprocess.run(["git", "-C", str(ROOT), "worktree", "add", "--detach", str(root), commit],
                          capture_output=True).returncode:  # fmt: skip
            raise UsageError(f"git cannot check out {commit} into {root}")
        try:
            yield Program(root, {"NUMBA_CACHE_DIR": str(Path(folder) / "kernels")})
        finally:
            _git("worktree", "remove", "--force", str(root))


def compare(
    file: Path, wanted: Sequence[Case], earlier: Program | None, run: Callable[[Case, Program], dict] = bench
) -> Iterator[str]:
    """Append a row per case, as soon as it is measured; yield a line that compares it with an earlier commit.

    `run(case, program) -> numbers` measures. Raises UsageError for a file of other columns, OSError.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    check_writable("--out", file)
    if file.exists() and _read(file)[0] != list(COLUMNS):
        raise UsageError(f"{file} has other columns than a history of this program: give another file with --out")
    with Bar() as bar:
        for k, case in enumerate(wanted):
            bar(case.key, k / len(wanted))
            before, now = [], []
            for _ in range(ROUNDS):
                if earlier is not None:
                    before.append(run(case, earlier))
                now.append(run(case, Program(ROOT, {})))
            best = min(now, key=lambda n: n["frame_ms"]["median"])
            _append(file, case.key, best)
            yield _line(case, before, now)


def _line(case: Case, before: list[dict], now: list[dict]) -> str:
    """Return the times of each round before and now, and the ratio of the least CPU times, which load changes least."""
    parts = [case.key]
    for name, unit in (("median", "ms"), ("cpu", "ms CPU")):
        sides = (", ".join(f"{n['frame_ms'][name]:.3g}" for n in side) for side in (before, now) if side)
        parts.append(" -> ".join(sides) + f" {unit}")
    if before:
        least = (min(n["frame_ms"]["cpu"] for n in side) for side in (now, before))
        parts.append(f"{next(least) / next(least):.2f} x")
    return "; ".join(parts)


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
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name contains TEXT")
    arguments = parser.parse_args()
    wanted = [case for case in cases() if arguments.only in case.key]
    try:
        need("matplotlib", "draws the chart")
        commit = last_commit(_read(arguments.out)[1]) if arguments.out.exists() else None
        with checked_out(commit) if commit else nullcontext() as earlier:
            print(f"before: {commit or 'no commit'}", flush=True)
            for line in compare(arguments.out, wanted, earlier):
                print(line, flush=True)
        print(draw(arguments.out))
    except (UsageError, OSError) as error:
        return fail(error, Exit.USAGE)
    return Exit.OK


if __name__ == "__main__":
    sys.exit(main())
