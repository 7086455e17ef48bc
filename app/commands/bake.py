"""`gi-viewer bake`: a GLB file with light in its vertices, and a light map if asked for, for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.progress import Bar, opened, solve
from app.cli.terminal import Exit
from app.cli.version import need
from app.cli.writable import check_no_input, check_writable, write_whole
from app.settings import make_solver, open_scene

if TYPE_CHECKING:
    import numpy as np

    from gi_core.scene import Scene
    from gi_core.solver import Solver

DEFAULT = "gi-viewer.glb"


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, *(name for name in options.LIGHT if name != "gloss"))  # a baked file has diffuse light alone
    options.picture(parser, "white_balance")
    add = parser.add_argument_group("file").add_argument
    add("--out", type=Path, default=Path(DEFAULT), metavar="FILE.glb", help=f"the file ({DEFAULT})")
    add("--exposure", dest="of_colours", type=values.exposure, metavar="EV",
        help="of COLOR_0 [stops]; values above 1 are cut off (the highest at which lamps alone are)")  # fmt: skip
    options.seconds(add)
    add("--error", type=values.percent, metavar="PCT",
        help="bake the unbiased reference instead, at this noise relative to the light [%%]")  # fmt: skip
    add("--light-map", type=values.light_map, metavar="PIXELS",
        help="a second UV set, and irradiance over it as an image of about PIXELS per side: FILE.exr")  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Write the scene with its light to a GLB file, and its light map beside it; print their full paths."""
    from app.draw.baking import baked
    from app.draw.picture_files import write_channels
    from app.draw.shot import Shot
    from app.rest.scheduler import gather
    from gi_core.scene.types import UNITS

    settings, out, pixels, written = settings_of(arguments), arguments.out, arguments.light_map, []
    check_writable("--out", out, ".glb")
    image = out.with_suffix(".exr")
    if pixels is not None:
        need("xatlas", "unwraps meshes for light maps")
        need("OpenEXR", "writes .exr files")
        check_writable("--out", image)
    with opened(settings, open_scene) as (bar, scene):
        for file in (out, image):
            check_no_input("--out", file, settings, scene)
        solver = make_solver(scene, settings)
        solve(solver, bar)
        if arguments.error is None:
            gather(solver, arguments.seconds, bar)
        else:
            solver.frame = solver.frame._replace(irradiance=_reference(solver, arguments.error / 100, bar))
        bar("writing", 1.0)
        light_map = None if pixels is None else (pixels, image.name)
        baking = baked(Shot(solver, settings), arguments.of_colours, light_map)
        if baking.light_map is not None:  # first: the other file names it
            E, coverage = baking.light_map
            channels = dict(zip("RGB", (E[..., k].copy() for k in range(3)), strict=True)) | {"A": coverage}
            about = {"content": f"irradiance [{UNITS[scene.units].per_area}]", "glb": out.name}
            written = [write_channels(image, channels, about)]
        write_whole(out, baking.glb)
        if note := _left_out(scene):
            bar.say(f"gi-viewer: {note}")
    for path in (out.resolve(), *written):
        print(path)
    return Exit.OK


def _left_out(scene: Scene) -> str:
    """Return a sentence about the materials whose gloss is not in the file; empty: there are none."""
    names = dict.fromkeys(f'"{m.name}"' for m in scene.materials if m.gloss is not None or m.brdf)
    if not names:
        return ""
    return (f"gloss depends on the view and is not baked: {', '.join(names)} have their diffuse light; metallic, "
            "roughness and extras of these materials describe the rest")  # fmt: skip


def _reference(solver: Solver, error: float, bar: Bar) -> np.ndarray:
    """Return unbiased irradiance (R, 3) at the solver's poses and levels; it is kept on disk."""
    from app.rest.reference_store import ReferenceStore

    store = ReferenceStore(solver.model, solver.poses, seed=solver.seed, levels=solver.levels)
    for reached in store.gather(error):
        bar("gathering the reference", reached.fraction)
    return reached.state.mean
