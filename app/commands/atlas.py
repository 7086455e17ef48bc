"""`gi-viewer atlas`: failures of each method, as predicted and as measured."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli import options
from app.cli.terminal import Exit
from app.settings import Settings, check_names


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of index.html")
    options.light(parser, "rays")


def run(arguments: argparse.Namespace) -> int:
    from app.measure.atlas import atlas

    rays = getattr(arguments, "rays", None)
    check_names(Settings(rays=rays))
    print(atlas(arguments.out, rays=rays).resolve())
    return Exit.OK
