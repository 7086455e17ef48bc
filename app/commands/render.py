"""`gi-viewer render`: pictures and films without a window."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from app import values
from app.cli import options
from app.cli.options import settings_of
from app.cli.progress import Bar, opened, solve, time_left
from app.cli.terminal import Exit
from app.cli.version import need
from app.cli.writable import check_no_input, check_writable
from app.settings import Settings, UsageError, make_solver, open_scene

if TYPE_CHECKING:
    from app.session.picture import Still

FALLBACK_PICTURE = "gi-viewer.png"
STILLS, FILMS = (".png", ".exr"), (".mp4", ".gif", ".webp")
MEMORY = {".png": 8, ".exr": 75, ".mp4": 240, ".gif": 55, ".webp": 29}  # bytes per pixel, of noise
RATE = 25  # pictures per second


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser)
    options.picture(parser)
    add = parser.add_argument_group("files").add_argument
    add("--out", type=Path, metavar="FILE",
        help=f"a .png or linear .exr; of --frames also a film: {', '.join(FILMS)} ({FALLBACK_PICTURE}, numbered where"
             " that exists)")  # fmt: skip
    add("--scale", type=values.scale, default=1, metavar="N", help="times the pixels of --size per side (1)")
    options.seconds(add)
    options.surface(add)
    add("--still", action="store_true", help="light per pixel by rays: shadows and light between near things are sharp")
    add("--truth", type=values.pixel_paths, metavar="N", help="N whole paths per pixel, without bias; implies --still")
    add("--frames", type=values.frames, metavar="N", help="N pictures along the path: FILE.0001.png and so on")
    add("--rate", type=values.rate, default=RATE, metavar="N", help=f"pictures per second of a film ({RATE})")


def run(arguments: argparse.Namespace) -> int:
    a = arguments
    out = a.out or unused_name(a.frames)
    settings = settings_of(a)
    settings = replace(settings, size=(a.scale * settings.size[0], a.scale * settings.size[1]))
    for path in render(settings, out, a.frames, a.seconds, a.rate, a.truth or (0 if a.still else None)):
        print(path)
    return Exit.OK


def render(
    settings: Settings, out: Path, frames: int | None = None, seconds: float | None = None, rate: int = RATE,
    paths: int | None = None,
) -> list[Path]:  # fmt: skip
    """Write one picture, or `frames` pictures along the mobiles' paths, or these as a film; return their full paths.

    seconds: for gathering light before, see `gather`; rate: pictures per second of a film; paths: of `Shot`.
    Raises SceneError, UsageError, OSError.
    """
    from app.draw import motion
    from app.draw.shot import Shot
    from app.rest.scheduler import gather, hold
    from app.session.picture import along, still

    linear = out.suffix.lower() == ".exr"
    _check(settings, out, frames, rate, paths)
    with opened(settings, open_scene) as (bar, scene):
        check_no_input("--out", out, settings, scene)
        solver = make_solver(scene, settings)
        solve(solver, bar)
        if held := hold(solver, settings, bar):
            bar.say("\n".join(held.sentences))
        gather(solver, seconds, bar, at_poses=frames is None)
        shot = Shot(solver, settings, paths)
        shot.report = bar
        bar("refining the picture", 0.0)
        shot.refine()
        if frames is None:
            written = still(shot, linear, lambda f: bar("drawing", f)).write(out)
            if text := shot.without_isolines():
                bar.say(f"gi-viewer: {text}")
            return [written]
        poses = motion.spread(motion.paths_of(solver), frames)
        return _written(_counted(along(shot, poses, linear), frames, bar), out, rate)


def _written(stills: Iterator[Still], out: Path, rate: int) -> list[Path]:
    """Write pictures as they come, to numbered files or a film."""
    from app.draw.picture_files import write_video

    if out.suffix.lower() in FILMS:
        return [write_video(out, (s.picture for s in stills), rate)]  # type: ignore[misc]
    return [s.write(numbered(out, k)) for k, s in enumerate(stills, 1)]


def _counted(stills: Iterator[Still], frames: int, bar: Bar) -> Iterator[Still]:
    """Yield the pictures, showing progress."""
    began = time.monotonic()
    for k, drawn in enumerate(stills, 1):
        yield drawn
        bar(f"drawing{time_left((frames - k) * (time.monotonic() - began) / k)}", k / frames)


def numbered(out: Path, k: int) -> Path:
    """Return a.0001.png for a.png."""
    return out.with_name(f"{out.stem}.{k:04d}{out.suffix}")


def unused_name(frames: int | None = None) -> Path:
    """Return the first of gi-viewer.png, gi-viewer-001.png, ... that does not exist, nor has the first of `frames`."""
    paths = (Path(f"gi-viewer-{n:03d}.png" if n else FALLBACK_PICTURE) for n in count())
    return next(path for path in paths if not (path if frames is None else numbered(path, 1)).exists())


def _check(settings: Settings, out: Path, frames: int | None, rate: int, paths: int | None) -> None:
    """Refuse before the work, not after it."""
    most_memory = 4  # [GB]
    suffix = out.suffix.lower()
    if suffix not in STILLS + FILMS:
        raise UsageError(f"--out must name a file of {', '.join(STILLS + FILMS)}, got {out}")
    if suffix in FILMS and frames is None:
        raise UsageError(f"--out {out} is a film: give --frames N, or name a .png file")
    width, height = settings.size
    need_gb = 1e-9 * (MEMORY[suffix] + (paths is not None) * 460) * width * height
    if need_gb > most_memory:
        raise UsageError(
            f"--out {out} of {width}x{height} pixels takes {need_gb:.0f} GB of memory, more than {most_memory}; lower "
            f"--size or --scale, or {'name a .png file' if paths is None else 'leave --still out'}"
        )
    if max(settings.size) > (most := 16383 if suffix == ".webp" else values.LONGEST_SIDE):
        raise UsageError(f"--out {out} has at most {most} pixels per side, got {max(settings.size)}")
    if suffix == ".gif" and rate > 100:  # it counts time in 1/100 s
        raise UsageError(f"--out {out} has at most 100 pictures per second, got --rate {rate}")
    if suffix == ".exr":
        need("OpenEXR", "writes .exr files")
    if suffix in FILMS:
        need("av", f"writes {suffix} files")
    check_writable("--out", out if frames is None or suffix in FILMS else numbered(out, 1))
