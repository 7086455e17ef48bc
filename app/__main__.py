"""The command line: `gi-viewer [SCENE]`, and the commands that need no window.

Nothing heavy is imported before the arguments are known to be good: `--help` answers at once.
Exit codes: 0 done, 2 usage, 3 the scene cannot be used, 4 no OpenGL window (only with --no-fallback).
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from app.settings import SHOWS, TONE_MAPS, Settings, UsageError

OK, USAGE, SCENE, NO_GL = 0, 2, 3, 4
FALLBACK_PICTURE = "gi-viewer.png"

ABOUT = "Real-time global illumination: drag an object and shadow, colour bleeding and its own shading follow."
COMMANDS = {
    "render": "draw one picture, or --frames along the mobile's path, without a window",
    "bench": "move the mobile along its path and time every frame",
    "info": "say what is in a scene, which defaults are chosen, and why",
}


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    argv = sys.argv[1:] if argv is None else argv
    try:
        arguments = parse(argv)
    except SystemExit as stop:  # argparse has printed why
        return int(stop.code or 0)

    from gi_core.scene import SceneError

    try:
        return arguments.run(arguments)
    except SceneError as error:
        return _fail(error, SCENE)
    except UsageError as error:
        return _fail(error, USAGE)
    except OSError as error:
        return _fail(error, USAGE)
    except KeyboardInterrupt:
        return _fail("stopped", 130)


def parse(argv: list[str]) -> argparse.Namespace:
    """Return the checked arguments; `.run(arguments)` carries them out. Raises SystemExit like argparse."""
    if argv and argv[0] in COMMANDS:
        return _command_parser(argv[0]).parse_args(argv[1:])
    return _view_parser().parse_args(argv)


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Return the record that everything behind the command line works from."""
    given = {name: getattr(arguments, name) for name in Settings.__dataclass_fields__ if hasattr(arguments, name)}
    given["mobiles"], given["poses"] = tuple(given["mobiles"]), tuple(given["poses"])
    return Settings(**given)


