"""`gi-viewer chart`: error against frame time of many settings."""

from __future__ import annotations

import argparse
from pathlib import Path

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.terminal import Exit, fail


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, "estimator", "photons", "radius", "neighbours", "control", "search", "rays", "lamps", "seed")
    options.picture(parser, "exposure")
    add = options.measuring(parser)
    add("--out", type=Path, default=Path("chart"), metavar="DIR",
        help="folder of results.csv, chart.svg, index.html (chart)")  # fmt: skip
    add("--quick", action="store_true", help="few settings, frames and receivers: a minute")
    add("--frames", type=values.frames, metavar="N", help="timed frames per setting, along the path (40)")
    add("--points", type=values.points, metavar="N", help="receivers per pose at which errors are measured (1500)")


def run(arguments: argparse.Namespace) -> int:
    a = arguments
    from app.measure.chart.page import chart

    text, failures = chart(settings_of(a), a.out, a.quick, a.frames, a.points)
    print(text)
    for failure in failures:
        fail(failure, Exit.INCOMPLETE)
    return Exit.INCOMPLETE if failures else Exit.OK
