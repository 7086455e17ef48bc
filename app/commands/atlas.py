"""`gi-viewer atlas`: the failures of each method, as predicted and as measured."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli.exit_codes import OK


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where index.html and atlas.md go")


def run(arguments: argparse.Namespace) -> int:
    from app.measure.atlas.command import atlas

    atlas(arguments.out)
    print((arguments.out / "atlas.md").read_text(encoding="utf-8"))
    return OK
