"""`gi-viewer report`: luminaires, surfaces with targets, pictures and power as one page of HTML, without a window."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from app.cli import options
from app.cli.options import settings_of
from app.cli.progress import opened, solve
from app.cli.terminal import Exit, say
from app.cli.version import version
from app.cli.writable import check_no_input, check_writable, write_whole
from app.commands.measure import measured
from app.settings import ILLUMINANCE, make_solver, open_scene


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, "photons", "lamps", "rays", "seed")
    options.picture(parser, "size", "exposure", "white_balance", "tone_map", "illuminance_range", "isolines")
    add = options.measuring(parser)
    options.surface(add)
    add("--out", type=Path, required=True, metavar="FILE.html", help="the page, which needs no other file")
    add("--json", type=Path, metavar="FILE.json", help="write its numbers too")
    options.error(add)


def run(arguments: argparse.Namespace) -> int:
    """Write a report, and its numbers as JSON; print the paths.

    Pictures have the light of photons and no gathered light, so that equal inputs give equal bytes.
    """
    from app.draw.picture_files import png
    from app.draw.shot import Shot
    from app.session import report as written
    from gi_core.lights.power import power_of

    settings, numbers, error = settings_of(arguments), arguments.json, arguments.error / 100
    files = [("--out", arguments.out, ".html")] + ([] if numbers is None else [("--json", numbers, ".json")])
    for option, file, suffix in files:
        check_writable(option, file, suffix)
    with opened(settings, open_scene) as (bar, scene):
        for option, file, _ in files:
            check_no_input(option, file, settings, scene)
        solver = make_solver(scene, settings)
        held, level, lights = measured(solver, settings, error, bar)
        solve(solver, bar)
        pictures = []
        lines = () if settings.isolines is None else settings.isolines
        for show, caption in (("radiance", "Picture"), (ILLUMINANCE, "Illuminance on surfaces, in false colours")):
            shot = Shot(solver, replace(settings, show=show, isolines=lines))
            shot.refine()
            pictures.append((caption, png(shot.take(lambda f: bar("drawing", f)))))
        watts = power_of(solver.model.emitters, scene, solver.levels, settings.watts, level.area)
        content = written.Content(
            solver.model, settings, solver.levels, level, lights, watts, pictures, version(), error
        )
    write_whole(arguments.out, written.page(content))
    if numbers is not None:
        write_whole(numbers, written.numbers(content))
    say([*held, *(str(file) for _, file, _ in files)])
    return Exit.OK
