"""`gi-viewer measure`: illuminance on calculation surfaces and at probes, as numbers, without a window."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.progress import Bar, opened, time_left
from app.cli.terminal import Exit, say
from app.cli.writable import check_no_input, check_writable, write_whole
from app.settings import Settings, UsageError, make_solver, open_scene
from gi_core.scene.types import UNITS

if TYPE_CHECKING:
    from app.rest.calculation_surface import SurfaceLight
    from app.rest.surface_grid import Level
    from app.session.readouts import Row
    from gi_core.solver import Solver


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, "lamps", "rays", "seed")
    add = options.measuring(parser)
    options.surface(add)
    options.error(add)
    add("--shares", action="store_true", help="light of probes and pins by lamp, last surface and bounces")
    add("--csv", type=Path, metavar="FILE.csv", help="write the table with all points")


def run(arguments: argparse.Namespace) -> int:
    say(measure(settings_of(arguments), arguments.error / 100, arguments.csv, arguments.shares))
    return Exit.OK


def measure(settings: Settings, error: float, file: Path | None = None, shares: bool = False) -> list[str]:
    """Path trace the light on calculation surfaces, at probes and at pins; return the tables, write them as CSV.

    error: relative l1 noise at the end; shares: also the origins of the light at points. Raises SceneError,
    UsageError, OSError.
    """
    from app.session.readouts import csv_text, text_lines
    from gi_core.lights.power import power_of

    if file is not None:
        check_writable("--csv", file, ".csv")
    with opened(settings, open_scene) as (bar, scene):
        if file is not None:
            check_no_input("--csv", file, settings, scene)
        solver = make_solver(scene, settings)
        units = UNITS[scene.units]
        held, level, lights = measured(solver, settings, error, bar)
        rows, origins = _points(settings, solver, error, shares)
    if file is not None:
        write_whole(file, csv_text(rows, lights, units))
    power = power_of(solver.model.emitters, scene, solver.levels, settings.watts, level.area)
    return [*held, *[""][: len(held)], *text_lines(rows, lights, level, units, power), *origins]


def measured(
    solver: Solver, settings: Settings, error: float, bar: Bar
) -> tuple[tuple[str, ...], Level, list[SurfaceLight]]:
    """Return the held targets, the floor of a scene, and the light on its surfaces, or on one at desk height."""
    import time

    from app.rest.calculation_surface import WORKING_PLANE, all_steps, maintained_levels, surfaces_of
    from app.rest.hold import hold_now
    from app.rest.surface_grid import level_of

    held, level, started = hold_now(solver, settings, error, bar), level_of(solver.model), time.monotonic()
    surfaces = surfaces_of(settings, solver.scene) or (WORKING_PLANE,)
    light_of = {light.surface: light for light in (held.lights if held else ())}
    left = [s for s in surfaces if s not in light_of]
    levels = maintained_levels(solver.model, solver.levels, settings)
    for lights in all_steps(solver.model, left, level, solver.poses, levels, solver.seed, error) if left else ():
        done, spent = sum(light.fraction for light in lights) / len(lights), time.monotonic() - started
        bar(f"measuring{time_left(spent * (1 / done - 1) if done > 0 else None)}", done)
        light_of |= {light.surface: light for light in lights}
    return held.sentences if held else (), level, [light_of[s] for s in surfaces]


def _points(settings: Settings, solver: Solver, error: float, shares: bool) -> tuple[list[Row], list[str]]:
    """Return the light at the scene's probes and at the pins of a saved scene; shares: and lines about its origins."""
    import numpy as np

    from app.rest.calculation_surface import light_steps, point_rounds
    from app.rest.jobs import placed
    from app.session.readouts import Row, share_lines
    from gi_core.gather.origins import origin_steps

    for pin in settings.pins:
        if pin.object and pin.object not in solver.poses:
            raise UsageError(f'the pin "{pin.name}" lies on "{pin.object}", which this scene does not have')
    probes = [values.Pin(*probe) for probe in solver.scene.probes]
    pins, kinds = [*probes, *settings.pins], ["probe"] * len(probes) + ["pin"] * len(settings.pins)
    if not pins:
        return [], []
    points, normals = placed(pins, solver.poses)
    rounds = point_rounds(solver.model, points, normals, solver.poses, solver.levels, solver.seed)
    *_, (E, errors, _) = light_steps(rounds, error)
    of = zip(kinds, pins, points.tolist(), E.tolist(), errors.tolist(), strict=True)
    rows = [Row(kind, pin.name, (x, y, z), light, noise) for kind, pin, (x, y, z), light, noise in of]
    lines = []
    for row, point, normal in zip(rows if shares else (), points, normals, strict=False):
        *_, origins = origin_steps(solver.model, point, np.array(normal), solver.poses, solver.levels, solver.seed)
        lines += share_lines(row, origins, UNITS[solver.scene.units])
    return rows, lines
