"""`gi-viewer render`: pictures without a window, one, or many along the path."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from app.cli import options, values
from app.cli.exit_codes import OK
from app.cli.options import settings_of
from app.cli.progress import opened, solve
from app.cli.writable import check_writable
from app.rest.static_job import gather
from app.settings import Settings, UsageError, make_solver, open_scene

FALLBACK_PICTURE = "gi-viewer.png"


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser)
    options.picture(parser)
    add = parser.add_argument_group("files").add_argument
    add("--out", type=Path, metavar="FILE.png", help=f"the picture ({FALLBACK_PICTURE})")
    add("--frames", type=values.positive_int, metavar="N", help="N pictures along the path: FILE.0001.png and so on")


def run(arguments: argparse.Namespace) -> int:
    out = arguments.out or Path(FALLBACK_PICTURE)
    replaced = arguments.out is None and arguments.frames is None and out.exists()
    for path in render(settings_of(arguments), out, arguments.frames):
        print(path)
    if replaced:
        print(f"gi-viewer: the {out} that was there is replaced; --out FILE.png names another", file=sys.stderr)
    return OK


def render(settings: Settings, out: Path, frames: int | None = None) -> list[Path]:
    """Write one picture, or `frames` pictures along the mobiles' paths; return their full paths.

    Raises SceneError, UsageError, OSError.
    """
    from app.draw import motion
    from app.draw.png import write_png
    from app.draw.shot import Shot
    from app.session.picture import metadata_of

    _check(out, frames)
    with opened(settings, open_scene) as (bar, scene):
        solver = make_solver(scene, settings)
        solve(solver, bar)
        if settings.light == "best":  # by option only; by default a picture does not wait
            gather(solver, bar)
            for progress in solver.gather_pose_steps() if frames is None else ():
                bar(progress.stage, progress.fraction)
        shot = Shot(solver, settings)
        if frames is None:
            return [write_png(out, shot.take(lambda f: bar("drawing", f)), metadata_of(shot))]
        written = []
        for k, poses in enumerate(motion.spread(motion.paths_of(solver), frames)):
            bar("drawing", k / frames)
            if poses:
                solver.move_all(poses)
            written.append(write_png(numbered(out, k + 1), shot.take(), metadata_of(shot)))
        return written


def numbered(out: Path, k: int) -> Path:
    """Return a.0001.png for a.png."""
    return out.with_name(f"{out.stem}.{k:04d}{out.suffix}")


def _check(out: Path, frames: int | None) -> None:
    """Refuse before the work, not after it."""
    if out.suffix.lower() != ".png":
        raise UsageError(f"--out must name a .png file, got {out}")
    check_writable("--out", out if frames is None else numbered(out, 1))
