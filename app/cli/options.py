"""Option groups that commands share: scene, light, picture, measuring. A command takes the options that it reads."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from app.cli import values
from app.cli.version import version
from app.settings import LIGHTS, SHOWS, TONE_MAPS, Settings, check_names

SCENE = {
    "mobiles": {"action": "append", "default": [], "metavar": "FILE", "help": "mesh file that becomes a mobile"},
    "poses": {"action": "append", "default": [], "type": values.pose, "metavar": "NAME=x,y,z[,qw,qx,qy,qz]",
              "help": "position of a mobile [m]; without a unit quaternion its rotation stays"},
    "max_edge": {"type": values.positive, "metavar": "M", "help": "longest edge; longer ones are split [m]"},
    "up": {"choices": ["x", "y", "z"], "help": "axis that points up, instead of the file's"},
    "allow_outside": {"action": "store_true", "help": "the scene may name files outside its folder"},
}  # fmt: skip
LIGHT = {
    "estimator": {"metavar": "NAME", "help": "estimator of irradiance; `gi-viewer info` lists them (tangent_plane)"},
    "photons": {"type": values.positive_int, "metavar": "N",
                "help": "photons to trace, 1e6 is allowed (the scene's, else chosen)"},
    "radius": {"type": values.positive, "metavar": "M",
               "help": "radius of discs, largest radius of photon_map [m] (the scene's, else chosen)"},
    "neighbours": {"type": values.positive_int, "metavar": "K",
                   "help": "hits per estimate of photon_map (the scene's, else chosen)"},
    "control": {"action": "store_false",
                "help": "tangent_plane without artifact control: faster; corners are dark, walls leak light"},
    "border_correction": {"action": "store_false",
                          "help": "photon_map without alpha / 2 pi at borders, which are then dark"},
    "textbook": {"action": "store_true", "help": "photon_map counts the k-th hit too: k / (k - 1) times the light"},
    "search": {"default": Settings.search, "metavar": "NAME",
               "help": f"disc search of tangent_plane; pictures do not depend on it ({Settings.search})"},
    "light": {"choices": LIGHTS,
              "help": "best: gathered along paths, on mobiles per frame and on the static part at rest (render waits"
                      " minutes for it); photons: the estimator alone, as in the report (photons with --estimator,"
                      " else best without that wait)"},
    "seed": {"type": values.seed, "default": 0, "metavar": "N", "help": "seed of the photons (0)"},
}  # fmt: skip
PICTURE = {
    "size": {"type": values.size, "default": Settings.size, "metavar": "WxH",
             "help": f"pixels ({Settings.size[0]}x{Settings.size[1]})"},
    "exposure": {"type": values.exposure, "metavar": "EV",
                 "help": "stops; +1 doubles the brightness (the scene's, else metered)"},
    "white_balance": {"action": "store_false", "help": "draw coloured lamps coloured instead of neutral"},
    "tone_map": {"choices": TONE_MAPS, "default": Settings.tone_map, "help": f"({Settings.tone_map})"},
    "show": {"choices": SHOWS, "default": Settings.show,
             "help": f"with reflectance, without, or false colours of irradiance with a legend ({Settings.show})"},
    "illuminance_range": {"type": values.value_range, "metavar": "LOW,HIGH",
                          "help": "ends of the false colours [lx or W/m2]; a logarithmic scale if HIGH is 30 LOW or"
                                  " more (that of the view)"},
    "cull": {"action": "store_false", "help": "draw the backs of one-sided faces too, dark grey"},
}  # fmt: skip
FLAGS = {"mobiles": "mobile", "poses": "pose"}  # options whose name differs from their field of Settings


def scene(parser: argparse.ArgumentParser) -> None:
    """Add SCENE and the options that change it, and --version."""
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    add = parser.add_argument_group("scene").add_argument
    add("scene", nargs="?", default="cornell", metavar="SCENE", help="shipped name, .toml or mesh file (cornell)")
    _add(add, SCENE)


def light(parser: argparse.ArgumentParser, *fields: str) -> None:
    """Add the options of these fields of Settings; all that change light without any."""
    _add(parser.add_argument_group("light").add_argument, LIGHT, fields)


def picture(parser: argparse.ArgumentParser, *fields: str) -> None:
    """Add the options of these fields of Settings; all that change pictures without any."""
    _add(parser.add_argument_group("picture").add_argument, PICTURE, fields)


def measuring(parser: argparse.ArgumentParser) -> Callable:
    """Return the function that adds an option of one command alone."""
    return parser.add_argument_group("measuring").add_argument


def budget(add: Callable, off: str) -> None:
    """Add --budget; `off` explains the value 0."""
    add("--budget", type=values.not_negative, default=Settings.budget, metavar="MS",
        help=f"time for light per frame in motion, with the photons that fit{off} ({Settings.budget:g})")  # fmt: skip


def _add(add: Callable, table: dict, fields=()) -> None:
    for field in fields or table:
        no = "no-" if table[field].get("action") == "store_false" else ""
        add(f"--{no}{FLAGS.get(field, field).replace('_', '-')}", dest=field, **table[field])


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Return the settings of parsed arguments. Raises UsageError for an unknown estimator or search."""
    given = {name: value for name, value in vars(arguments).items() if name in Settings.__dataclass_fields__}
    settings = Settings(**given | {name: tuple(given[name]) for name in ("mobiles", "poses")})
    check_names(settings)
    return settings


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        print(f"gi-viewer {version()}")
        parser.exit()
