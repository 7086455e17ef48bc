"""Options that commands share, and the settings that they make."""

from __future__ import annotations

import argparse

from app.cli import values
from app.cli.version import version
from app.settings import LIGHTS, SHOWS, TONE_MAPS, Settings, check_names


def picture(parser: argparse.ArgumentParser) -> None:
    """Add what pictures take."""
    add = parser.add_argument
    default = "x".join(map(str, Settings.size))
    add("--size", type=values.size, default=Settings.size, metavar="WxH", help=f"pixels ({default})")
    add("--tone-map", choices=TONE_MAPS, default=Settings.tone_map, help=f"({Settings.tone_map})")
    add("--show", choices=SHOWS, default=Settings.show, help="with reflectance, or irradiance alone (radiance)")
    add("--no-cull", dest="cull", action="store_false", help="draw the backs of one-sided faces too, dark grey")


def budget(parser: argparse.ArgumentParser, off: str) -> None:
    """Add --budget; `off` says what 0 means."""
    parser.add_argument(
        "--budget",
        type=values.not_negative,
        default=Settings.budget,
        metavar="MS",
        help=f"what light may take while something moves, with as many photons as fit{off} ({Settings.budget:g})",
    )


def common(parser: argparse.ArgumentParser) -> None:
    """Add those of every command that opens a scene."""
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


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Return the record that everything behind the command line works from. Raises UsageError for an unknown name."""
    given = {name: getattr(arguments, name) for name in Settings.__dataclass_fields__ if hasattr(arguments, name)}
    given["mobiles"], given["poses"] = tuple(given["mobiles"]), tuple(given["poses"])
    settings = Settings(**given)
    check_names(settings)
    return settings


class _Version(argparse.Action):
    def __call__(self, parser, namespace, values, option_string=None):
        print(f"gi-viewer {version()}")
        parser.exit()
