"""`gi-viewer info`: contents of a scene, its default settings and the reasons for them."""

from __future__ import annotations

import argparse

from app.cli import options
from app.cli.options import settings_of
from app.cli.terminal import Exit, say


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, "estimator", "photons", "radius", "neighbours", "control", "search", "rays", "lamps", "seed")
    options.picture(parser, "exposure")


def run(arguments: argparse.Namespace) -> int:
    from app.measure.scene_info import info

    say(info(settings_of(arguments)))
    return Exit.OK
