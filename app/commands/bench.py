"""`gi-viewer bench`: frame times."""

from __future__ import annotations

import argparse
from pathlib import Path

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.terminal import Exit
from app.settings import STEP_PER_FRAME


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser)
    parser.set_defaults(light="photons")
    add = options.measuring(parser)
    add("--frames", type=values.frames, default=100, metavar="N", help="timed frames (default 100)")
    add("--step", type=values.positive, default=100 * STEP_PER_FRAME, metavar="PCT",
        help=f"distance of a mobile per frame [%% of the scene size] ({100 * STEP_PER_FRAME:g})")  # fmt: skip
    add("--json", type=Path, metavar="FILE", help="write every number to a JSON file too")


def run(arguments: argparse.Namespace) -> int:
    from app.measure.bench import bench

    bench(settings_of(arguments), arguments.frames, arguments.json, arguments.step / 100)
    return Exit.OK
