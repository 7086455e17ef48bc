"""The reflection of the selected surface: its model, or a linear combination of some, and their parameters."""

from __future__ import annotations

import functools
import math
from typing import Any

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.bsdf.models import MODELS, lobe
from gi_core.bsdf.models.common import Parameter
from gi_core.files.edits import Values
from gi_core.files.formats.materials_table import IOR
from gi_core.geometry.texture_filter import MOST_REFLECTANCE

COLOUR_FLAGS = imgui.ColorEditFlags_.float | imgui.ColorEditFlags_.no_options
DIFFUSE, METAL_ROUGH = "diffuse", "metal-rough"
DARKENED = "Darkened: it would reflect more light than arrives."
COLOURS = "reflectance", "kd", "rho", "C"  # parameters that carry on the colour of another model


@functools.cache
def models() -> dict[str, dict[str, Parameter]]:
    """Return the parameters of each model, by name."""
    colour = Parameter((0.5, 0.5, 0.5), 0.0, MOST_REFLECTANCE, True, "share of light reflected, linear")
    metal_rough = {
        "reflectance": colour._replace(meaning="base colour, linear: of the metal, or under the gloss"),
        "metallic": Parameter(0.0, 0.0, 1.0, False, "0: gloss over a diffuse base, 1: metal"),
        "roughness": Parameter(0.3, 0.0, 1.0, False, "0: a mirror, 1: matte"),
        "ior": Parameter(IOR, 1.0, 3.0, False, "refractive index of the gloss; metal has none"),
    }
    tabulated = {name: model.PARAMETERS for name, model in MODELS.items()}
    return {DIFFUSE: {"reflectance": colour}, METAL_ROUGH: metal_rough, **tabulated}


def draw(s: Settings, window: Window, actions: set[Any]) -> Settings:
    surface, parts, part = window.viewport.surface, window.viewport.parts, window.viewport.part
    finish = window.viewport.finish
    if not surface or not finish.values:
        imgui.text_disabled("Click on a surface, or select an object.")
        return s
    imgui.text_disabled(title(surface, parts))
    if len(parts) > 1:
        ui.label("Part")
        chosen, k = imgui.combo("##Part", parts.index(part), list(parts))
        ui.tip("Part of the object, by the material in its file. A click on the object chooses it too.")
        if chosen:
            actions.add(("choose part", parts[k]))
            return s
    values = dict(finish.values)
    model = values.get("brdf") or (METAL_ROUGH if "roughness" in values else DIFFUSE)
    combined = isinstance(model, tuple)
    ui.label("Model")
    names = [*models(), *(["combination"] if combined else [])]
    chosen_now = len(names) - 1 if combined else names.index(model)
    changed, k = imgui.combo("##Model", chosen_now, [_title(name) for name in names], len(names))
    ui.tip("Model of reflection. Photons that met the surface are traced again; the picture stays until then.")
    if changed and not (combined and k == chosen_now):
        new_values = starting(names[k], values)
        actions.add(("refinish", surface, part, _kept(new_values) if finish.textured else new_values))
        return s
    edited, keeps = False, finish.textured
    other = None
    if combined:
        removed: list[int] = []
        lobes = tuple(_draw_part(k, lobe, len(model), removed) for k, lobe in enumerate(model))
        edited = lobes != model
        values["brdf"] = lobes
        other = without_model(values, removed[0]) if removed else None
    else:
        for name, parameter in models()[model].items():
            value, moved = _edit(name, parameter, values.get(name, parameter.default))
            if moved:
                values[name], edited = value, True
                keeps &= name != "reflectance"
    if (added := _draw_added(model)) is not None:
        other = with_model(values, added)
    if other is not None:
        actions.add(("refinish", surface, part, other))
        return s
    if "brdf" in values:
        values, moved = _draw_scale(values, finish.darkened)
        edited |= moved
    if finish.textured:
        ui.wrapped(_about_texture(model))
    if edited:
        new_values = tuple(values.items())
        actions.add(("refinish", surface, part, _kept(new_values) if keeps else new_values))
    return s


def with_model(values: dict[str, Any], name: str) -> Values:
    """Return the values of a diffuse material, a model or a linear combination, with one more model in the sum.

    Its Lambertian albedo is at most 1 less those of the others: a sum above is refused.
    """
    parts = _parts(values)
    new: dict[str, Any] = {key: p.default for key, p in models()[name].items()}
    if "kd" in new:
        copies = (dict(part) for part in parts)
        lobes = [lobe(part.pop("model"), factor=part.pop("factor", 1.0), parameters=part) for part in copies]
        room = 1.0 - sum(one.factor * MODELS[one.model].diffuse(one.values()) for one in lobes)
        new["kd"] = tuple(min(math.floor(1e4 * max(float(r), 0.0)) / 1e4, new["kd"]) for r in room)
    return _summed({**values, "scale": True}, (*parts, (("model", name), ("factor", 1.0), *new.items())))


def without_model(values: dict[str, Any], number: int) -> Values:
    """Return the values of a linear combination without one of its models."""
    parts = _parts(values)
    return _summed(values, (*parts[:number], *parts[number + 1 :]))


def _parts(values: dict[str, Any]) -> tuple[Values, ...]:
    """Return the models of a material, each as in a linear combination."""
    model = values.get("brdf", "perfect_diffuse")
    if isinstance(model, tuple):
        return model
    own = {name: values[name] for name in models()[model] if name in values}
    own |= {"kd": values["reflectance"]} if "reflectance" in values else {}
    return ((("model", model), ("factor", 1.0), *own.items()),)


