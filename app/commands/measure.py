"""`gi-viewer measure`: illuminance on a measuring plane and at probes, as numbers, without a window."""

from __future__ import annotations

import argparse
from pathlib import Path

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.progress import opened, time_left
from app.cli.terminal import OK, say
from app.cli.writable import check_no_input, check_writable, write_whole
from app.settings import Settings, UsageError, make_solver, open_scene


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, "lamps", "rays", "seed")
    add = options.measuring(parser)
    options.plane(add)
    add("--error", type=values.percent, default=1.0, metavar="PCT",
        help="stop at this noise, relative to the light [%%] (1)")  # fmt: skip
    add("--csv", type=Path, metavar="FILE.csv", help="write the table with all points")


def run(arguments: argparse.Namespace) -> int:
    say(measure(settings_of(arguments), arguments.error / 100, arguments.csv))
    return OK


def measure(settings: Settings, error: float, file: Path | None = None) -> list[str]:
    """Path trace the light on the measuring plane, at probes and at pins; return the table, write it as CSV.

    error: relative l1 noise at the end. Raises SceneError, UsageError, OSError.
    """
    import time

    from app.draw.units import units_of
    from app.rest.measuring_plane import default_plane, level_of, plane_steps
    from app.session.readouts import csv_text, text_lines

    if file is not None:
        if file.suffix.lower() != ".csv":
            raise UsageError(f"--csv must name a .csv file, got {file}")
        check_writable("--csv", file)
    with opened(settings, open_scene) as (bar, scene):
        if file is not None:
            check_no_input("--csv", file, settings, scene)
        solver = make_solver(scene, settings)
        level, units = level_of(solver.model), units_of(scene.units)
        plane, started = settings.plane or default_plane(level), time.monotonic()
        for light in plane_steps(solver.model, plane, level, solver.poses, solver.levels, solver.seed, error):
            spent = time.monotonic() - started
            left = spent * (1 / light.fraction - 1) if light.fraction > 0 else None
            bar(f"measuring{time_left(left)}", light.fraction)
        rows = _points(settings, solver, error)
    if file is not None:
        write_whole(file, csv_text(rows, light, units))
    return text_lines(rows, light, level, units)


def _points(settings: Settings, solver, error: float) -> list:
    """Return the light at the scene's probes and at the pins of a saved scene."""
    import numpy as np

    from app.rest.measuring_plane import light_steps, point_rounds
    from app.session.readouts import Row
    from gi_core.scene.pose import to_world, to_world_directions

    places = [("probe", p.name, p.position, p.normal) for p in solver.scene.probes]
    for pin in settings.pins:
        position, normal = np.array([pin.position]), np.array([pin.normal])
        if pin.object:
            if pin.object not in solver.poses:
                raise UsageError(f'the pin "{pin.name}" lies on "{pin.object}", which this scene does not have')
            pose = solver.poses[pin.object]
            position, normal = to_world(pose, position), to_world_directions(pose, normal)
        places.append(("pin", pin.name, tuple(position[0]), tuple(normal[0])))
    if not places:
        return []
    points, normals = (np.array([place[k] for place in places], np.float64) for k in (2, 3))
    rounds = point_rounds(solver.model, points, normals, solver.poses, solver.levels, solver.seed)
    *_, (E, errors, _) = light_steps(rounds, error)
    return [Row(*place[:3], float(e), float(s)) for place, e, s in zip(places, E, errors, strict=True)]
