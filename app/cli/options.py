"""What single commands take beside what all of them take."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli import values
from app.settings import SHOWS, STEP, TONE_MAPS, Settings


def picture(parser: argparse.ArgumentParser) -> None:
    """Add what pictures take."""
    add = parser.add_argument
    default = "x".join(map(str, Settings.size))
    add("--size", type=values.size, default=Settings.size, metavar="WxH", help=f"pixels ({default})")
    add("--tone-map", choices=TONE_MAPS, default=Settings.tone_map, help=f"({Settings.tone_map})")
    add("--show", choices=SHOWS, default=Settings.show, help="with reflectance, or irradiance alone (radiance)")
    add("--no-cull", dest="cull", action="store_false", help="draw the backs of one-sided faces too, dark grey")


def budget(parser: argparse.ArgumentParser, off: str) -> None:
    """Add --budget; `off` says what 0 means."""
    parser.add_argument(
        "--budget",
        type=values.not_negative,
        default=Settings.budget,
        metavar="MS",
        help=f"what light may take while something moves, with as many photons as fit{off} ({Settings.budget:g})",
    )


def tune(parser: argparse.ArgumentParser) -> None:
    """Add those of `tune`."""
    budget(parser, "")
    add = parser.add_argument
    add("--error", type=values.positive, metavar="PCT", help="choose the fastest settings with this error at rest")
    add("--check", action="store_true", help="solve with the choice and measure its error")


def bench(parser: argparse.ArgumentParser) -> None:
    """Add those of `bench`."""
    parser.set_defaults(light="photons")
    add = parser.add_argument
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


def reference(parser: argparse.ArgumentParser) -> None:
    """Add those of `reference`."""
    parser.add_argument("--error", type=values.positive, default=1.0, metavar="PCT",
        help="stop when chance makes no larger error than this share of the light [%%] (1)")  # fmt: skip


def chart(parser: argparse.ArgumentParser) -> None:
    """Add those of `chart`."""
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        default=Path("chart"),
        metavar="DIR",
        help="folder of results.csv, chart.svg, index.html (chart)",
    )
    add("--quick", action="store_true", help="few settings, frames and receivers: a minute")
    add("--atlas", action="store_true", help="instead, of no scene: where each method fails (as gi-viewer atlas)")
    add("--frames", type=values.positive_int, metavar="N", help="timed frames along the path a setting (40)")
    add("--points", type=values.positive_int, metavar="N", help="receivers a pose whose error is taken (1500)")
