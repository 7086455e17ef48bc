"""Option groups that commands share: scene, light, picture, measuring. A command takes the options that it reads."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

from app import values
from app.cli.saved_scene import opened
from app.cli.version import version
from app.settings import (
    BUDGET,
    OPTIONS,
    SECONDS,
    Display,
    Lighting,
    Method,
    Settings,
    Source,
    Tracing,
    check_names,
    flag_of,
    named,
)  # fmt: skip

LIGHT = (*named(Method), *named(Lighting), *named(Tracing))  # in the order of --help


def scene(parser: argparse.ArgumentParser) -> None:
    """Add SCENE and the options that change it, and --version."""
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    add = parser.add_argument_group("scene").add_argument
    add("scene", nargs="?", default="cornell", metavar="SCENE", help="shipped name, .toml or mesh file (cornell)")
    _add(add, *named(Source))
    add(
        "--daylight", dest="edits", action="append", type=values.daylight, default=argparse.SUPPRESS, metavar="KEYS",
        help="sun and sky: keys of [daylight], such as 'place = [40.4, -3.7], date = 2026-03-21, hour = 9, "
        "utc_offset = 1'; those of the scene stay otherwise",
    )  # fmt: skip


def light(parser: argparse.ArgumentParser, *fields: str) -> None:
    """Add the options of these fields of Settings; all that change light without any."""
    _add(parser.add_argument_group("light").add_argument, *(fields or LIGHT))


def picture(parser: argparse.ArgumentParser, *fields: str) -> None:
    """Add the options of these fields of Settings; all that change pictures without any."""
    _add(parser.add_argument_group("picture").add_argument, *(fields or named(Display)))


def surface(add: Callable) -> None:
    """Add --surface, and the options of numbers of surfaces."""
    _add(add, "surfaces", "watts", "maintenance_factor", "hold")


def measuring(parser: argparse.ArgumentParser) -> Callable:
    """Return the function that adds an option of one command alone."""
    return parser.add_argument_group("measuring").add_argument


def budget(add: Callable, off: str) -> None:
    """Add --budget; `off` explains the value 0."""
    text = f"time for light per frame in motion, with the photons that fit{off} ({BUDGET:g})"
    _add(add, "budget", help=text)


def error(add: Callable) -> None:
    """Add --error, the noise [%] at which path tracing stops."""
    text = "stop at this noise, relative to the light [%%] (1)"
    add("--error", type=values.percent, default=1.0, metavar="PCT", help=text)


def seconds(add: Callable) -> None:
    """Add --seconds."""
    text = f"time for gathering light, as the window does at rest; 0: none, and always the same bytes ({SECONDS:g})"
    add("--seconds", type=values.not_negative, metavar="S", help=text)


def _add(add: Callable, *names: str, **changes: str) -> None:
    """Add options; those that are not written are absent, so that a saved scene may give them."""
    for name in names:
        add(flag_of(name), dest=name, **{**OPTIONS[name].option, **changes, "default": argparse.SUPPRESS})


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Return the settings of parsed arguments, over those of a saved scene.

    Raises UsageError for an unknown estimator or search, SceneError for a bad saved scene.
    """
    chosen = {name: value for name, value in vars(arguments).items() if name in Settings.__dataclass_fields__}
    settings = opened(Settings(scene=chosen.pop("scene")), chosen.get("allow_outside", False))
    for name in ("mobiles", "poses", "lamps", "watts", "surfaces", "edits"):
        if name in chosen:
            before = () if name in ("mobiles", "surfaces") else getattr(settings, name)
            chosen[name] = (*before, *chosen[name])
    settings = replace(settings, **chosen)
    check_names(settings)
    return settings


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        print(f"gi-viewer {version()}")
        parser.exit()
