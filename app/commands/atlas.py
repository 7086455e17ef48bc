"""`gi-viewer atlas`: failures of each method, as predicted and as measured."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli.terminal import Exit


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of index.html")


def run(arguments: argparse.Namespace) -> int:
    from app.measure.atlas import atlas

    print(atlas(arguments.out).resolve())
    return Exit.OK
