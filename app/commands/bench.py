"""`gi-viewer bench`: times of frames, their bounds, sweeps and the report's tables."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli import options, values
from app.cli.exit_codes import OK
from app.cli.options import settings_of
from app.settings import STEP, UsageError


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser)
    parser.set_defaults(light="photons")
    add = options.measuring(parser)
    add("--frames", type=values.positive_int, default=100, metavar="N", help="timed frames (default 100)")
    add("--step", type=values.positive, default=100 * STEP, metavar="PCT",
        help=f"how far a mobile goes in a frame [%% of the scene size] ({100 * STEP:g})")  # fmt: skip
    add("--json", type=Path, metavar="FILE", help="write every number to a JSON file too")
    add(
        "--sweep", action="store_true", help="measure a table of settings into --out; goes on with one that was stopped"
    )
    add("--tables", action="store_true", help="the report's tables 2.1 to 2.5 with our times, into --out; minutes")
    add("--contact", action="store_true", help="what contact of objects costs: the same frames with it and without")
    add("--out", type=Path, metavar="DIR", help="where --sweep writes sweep.json and sweep.md, --tables tables.md")
    add("--large", action="store_true", help="--sweep with 10,000,000 photons as well: minutes, and gigabytes")
    add("--compare", type=Path, nargs=2, metavar=("A.json", "B.json"),
        help="print B / A of every number that two such files both have")  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    settings = settings_of(arguments)
    if arguments.compare is not None:
        from app.measure.bench.compare import compare

        print("\n".join(compare(*arguments.compare)))
        return OK
    if (arguments.sweep or arguments.tables) != (arguments.out is not None):
        raise UsageError("--sweep and --out DIR go together, --tables and --out too: the folder that is written to")
    if arguments.tables:
        from app.measure.bench.report import tables

        print(tables(settings, arguments.out))
    elif arguments.contact:
        from app.measure.bench import contact as bench_contact

        print("\n".join(bench_contact.bench(settings, arguments.frames)))
    elif arguments.sweep:
        from app.measure.bench.sweep import sweep

        sweep(settings, arguments.frames, arguments.out, arguments.large)
        print((arguments.out / "sweep.md").read_text(encoding="utf-8"))
    else:
        from app.measure.bench.command import bench

        bench(settings, arguments.frames, arguments.json, arguments.step / 100)
    return OK
