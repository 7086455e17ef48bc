"""Scene files in TOML 1.0, and the meshes that they name."""

import json
import math
import string
from functools import partial

from gi_core.bsdf.models import MODELS
from tests.support.grammar.choices import Files, Grammar
from tests.support.grammar.gltf import gltf, material_names
from tests.support.grammar.obj import obj
from tests.support.grammar.ply import ply


def _toml_text(g: Grammar, text: str) -> str:
    plain = all(c.isprintable() for c in text)
    if plain and "'" not in text and g.chance(0.3):
        return g.pick(f"'{text}'", f"'''{text}'''", f"'''\n{text}'''")
    body = json.dumps(text, ensure_ascii=g.chance(0.5) and text.isascii())[1:-1].replace("\x7f", "\\u007f")
    return g.pick(f'"{body}"', f'"{body}"', f'"""{body}"""', f'"""\\\n   {body}"""')


def _toml_value(g: Grammar, value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _toml_text(g, value)
    if isinstance(value, int):
        return g.pick(
            str(value), str(value), f"{value:_}", *([hex(value), oct(value), bin(value)] if value >= 0 else [])
        )
    if isinstance(value, float):
        if not math.isfinite(value):
            return g.pick("", "+") * (value > 0) + str(value)
        return g.pick(repr(value), f"{value:.6e}", f"{value:+.4f}" if abs(value) < 1e15 else repr(value))
    if isinstance(value, list):
        gap = g.pick("", " ", "\n  ", " # a comment\n")
        return (
            "["
            + gap
            + ("," + gap).join(_toml_value(g, v) for v in value)
            + (g.pick("", ",") if value else "")
            + gap
            + "]"
        )
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_toml_key(g, k)} = {_toml_value(g, v)}" for k, v in value.items()) + "}"
    return g.pick(
        "1979-05-27T07:32:00Z", "1979-05-27", "07:32:00", "2000-02-30" if g.chance(0.1) else "1979-05-27 07:32:00.5"
    )


def _toml_key(g: Grammar, key: str) -> str:
    if key and all(c in string.ascii_letters + string.digits + "_-" for c in key) and g.chance(0.9):
        return key
    return g.pick(json.dumps(key, ensure_ascii=False).replace("\x7f", "\\u007f"), json.dumps(key))


def _toml_table(g: Grammar, path: str, table: dict, many: bool = False) -> list[str]:
    """A table in one of its spellings: a header with keys, dotted keys within it, or sub-tables after it."""
    lines, later = [f"[[{path}]]" if many else f"[{path}]"], []
    for key, value in table.items():
        if isinstance(value, dict) and value and g.chance(0.7):
            if g.chance(0.5):
                later += _toml_table(g, f"{path}.{_toml_key(g, key)}", value)
            else:
                lines += [
                    f"{_toml_key(g, key)}{g.pick('.', ' . ')}{_toml_key(g, k)} = {_toml_value(g, v)}"
                    for k, v in value.items()
                ]
        elif isinstance(value, list) and value and all(isinstance(v, dict) for v in value) and g.chance(0.5):
            later += [line for v in value for line in _toml_table(g, f"{path}.{_toml_key(g, key)}", v, many=True)]
        else:
            written = f"{_toml_key(g, key)}{g.pick(' = ', '=')}{_toml_value(g, value)}"
            lines.append(g.pick("", "", "  ") + written + g.pick("", "", " # why"))
    return [*lines, *g.pick([], [""]), *later]


def _some(g: Grammar, must: dict, may: dict) -> dict:
    """All keys of `must`, some of `may`, in any order; seldom one is absent, misspelt or odd."""
    entries = list(must.items()) + [item for item in may.items() if g.chance(0.5)]
    g.rng.shuffle(entries)
    table = {}
    for key, value in entries:
        if g.chance(g.oddity / 4):
            continue
        table[g.pick(key + "s", key[1:], key.upper()) if g.chance(g.oddity / 4) else key] = g.leaf(value)
    if g.chance(g.oddity / 4):
        table[g.name()] = g.odd(1)
    return table


def mesh(g: Grammar, files: Files, stem: str) -> tuple[str, list[str]]:
    """Any mesh file, added to `files`: its name, and names of materials that it may have."""
    kind = g.pick("obj", "obj", "ply", "glb", "gltf")
    if kind == "obj":
        name = obj(g, files, stem)
        used = [
            line.split(None, 1)[1]
            for line in files[name].decode("utf-8", "replace").splitlines()
            if line.strip().startswith("usemtl ")
        ]
        return name, used or ["default"]
    if kind == "ply":
        return ply(g, files, stem), [stem]
    name = gltf(g, files, stem, kind == "glb")
    return name, material_names(files[name])


