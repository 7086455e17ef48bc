"""`gi-viewer atlas`: failures of each method, as predicted and as measured."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli.exit_codes import OK


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of index.html")


def run(arguments: argparse.Namespace) -> int:
    from app.measure.atlas.command import atlas

    print(atlas(arguments.out).resolve())
    return OK
