"""`gi-viewer [SCENE]`: the window, or one picture in a file where no window can be opened."""

from __future__ import annotations

import argparse
import sys

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.terminal import Exit, fail
from app.commands.render import FALLBACK_PICTURE
from app.settings import open_scene


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser)
    options.picture(parser)
    add = parser.add_argument_group("window").add_argument
    options.budget(add, "; 0: always all")
    options.surface(add)
    add(
        "--no-fallback",
        dest="fallback",
        action="store_false",
        help=f"fail with code {Exit.NO_GL} where no window can be opened, instead of drawing ./{FALLBACK_PICTURE}",
    )
    add(
        "--screenshot",
        type=values.png,
        metavar="FILE.png",
        help="save the whole window once its light is refined, and quit",
    )


def run(arguments: argparse.Namespace) -> int:
    settings = settings_of(arguments)
    from app.window.window import why_no_window

    reason = why_no_window()
    if reason is None:
        from app.window.viewer import run

        return run(settings, screenshot=arguments.screenshot)
    if not settings.fallback:
        return fail(reason, Exit.NO_GL)
    from app.commands.render import render, unused_name

    open_scene(settings)  # an error of the scene comes first, and alone
    print(f"gi-viewer: no window, so a picture is drawn into a file: {reason}", file=sys.stderr, flush=True)
    (path,) = render(settings, arguments.screenshot or unused_name())
    print(f"The picture is in {path}")
    return Exit.OK