def _view_parser() -> argparse.ArgumentParser:
    lines = [f"  gi-viewer {name} SCENE   {what}" for name, what in COMMANDS.items()]
    epilog = "commands without a window (each has its own --help):\n" + "\n".join(lines)
    parser = argparse.ArgumentParser(
        prog="gi-viewer", description=ABOUT, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    _add_common(parser)
    _add_picture(parser)
    parser.add_argument(
        "--no-fallback",
        dest="fallback",
        action="store_false",
        help=f"fail with code {NO_GL} where no window can be opened, instead of drawing ./{FALLBACK_PICTURE}",
    )
    parser.add_argument(
        "--screenshot", type=_png, metavar="FILE.png", help="save the whole window once its light is refined, and quit"
    )
    parser.set_defaults(run=_view)
    return parser


def _command_parser(name: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"gi-viewer {name}", description=COMMANDS[name])
    _add_common(parser)
    if name == "render":
        _add_picture(parser)
        parser.add_argument("--out", type=Path, default=Path(FALLBACK_PICTURE), metavar="FILE.png", help="the picture")
        parser.add_argument(
            "--frames", type=_positive_int, metavar="N", help="N pictures along the path: FILE.0001.png and so on"
        )
    if name == "bench":
        parser.add_argument("--frames", type=_positive_int, default=100, metavar="N", help="timed frames (default 100)")
        parser.add_argument("--json", type=Path, metavar="FILE", help="write every number to a JSON file too")
    parser.set_defaults(run={"render": _render, "bench": _bench, "info": _info}[name])
    return parser


def _add_common(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", nargs="?", default="cornell", metavar="SCENE", help="built-in name, .toml or mesh file (cornell)")
    add("--mobile", dest="mobiles", action="append", default=[], metavar="FILE", help="add a mesh file as a mobile")
    add("--pose", dest="poses", type=_pose, action="append", default=[], metavar="NAME=x,y,z[,qw,qx,qy,qz]",
        help="put a mobile somewhere [m], with a unit quaternion or turned as it is")  # fmt: skip
    add("--estimator", metavar="NAME", help="how light is gathered; `gi-viewer info` lists the names (tangent_plane)")
    add("--photons", type=_positive_int, metavar="N", help="photons to trace, 1e6 is allowed (scene's, else chosen)")
    add("--radius", type=_positive, metavar="M", help="disc radius or largest search radius [m]")
    add("--neighbours", type=_positive_int, metavar="K", help="hits that photon_map averages over")
    add("--seed", type=_seed, default=0, metavar="N", help="which photons (0)")
    add("--exposure", type=_finite, metavar="EV", help="stops, +1 doubles (the scene's, else metered)")
    add("--max-edge", type=_positive, metavar="M", help="cut triangles until no edge is longer [m]")
    add("--up", choices=["x", "y", "z"], help="which axis points up, instead of the file's")
    add("--version", action=_Version, nargs=0, help="print the version")


def _add_picture(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    default = "x".join(map(str, Settings.size))
    add("--size", type=_size, default=Settings.size, metavar="WxH", help=f"pixels ({default})")
    add("--tone-map", choices=TONE_MAPS, default=Settings.tone_map, help=f"({Settings.tone_map})")
    add("--show", choices=SHOWS, default=Settings.show, help="with reflectance, or irradiance alone (radiance)")
    add("--no-cull", dest="cull", action="store_false", help="draw the backs of one-sided faces too, dark grey")


def _view(arguments: argparse.Namespace) -> int:
    settings = settings_of(arguments)
    from app.window import why_no_window

    reason = why_no_window()
    if reason is None:
        from app.viewer import run

        return run(settings, screenshot=arguments.screenshot)
    if not settings.fallback:
        return _fail(reason, NO_GL)
    from app.render_command import render

    (path,) = render(settings, arguments.screenshot or Path(FALLBACK_PICTURE))
    print(f"No window: {reason}\nThe picture is in {path}")
    return OK


def _render(arguments: argparse.Namespace) -> int:
    from app.render_command import render

    for path in render(settings_of(arguments), arguments.out, arguments.frames):
        print(path)
    return OK


def _bench(arguments: argparse.Namespace) -> int:
    from app.bench_command import bench

    bench(settings_of(arguments), arguments.frames, arguments.json)
    return OK


def _info(arguments: argparse.Namespace) -> int:
    from app.info_command import info

    print("\n".join(info(settings_of(arguments))))
    return OK


def _fail(error: object, code: int) -> int:
    """Say what is wrong in one line on stderr."""
    print("gi-viewer: " + " ".join(str(error).split()), file=sys.stderr)
    return code


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        print(f"gi-viewer {version()}")
        parser.exit()


def version() -> str:
    """Return the installed version; in a checkout that was never installed, that of pyproject.toml."""
    from importlib import metadata

    try:
        return metadata.version("gi-viewer")
    except metadata.PackageNotFoundError:
        import tomllib

        with open(Path(__file__).parent.parent / "pyproject.toml", "rb") as file:
            return tomllib.load(file)["project"]["version"]


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be a finite number, got {text}")
    return value


def _positive(text: str) -> float:
    value = _finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"must be over 0, got {text}")
    return value


def _positive_int(text: str) -> int:
    value = _positive(text)
    if value != int(value):
        raise argparse.ArgumentTypeError(f"must be a whole number, got {text}")
    return int(value)


def _seed(text: str) -> int:
    value = int(text)
    if not 0 <= value < 2**63:
        raise argparse.ArgumentTypeError(f"must be in 0 .. 2^63 - 1, got {text}")
    return value


def _png(text: str) -> Path:
    if Path(text).suffix.lower() != ".png" or not Path(text).resolve().parent.is_dir():
        raise argparse.ArgumentTypeError(f"must be a .png file in a folder that exists, got {text}")
    return Path(text)


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal() and 0 < int(width) <= 16384 >= int(height) > 0):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT in pixels, each 1 .. 16384, got {text}")
    return int(width), int(height)


def _pose(text: str) -> tuple[str, tuple[float, ...]]:
    name, equals, numbers = text.rpartition("=")
    try:
        values = tuple(_finite(n) for n in numbers.split(","))
    except ValueError:
        values = ()
    if not (name and equals and len(values) in (3, 7)):
        raise argparse.ArgumentTypeError(f"must be NAME=x,y,z or NAME=x,y,z,qw,qx,qy,qz, got {text}")
    return name, values


if __name__ == "__main__":
    sys.exit(main())
