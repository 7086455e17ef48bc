"""The command line: `gi-viewer [SCENE]`, and the commands that need no window.

Nothing heavy is imported before the arguments are known to be good: `--help` answers at once.
Exit codes: 0 done, 2 usage, 3 the scene cannot be used, 4 no OpenGL window (only with --no-fallback).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from app.cli import options, values
from app.cli.parser import Parser, did_you_mean
from app.cli.version import version
from app.settings import LIGHTS, Settings, UsageError, check_names

OK, USAGE, SCENE, NO_GL = 0, 2, 3, 4
FALLBACK_PICTURE = "gi-viewer.png"

ABOUT = "Real-time global illumination: drag an object and shadow, colour bleeding and its own shading follow."
COMMANDS = {
    "render": "draw one picture, or --frames along the mobile's path, without a window",
    "bench": "move the mobile along its path and time every frame",
    "tune": "try settings on this scene and machine and say which suit a frame time or an error best",
    "info": "say what is in a scene, which defaults are chosen, and why",
    "reference": "gather the unbiased light of a scene and keep it; goes on with a run that was stopped",
    "chart": "error against frame time of many settings: table, chart and page; goes on with a run that was stopped",
}

ATLAS = "where each method fails, what theory predicts, what is measured, what helps: a page"


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
    except KeyboardInterrupt as stop:
        return _fail(str(stop) or "stopped", 130)


def parse(argv: list[str]) -> argparse.Namespace:
    """Return the checked arguments; `.run(arguments)` carries them out. Raises SystemExit like argparse."""
    if argv and argv[0] == "atlas":
        return _atlas_parser().parse_args(argv[1:])
    if argv and argv[0] in COMMANDS:
        return _command_parser(argv[0]).parse_args(argv[1:])
    parser = _view_parser()
    if argv and not argv[0].startswith("-") and not Path(argv[0]).suffix and len(argv) > 1:
        # Two words of which the first is no command: it may have been meant as one.
        meant = did_you_mean(argv[0], [*COMMANDS, "atlas"])
        if meant and not argv[1].startswith("-"):
            parser.error(f"there is no command {argv[0]}; did you mean {meant[0]}?")
        if Path(argv[1]).suffix.lower() in values.SCENES and not _is_scene(argv[0]):
            parser.error(f"there is no command {argv[0]}; there are {', '.join([*COMMANDS, 'atlas'])}")
    return parser.parse_args(argv)


def _is_scene(name: str) -> bool:
    from gi_core.files.find import shipped_scenes

    return Path(name).exists() or name in shipped_scenes()


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Return the record that everything behind the command line works from. Raises UsageError for an unknown name."""
    given = {name: getattr(arguments, name) for name in Settings.__dataclass_fields__ if hasattr(arguments, name)}
    given["mobiles"], given["poses"] = tuple(given["mobiles"]), tuple(given["poses"])
    settings = Settings(**given)
    check_names(settings)
    return settings


