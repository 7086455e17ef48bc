"""`gi-viewer bench`: frame times, the report's tables."""

from __future__ import annotations

import argparse
from pathlib import Path

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.terminal import Exit
from app.settings import STEP_PER_FRAME, UsageError


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser)
    parser.set_defaults(light="photons")
    add = options.measuring(parser)
    add("--frames", type=values.frames, default=100, metavar="N", help="timed frames (default 100)")
    add("--step", type=values.positive, default=100 * STEP_PER_FRAME, metavar="PCT",
        help=f"distance of a mobile per frame [%% of the scene size] ({100 * STEP_PER_FRAME:g})")  # fmt: skip
    add("--json", type=Path, metavar="FILE", help="write every number to a JSON file too")
    add(
        "--tables",
        action="store_true",
        help="the report's tables 2.2 to 2.4 and its space partitionings, over SCENE too, into --out; minutes "
        "(2.1 and 2.6 to 2.8: `gi-viewer chart tree`)",
    )
    add("--out", type=Path, metavar="DIR", help="where --tables writes tables.md")


def run(arguments: argparse.Namespace) -> int:
    settings = settings_of(arguments)
    if arguments.tables != (arguments.out is not None):
        raise UsageError("--tables and --out DIR go together: the folder that is written to")
    if arguments.tables:
        from app.measure.bench.report import tables

        print(tables(settings, arguments.out))
    else:
        from app.measure.bench.measure import bench

        bench(settings, arguments.frames, arguments.json, arguments.step / 100)
    return Exit.OK
