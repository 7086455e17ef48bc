"""`gi-viewer bake`: a GLB file with light in its vertices, for other programs."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from app.cli import options, values
from app.cli.exit_codes import OK
from app.cli.options import settings_of
from app.cli.progress import opened, solve
from app.cli.writable import check_writable, write_whole
from app.settings import Settings, UsageError, make_solver, open_scene

DEFAULT = "gi-viewer.glb"


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser)
    options.picture(parser, "white_balance")
    add = parser.add_argument_group("file").add_argument
    add("--out", type=Path, default=Path(DEFAULT), metavar="FILE.glb", help=f"the file ({DEFAULT})")
    add("--exposure", type=values.exposure, default=None, metavar="EV",
        help="of COLOR_0 [stops]; values above 1 are cut off (the highest at which lamps alone are)")  # fmt: skip
    options.seconds(add)


def run(arguments: argparse.Namespace) -> int:
    print(bake(settings_of(arguments), arguments.out, arguments.seconds))
    return OK


def bake(settings: Settings, out: Path, seconds: float | None = None) -> Path:
    """Write the scene with its light to a GLB file; return its full path.

    seconds: for gathering light before, see `gather`. Raises SceneError, UsageError, OSError.
    """
    from app.draw.baking import baked
    from app.draw.shot import Shot
    from app.rest.within import gather

    if out.suffix.lower() != ".glb":
        raise UsageError(f"--out must name a .glb file, got {out}")
    check_writable("--out", out)
    with opened(settings, open_scene) as (bar, scene):
        solver = make_solver(scene, settings)
        solve(solver, bar)
        gather(solver, seconds, bar)
        bar("writing", 1.0)
        shot = Shot(solver, replace(settings, exposure=None))
        shot.expose()
        light = shot.meshes, solver.irradiance, shot.camera, settings.exposure, shot.gains, shot.exposure
        write_whole(out, baked(solver, *light))
    return out.resolve()