def _model(g: Grammar, name: str) -> dict:
    """Some parameters of a model of reflection, in the ranges of its document."""

    def number(rule) -> float:
        return min(max(g.real(rule.low, rule.high), rule.low), rule.high)

    def value(rule) -> float | list[float]:
        return [number(rule) for _ in range(3)] if rule.colour and g.chance(0.5) else number(rule)

    return _some(g, {}, {key: value(rule) for key, rule in MODELS[name].PARAMETERS.items()})


def _material(g: Grammar, dark: bool) -> dict:
    """A table [materials.NAME]: a colour, gloss by roughness, a model of reflection, or a combination of them."""
    may = {"emission": g.reals(3, 0.0, 0.0 if dark else 20.0), "two_sided": g.chance(0.5)}
    kind, name = g.pick("colour", "gloss", "model", "combination"), g.pick(*MODELS)
    colour = {"reflectance": [min(v, 0.9) for v in g.reals(3, 0.0, 0.9)]}
    if kind == "colour":
        return _some(g, {}, may | colour)
    if kind == "gloss":
        gloss = {"metallic": g.real(0.0, 1.0), "ior": g.real(1.0, 3.0)}
        return _some(g, {"roughness": g.real(0.0, 1.0)}, may | colour | gloss)
    may |= {"grain": [1.0, *g.reals(2)]}
    if kind == "model":
        return _some(g, {"brdf": name, "scale": True}, may) | _model(g, name)
    names = [g.pick(*MODELS) for _ in range(g.rng.randint(1, 3))]
    parts = [_some(g, {"model": n, "factor": g.real(0.0, 0.3)}, {}) | _model(g, n) for n in names]
    return _some(g, {"brdf": parts, "scale": True}, may)