def _view_parser() -> argparse.ArgumentParser:
    lines = [f"  gi-viewer {name} SCENE   {what}" for name, what in COMMANDS.items()]
    lines.append(f"  gi-viewer atlas --out DIR   {ATLAS}")
    epilog = "commands without a window (each has its own --help):\n" + "\n".join(lines)
    parser = Parser(
        prog="gi-viewer", description=ABOUT, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    _add_common(parser)
    options.picture(parser)
    parser.add_argument(
        "--no-fallback",
        dest="fallback",
        action="store_false",
        help=f"fail with code {NO_GL} where no window can be opened, instead of drawing ./{FALLBACK_PICTURE}",
    )
    options.budget(parser, "; 0: always all")
    parser.add_argument(
        "--screenshot",
        type=values.png,
        metavar="FILE.png",
        help="save the whole window once its light is refined, and quit",
    )
    parser.set_defaults(run=_view)
    return parser


def _command_parser(name: str) -> argparse.ArgumentParser:
    parser = Parser(prog=f"gi-viewer {name}", description=COMMANDS[name])
    _add_common(parser)
    if name == "render":
        options.picture(parser)
        parser.add_argument("--out", type=Path, metavar="FILE.png", help=f"the picture ({FALLBACK_PICTURE})")
        parser.add_argument(
            "--frames", type=values.positive_int, metavar="N", help="N pictures along the path: FILE.0001.png and so on"
        )
    if name == "bench":
        options.bench(parser)
    if name == "tune":
        options.tune(parser)
    if name == "reference":
        options.reference(parser)
    if name == "chart":
        options.chart(parser)
    run = {"render": _render, "bench": _bench, "tune": _tune, "info": _info, "reference": _reference, "chart": _chart}
    parser.set_defaults(run=run[name])
    return parser


def _atlas_parser() -> argparse.ArgumentParser:
    parser = Parser(prog="gi-viewer atlas", description=ATLAS)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where index.html and atlas.md go")
    parser.set_defaults(run=_atlas)
    return parser


def _add_common(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", nargs="?", default="cornell", metavar="SCENE", help="built-in name, .toml or mesh file (cornell)")
    add("--mobile", dest="mobiles", action="append", default=[], metavar="FILE", help="add a mesh file as a mobile")
    add("--pose", dest="poses", type=values.pose, action="append", default=[], metavar="NAME=x,y,z[,qw,qx,qy,qz]",
        help="put a mobile somewhere [m], with a unit quaternion or turned as it is")  # fmt: skip
    add("--estimator", metavar="NAME", help="how light is gathered; `gi-viewer info` lists the names (tangent_plane)")
    add(
        "--photons",
        type=values.positive_int,
        metavar="N",
        help="photons to trace, 1e6 is allowed (scene's, else chosen)",
    )
    add("--radius", type=values.positive, metavar="M", help="disc radius or largest search radius [m]")
    add("--neighbours", type=values.positive_int, metavar="K", help="hits that photon_map averages over")
    add("--no-control", dest="control", action="store_false",
        help="tangent_plane without artifact control: faster, dark in corners, and walls leak")  # fmt: skip
    add(
        "--no-border-correction",
        dest="border_correction",
        action="store_false",
        help="photon_map without alpha / 2 pi at borders: they turn dark, and surfaces that meet light each other",
    )
    add("--textbook", action="store_true", help="photon_map counts the k-th hit too: k / (k - 1) brighter")
    add("--search", default=Settings.search, metavar="NAME",
        help=f"how tangent_plane finds what crosses discs, the picture is the same ({Settings.search})")  # fmt: skip
    add("--light", choices=LIGHTS,
        help="best: gathered along paths, by mobiles in each frame and by the static part at rest (render: before the"
        " first picture, minutes); photons: the estimator alone, as in the report (photons with --estimator, else best"
        " without that wait)")  # fmt: skip
    add("--seed", type=values.seed, default=0, metavar="N", help="which photons (0)")
    add("--exposure", type=values.exposure, metavar="EV", help="stops, +1 doubles (the scene's, else metered)")
    add("--max-edge", type=values.positive, metavar="M", help="cut triangles until no edge is longer [m]")
    add("--up", choices=["x", "y", "z"], help="which axis points up, instead of the file's")
    add("--allow-outside", action="store_true", help="let the scene name files outside its own folder")
    add("--version", action=_Version, nargs=0, help="print the version")


def _view(arguments: argparse.Namespace) -> int:
    settings = settings_of(arguments)
    from app.window.window import why_no_window

    reason = why_no_window()
    if reason is None:
        from app.window.viewer import run

        return run(settings, screenshot=arguments.screenshot)
    if not settings.fallback:
        return _fail(reason, NO_GL)
    from app.commands.render import render
    from app.settings import open_scene

    open_scene(settings)  # what is wrong with the scene is told first, and alone
    print(f"gi-viewer: no window, so a picture is drawn into a file: {reason}", file=sys.stderr, flush=True)
    (path,) = render(settings, arguments.screenshot or Path(FALLBACK_PICTURE))
    print(f"The picture is in {path}")
    return OK


def _render(arguments: argparse.Namespace) -> int:
    from app.commands.render import render

    out = arguments.out or Path(FALLBACK_PICTURE)
    replaced = arguments.out is None and arguments.frames is None and out.exists()
    for path in render(settings_of(arguments), out, arguments.frames):
        print(path)
    if replaced:
        print(f"gi-viewer: the {out} that was there is replaced; --out FILE.png names another", file=sys.stderr)
    return OK


def _bench(arguments: argparse.Namespace) -> int:
    from app.measure.bench.command import run

    run(arguments, settings_of(arguments))
    return OK


def _tune(arguments: argparse.Namespace) -> int:
    from app.commands.tune import tuned_lines

    print("\n".join(tuned_lines(settings_of(arguments), arguments.error, arguments.check)))
    return OK


def _atlas(arguments: argparse.Namespace) -> int:
    from app.measure.atlas.command import atlas

    atlas(arguments.out)
    print((arguments.out / "atlas.md").read_text(encoding="utf-8"))
    return OK


def _info(arguments: argparse.Namespace) -> int:
    from app.measure.scene_info import info

    print("\n".join(info(settings_of(arguments))))
    return OK


def _reference(arguments: argparse.Namespace) -> int:
    from app.commands.reference import reference

    reference(settings_of(arguments), arguments.error / 100)
    return OK


def _chart(arguments: argparse.Namespace) -> int:
    a = arguments
    if a.atlas:
        return _atlas(a)
    from app.measure.chart.command import chart

    print(chart(settings_of(a), a.out, a.quick, a.frames, a.points))
    return OK


def _fail(error: object, code: int) -> int:
    """Say what is wrong in one line on stderr."""
    print("gi-viewer: " + " ".join(str(error).split()), file=sys.stderr)
    return code


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        print(f"gi-viewer {version()}")
        parser.exit()


if __name__ == "__main__":
    sys.exit(main())