def _summed(values: dict[str, Any], parts: tuple[Values, ...]) -> Values:
    """Return a material of some models; one of factor 1 stands by its name."""
    of_all, first = [(key, values[key]) for key in ("scale", "grain") if key in values], dict(parts[0])
    if len(parts) > 1 or first.pop("factor", 1.0) != 1.0:
        return ("brdf", parts), *of_all
    return ("brdf", first.pop("model")), *of_all, *first.items()


def _draw_added(model: str | tuple) -> str | None:
    """Draw the list of models to add; return the one chosen."""
    with ui.idle("metal-rough is not a reflection model" if model == METAL_ROUGH else ""):
        imgui.set_next_item_width(7 * imgui.get_font_size())
        names = {name: (_title(name), "") for name in models() if name not in (DIFFUSE, METAL_ROUGH)}
        chosen = ui.one_of("Add model", "+ model", names)
        ui.tip("Add a reflection model: the surface then reflects the sum of its models, each times its factor.")
    return chosen


def _draw_part(number: int, values: Values, of: int, removed: list[int]) -> Values:
    """Draw a model of a linear combination; return it with the values of its widgets.

    of: number of models; removed: takes the number of one whose button is pressed.
    """
    part: dict[str, Any] = dict(values)
    imgui.push_id(number)
    right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
    imgui.separator_text(f"{number + 1}. {_title(part['model'])}")
    if of > 1:
        imgui.same_line(right - imgui.calc_text_size("remove").x - 2 * imgui.get_style().frame_padding.x)
        if imgui.small_button("remove"):
            removed.append(number)
        ui.tip("Remove this model from the sum.")
    factor = Parameter(1.0, 0.0, max(1.0, part.get("factor", 1.0)), False, "factor of this model in the sum")
    for name, parameter in ({"factor": factor} | models()[part["model"]]).items():
        value, moved = _edit(name, parameter, part.get(name, parameter.default))
        if moved:
            part[name] = value
    imgui.pop_id()
    return tuple(part.items())


def _draw_scale(values: dict[str, Any], darkened: str) -> tuple[dict[str, Any], bool]:
    """Draw whether a surface is darkened, and whether it needs to be; return the values, and whether that has changed.

    darkened: the reason, "" for none.
    """
    changed, scale = imgui.checkbox("Darken above 100 %", values.get("scale", False))
    ui.tip("Where the models reflect more light than arrives, the surface is darkened to it. Otherwise it is refused. "
           "The choice of a model ticks it.")  # fmt: skip
    if darkened and values.get("scale"):
        ui.wrapped(DARKENED)
        ui.tip(f"{darkened[:1].upper()}{darkened[1:]}.")
    return (values | {"scale": scale} if changed else values), changed


def title(surface: str, parts: tuple[str, ...]) -> str:
    """Return the object and its material by the name in its file; of a piece of the static part, the material."""
    return f'{surface}, material "{parts[0]}"' if len(parts) == 1 else surface


def _kept(values: Values) -> Values:
    """Return values of an edit that keeps the texture: without a reflectance."""
    return tuple((name, value) for name, value in values if name != "reflectance")


def _about_texture(model: str | tuple) -> str:
    if model == DIFFUSE:
        return "Textured: a new reflectance replaces the texture."
    if model == METAL_ROUGH:
        return "Textured: a new reflectance replaces the texture. Metal has its mean colour."
    return "Textured, but this model shows one colour. Diffuse and Metal-rough show the texture."


def starting(model: str, before: dict[str, Any]) -> Values:
    """Return first values of a model, with the colour of values before."""
    values = {name: p.default for name, p in models()[model].items()}
    if isinstance(before.get("brdf"), tuple):
        before = dict(before["brdf"][0])
    colour = next((before[name] for name in COLOURS if name in before), None)
    own = next((name for name in COLOURS if name in values), None)
    if colour is not None and own is not None:
        values[own] = colour
    return tuple(values.items()) if "reflectance" in values else (("brdf", model), ("scale", True), *values.items())


def _title(name: str) -> str:
    """Return a model's name in words: perfect_diffuse, oren_nayar, ggx -> Perfect diffuse, Oren-Nayar, GGX."""
    if name.startswith("perfect"):
        return name.replace("_", " ").capitalize()
    return name.upper() if len(name) == 3 else "-".join(part.capitalize() for part in name.split("_"))


def _edit(name: str, p: Parameter, value: Any) -> tuple[Any, bool]:
    """Draw a parameter; return its value and whether it has been changed.

    The field has float32: a click on a knob may be a change that rounding takes back.
    """
    before = value
    shown = name.capitalize() if len(name) > 3 else {"ior": "IOR"}.get(name, name)
    if p.colour and p.high <= 1:
        rgb = list(value) if isinstance(value, tuple) else [value] * 3
        ui.label(shown)
        changed, rgb = imgui.color_edit3(f"##{name}", rgb, COLOUR_FLAGS)
        value = tuple(min(max(float(f"{c:.4g}"), p.low), p.high) for c in rgb)
    elif p.colour:
        numbers = value if isinstance(value, tuple) else (value,) * 3
        value, changed, _, _ = ui.fields(shown, numbers, 0.01, "%.2f", "rgb")
        value = tuple(min(max(c, p.low), p.high) for c in value)
    else:
        changed, number = ui.slider(shown, value, p.low, p.high, f"{value:.3g}", p.high > 10)
        value = min(max(float(f"{number:.4g}"), p.low), p.high)
    ui.tip(f"{p.meaning[:1].upper()}{p.meaning[1:]}.")
    return value, changed and value != before