def toml(g: Grammar, files: Files, stem: str) -> str:
    """One scene file and the meshes that it names, added to `files`; its name."""
    room, materials = mesh(g, files, "room")
    g.dark = True
    stool, _ = mesh(g, files, "stool")
    g.dark = False
    direction = g.reals(3, 0.2, 1.0)
    static = _some(
        g,
        {"mesh": g.pick(room, [room], [room, room], [room, stool])},
        {"scale": g.real(0.5, 2.0), "max_edge": g.real(0.5, 2.0)},
    )
    half = math.sqrt(0.5)
    mobiles, lights = [], []
    for i in range(g.pick(0, 1, 1, 2)):
        place = g.pick({}, {"position": g.reals(3)}, {"axis": direction}, {"rotation": [half, 0, half, 0]})
        path = _some(
            g, {"times": [0, 1.5, 4], "positions": [g.reals(3) for _ in range(3)]}, {"spin": 90, "spin_axis": direction}
        )
        extra = (
            place
            | {"scale": g.real(0.5, 1.5), "max_edge": g.real(0.5, 1.0)}
            | ({"path": path} if g.chance(0.3) else {})
        )
        mobile = _some(g, {"name": f"stool {i}", "mesh": stool}, extra)
        mobiles.append(mobile | ({"angle": g.leaf(g.real(0.0, 90.0))} if "axis" in mobile else {}))
    for i in range(g.pick(0, 1, 1, 3)):
        colour = g.reals(3, 0.0, 50.0)
        kinds = {
            "point": {"position": g.reals(3), "flux": colour},
            "directional": {"direction": direction, "irradiance": colour, "disc_degrees": g.real(0.0, 90.0)},
        }
        kinds |= {
            "spot": {
                "position": g.reals(3),
                "direction": direction,
                "intensity": colour,
                "outer_degrees": g.real(10.0, 80.0),
            }
        }
        kinds |= {"sky": {"radiance": colour, "cie": g.pick(1, 5, 12, 16), "sun": direction}}
        kinds["panel"] = {"position": g.reals(3), "direction": direction, "flux": colour, "size": [0.5, 0.2]}
        kind = g.pick(*kinds)
        lights.append(
            _some(
                g,
                {"type": kind} | kinds[kind],
                {"name": f"lamp {i}"} | ({"inner_degrees": 5} if kind == "spot" else {}),
            )
        )
    shapes, long = [], partial(g.real, 0.6, 2.0)
    for i in range(g.pick(0, 0, 1, 2)):
        solids = {"sphere": {"radius": long()}, "cone": {"radius": long(), "height": long(), "top": long()}}
        solids |= {"box": {"size": g.reals(3, 0.6, 2.0)}, "plane": {"size": g.reals(2, 0.6, 2.0)}}
        solids["extrusion"] = {"outline": [[0, 0], [long(), 0], [2, 1], [0, 0.5]], "height": long()}
        hole = {"wall": g.pick("left", "back", "ceiling"), "position": [-0.2, 0.1], "size": [0.3, 0.2]}
        solids["room"] = {"size": g.reals(3, 0.6, 3.0), "openings": [hole], "thickness": long()}
        kind = g.pick(*solids)
        may = {"name": f"shape {i}", "mobile": g.chance(0.5), "position": g.reals(3), "max_edge": long()}
        shapes.append(_some(g, {"type": kind} | solids[kind], may))
    top = {"title": g.name(), "up": g.pick("x", "y", "z", direction), "units": g.pick("radiometric", "photometric")}
    lines = [f"{_toml_key(g, k)} = {_toml_value(g, v)}" for k, v in _some(g, {}, top).items()]
    parts = [_toml_table(g, "static", static)]
    parts += [_toml_table(g, "shape", shape, many=True) for shape in shapes]
    parts += [_toml_table(g, "light", light, many=True) for light in lights]
    if g.chance(0.2):
        when = {"place": g.pick([40.4, -3.7], [-90, 180]), "date": "2026-03-21", "hour": g.pick(0, 9.5, 23)}
        clear = {"turbidity": g.pick(1, 2.5, 10), "north": [direction[1], -direction[0], 0.1], "sky": g.pick(5, 15)}
        parts.append(_toml_table(g, "daylight", _some(g, when | {"utc_offset": g.pick(0, 5.5, -3)}, clear)))
    if g.chance(0.6):
        name = g.pick(*materials)
        parts.append(_toml_table(g, f"materials.{_toml_key(g, str(name))}", _material(g, dark=bool(mobiles))))
    if mobiles and g.chance(0.3):
        mobiles[0]["material"] = g.leaf("varnish")
        parts.append(_toml_table(g, "materials.varnish", _material(g, dark=True)))
    parts += [_toml_table(g, "mobile", m, many=True) for m in mobiles]
    if g.chance(0.4):
        parts.append(
            _toml_table(
                g,
                "camera",
                _some(g, {"position": g.reals(3), "target": g.reals(3, 3.0, 4.0)}, {"fov": g.real(20.0, 90.0)}),
            )
        )
    if g.chance(0.3):
        parts.append(
            _toml_table(
                g, "probe", _some(g, {"name": "desk", "position": g.reals(3), "normal": direction}, {}), many=True
            )
        )
    if g.chance(0.3):
        place = {"position": g.reals(2), "size": g.reals(2, 0.5, 2.0), "tilt": g.real(0.0, 180.0), "turn": g.real()}
        may = g.pick(place, {"on": "stool 0"}) | {"height": g.real(), "margin": 0.1, "points": [3, 4]}
        table = _some(
            g,
            {"name": "desk"},
            may
            | {
                "targets": {"mean": g.real(1.0, 500.0)},
                "quantity": g.pick("daylight factor", "cylindrical illuminance"),
            },
        )
        parts.append(_toml_table(g, "surface", table, many=True))
    if g.chance(0.3):
        settings = {
            "photons": 1000,
            "radius": 0.1,
            "neighbours": 20,
            "estimator": g.pick("tangent_plane", "photon_map", "impact_count"),
        }
        parts.append(
            _toml_table(g, "defaults", _some(g, {}, settings | {"exposure": g.real(), "scene_size": g.real(1.0, 5.0)}))
        )
    g.rng.shuffle(parts)
    if g.chance(g.oddity):
        lines += g.pick(
            ["a." * 300 + "b = 1"],
            ["a = " + "[" * 150 + "]" * 150],
            ["a = " + "{b=" * 90 + "1" + "}" * 90],
            ["a = 1", "a.b = 2"],
            ["= 1"],
        )
    text = "\n".join([*lines, *(line for part in parts for line in part)])
    files[f"{stem}.toml"] = (g.pick("", "", "# a scene\n") + text.replace("\n", g.pick("\n", "\n", "\r\n"))).encode(
        "utf-8", "surrogatepass"
    )
    return f"{stem}.toml"
