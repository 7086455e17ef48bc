"""Tables of the options that stand for fields of Settings: command line, saved scenes and copied commands read them."""

from __future__ import annotations

from typing import Any

from app.cli import values
from app.settings import GLOSS, LIGHTS, SHOWS, TONE_MAPS, UNITS, Settings

SCENE: dict[str, dict[str, Any]] = {
    "mobiles": {"action": "append", "metavar": "FILE", "help": "mesh file that becomes a mobile"},
    "poses": {"action": "append", "type": values.pose, "metavar": "NAME=x,y,z[,qw,qx,qy,qz]",
              "help": "position of a mobile's origin [m]: that of its mesh in a scene file, the middle of its foot of"
                      " --mobile FILE; without a unit quaternion its rotation stays"},
    "camera": {"type": values.camera, "metavar": "x,y,z,tx,ty,tz,fov",
               "help": "eye and target [m], vertical field of view [degrees]"},
    "max_edge": {"type": values.positive, "metavar": "M", "help": "longest edge; longer ones are split [m]"},
    "up": {"choices": ["x", "y", "z"], "help": "axis that points up, instead of the file's"},
    "units": {"choices": UNITS,
              "help": "photometric: the files' numbers are lm, cd, lx and cd/m2; radiometric: watts (the scene's)"},
    "allow_outside": {"action": "store_true", "help": "the scene may name files outside its folder"},
}  # fmt: skip
LIGHT: dict[str, dict[str, Any]] = {
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
    "search": {"metavar": "NAME",
               "help": f"disc search of tangent_plane; pictures do not depend on it ({Settings.search})"},
    "light": {"choices": LIGHTS,
              "help": "best: gathered along paths, on mobiles per frame and on the static part at rest; photons: the"
                      " estimator alone, as in the report (photons with --estimator, else best)"},
    "gloss": {"choices": GLOSS,
              "help": "rays at glossy vertices: quadtree, summarised in cells of directions; list, one by one;"
                      f" all_rays, one by one where the lobe is bright ({Settings.gloss})"},
    "lamps": {"action": "append", "type": values.lamp, "metavar": "NAME=LEVEL",
              "help": "level of a lamp: 0.5, or r,g,b; `gi-viewer info` lists lamps"},
    "rays": {"metavar": "NAME",
             "help": "structure that traces rays; `gi-viewer info` lists them (embree, or bvh where it is missing)"},
    "seed": {"type": values.seed, "metavar": "N", "help": "seed of the photons (0)"},
}  # fmt: skip
PICTURE: dict[str, dict[str, Any]] = {
    "size": {"type": values.size, "metavar": "WxH",
             "help": f"pixels ({Settings.size[0]}x{Settings.size[1]})"},
    "exposure": {"type": values.exposure, "metavar": "EV",
                 "help": "stops; +1 doubles the brightness (the scene's, else metered)"},
    "white_balance": {"action": "store_false", "help": "draw coloured lamps coloured instead of neutral"},
    "tone_map": {"choices": TONE_MAPS, "help": f"({Settings.tone_map})"},
    "show": {"choices": SHOWS, 
             "help": "with reflectance, without, or false colours with a legend: of the light on surfaces, or of that"
                     f" seen by the camera ({Settings.show})"},
    "illuminance_range": {"type": values.value_range, "metavar": "LOW,HIGH",
                          "help": "ends of the false colours [lx or W/m2]; a logarithmic scale if HIGH is 30 LOW or"
                                  " more (that of the view)"},
    "luminance_range": {"type": values.value_range, "metavar": "LOW,HIGH", "help": "the same [cd/m2 or W/m2/sr]"},
    "isolines": {"type": values.isolines, "metavar": "auto|E1,E2,...",
                 "help": "lines of equal illuminance over its false colours, at round or at given values [lx or W/m2]"},
    "cull": {"action": "store_false", "help": "draw the backs of one-sided faces too, dark grey"},
}  # fmt: skip
WINDOW: dict[str, dict[str, Any]] = {
    "budget": {"type": values.not_negative, "metavar": "MS",
               "help": f"time for light per frame in motion ({Settings.budget:g})"},
}  # fmt: skip
MEASURE: dict[str, dict[str, Any]] = {
    "plane": {"type": values.plane, "metavar": "A0,B0,A1,B1,H[,M,N]",
              "help": "measuring plane: extent along the two horizontal axes, height above the floor [m], points"
                      " (by EN 12464-1)"},
}  # fmt: skip
ALL = SCENE | LIGHT | PICTURE | WINDOW | MEASURE
FLAGS = {"mobiles": "mobile", "poses": "pose", "lamps": "lamp"}  # options named unlike their field of Settings


def flag_of(field: str) -> str:
    """Return the option of a field."""
    no = "no-" if ALL[field].get("action") == "store_false" else ""
    return f"--{no}{FLAGS.get(field, field).replace('_', '-')}"
