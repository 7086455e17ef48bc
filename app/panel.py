"""The panel: settings in, settings out, and the numbers of the frame. It changes nothing itself.

`draw(settings, facts)` returns the settings that the user wants and the actions asked for; the frame compares
and re-enters the work at the first stage that is affected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from imgui_bundle import imgui

from app import theme
from app.settings import SHOWS, TONE_MAPS, Settings
from app.tonemap import luminance

LABEL_EM = 6.2  # width of the column of labels
RADIUS_RANGE = (0.002, 0.2)  # of the scene size
PHOTONS_RANGE = (1_000, 10_000_000)
NEIGHBOURS_RANGE = (2, 1_000)
BUDGET_RANGE = (8, 100)  # [ms]; one beyond it: off
EXPOSURE_MARGIN = 10.0  # EV either way of what was metered at load

TONE_MAP_NAMES = {"aces": "ACES (filmic)", "reinhard": "Reinhard", "clip": "Clip"}
SHOW_NAMES = {"radiance": "With reflectance", "irradiance": "Irradiance only"}


@dataclass(frozen=True)
class Facts:
    """What the panel tells; everything is measured elsewhere."""

    estimators: Mapping[str, str]  # key -> what it is
    scene_size: float  # [m]
    photometric: bool
    gi_seconds: float
    frame_seconds: float
    timings: Mapping[str, float]  # stage -> seconds
    photons_shown: int  # that the picture is made of
    photons_traced: int  # that it is made of at rest
    photons_goal: int
    moving: bool  # something is dragged or played
    segments: int
    photons_cut: int
    old_segments: int
    new_segments: int
    triangles: int
    receivers: int
    mobiles: int
    playing: bool
    metered: float  # EV at load
    probes: Mapping[str, object] = field(default_factory=dict)  # name -> irradiance (3,)
    notes: tuple[str, ...] = ()


def draw(settings: Settings, facts: Facts) -> tuple[Settings, set[str]]:
    """Draw the panel; return settings wanted and actions: "play", "reset view", "reset poses", "meter", ..."""
    actions: set[str] = set()
    settings = _light(settings, facts)
    settings = _picture(settings, facts, actions)
    settings = _motion(settings, facts, actions)
    _timings(facts)
    _paths(facts)
    _probes(facts)
    _notes(facts)
    return settings, actions


def _light(s: Settings, facts: Facts) -> Settings:
    imgui.separator_text("Light")
    keys = list(facts.estimators)
    _label("Estimator")
    if imgui.begin_combo("##Estimator", _title(s.estimator)):
        for k, key in enumerate(keys):
            if imgui.selectable(_title(key), key == s.estimator)[0]:
                s = replace(s, estimator=key)
            _tip(f"{facts.estimators[key]}\nKey {k + 1}")
        imgui.end_combo()
    else:
        _tip(f"How irradiance is estimated from the photons' paths. Nothing is traced again. Keys 1 to {len(keys)}.")

    _label("Photons")
    changed, photons = imgui.slider_int(
        "##Photons", s.photons, *PHOTONS_RANGE, _thousands(s.photons), imgui.SliderFlags_.logarithmic
    )
    if changed:
        s = replace(s, photons=_round(max(photons, 1)))
    _tip("Photons to trace. More: less noise, slower frames. Those traced already are kept.")

    _label("Radius")
    size = facts.scene_size
    low, high = (share * size for share in RADIUS_RANGE)
    percent = f"{100 * s.radius / size:.2g}"
    changed, radius = imgui.slider_float(
        "##Radius", s.radius, low, high, f"%.3g m   ({percent} %%)", imgui.SliderFlags_.logarithmic
    )
    if changed and radius > 0:
        s = replace(s, radius=float(f"{radius:.3g}"))
    _tip(
        "Radius of the disc that gathers light around a point, in metres and as a share of the scene size.\n"
        "Larger: smoother, and shadow edges blur over that length. For photon_map it is the largest radius.\n"
        "Ctrl+click to type a value."
    )

    _label("k")
    changed, k = imgui.slider_int("##k", s.neighbours, *NEIGHBOURS_RANGE, "%d", imgui.SliderFlags_.logarithmic)
    if changed:
        s = replace(s, neighbours=max(k, 1))
    _tip("How many of the nearest photon hits photon_map averages over. The other estimators do not use it.")

    _label("Control")
    changed, control = imgui.checkbox("##Artifact control", s.control)
    if changed:
        s = replace(s, control=control)
    _tip(
        "Artifact control of tangent_plane: light counts only on the part of a disc that it can reach.\n"
        "Off: a little faster, but corners turn dark and light leaks through thin walls."
    )
    return s


def _picture(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    imgui.separator_text("Picture")
    _label("Exposure")
    em = imgui.get_font_size()
    imgui.set_next_item_width(-4.6 * em)
    low, high = facts.metered - EXPOSURE_MARGIN, facts.metered + EXPOSURE_MARGIN
    changed, exposure = imgui.slider_float("##Exposure", s.exposure, low, high, "%+.1f EV")
    if changed:
        s = replace(s, exposure=exposure)
    _tip("Brightness in stops: +1 doubles. Metered once at load, then fixed, so that light that changes shows.")
    imgui.same_line()
    if imgui.button("Meter", (-1, 0)):
        actions.add("meter")
    _tip("Choose the exposure for what is in view now. Key A.")

    s = _choice(s, "Tone map", "tone_map", {k: TONE_MAP_NAMES.get(k, k) for k in TONE_MAPS},
                "How radiance becomes display colour: ACES keeps highlights, Reinhard keeps hue, Clip is exact below "
                "white.")  # fmt: skip
    s = _choice(s, "Show", "show", {k: SHOW_NAMES.get(k, k) for k in SHOWS},
                "With each surface's reflectance, or the irradiance alone, as if everything were white.")  # fmt: skip
    _label("Doll's house")
    changed, cull = imgui.checkbox("##Doll's house", s.cull)
    if changed:
        s = replace(s, cull=cull)
    _tip("Look through the backs of one-sided faces, into closed rooms. Off: those backs are drawn dark grey.")
    return s


def _motion(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    imgui.separator_text("Motion")
    third = (imgui.get_content_region_avail().x - 2 * imgui.get_style().item_spacing.x) / 3
    imgui.begin_disabled(facts.mobiles == 0)
    if imgui.button(("Pause" if facts.playing else "Play") + "###Play", (third, 0)):
        actions.add("play")
    _tip("Move the mobiles along their paths (a circle where the scene gives none). Space.")
    imgui.same_line()
    if imgui.button("Reset pose", (third, 0)):
        actions.add("reset poses")
    _tip("Put every mobile back where it was at the start. Key R also brings the view home.")
    imgui.end_disabled()
    imgui.same_line()
    if imgui.button("Reset view", (third, 0)):
        actions.add("reset view")
    _tip("Bring the camera back to where it was at the start. Home key.")
    _label("Budget")
    low, high = BUDGET_RANGE
    value = round(s.budget) if s.budget > 0 else high + 1
    changed, value = imgui.slider_int("##Budget", value, low, high + 1, "%d ms" if value <= high else "off")
    if changed:
        s = replace(s, budget=float(value) if value <= high else 0.0)
    _tip(
        "What light may take in a frame while something moves: as many photons are used as fit, and all of them "
        "as soon as it rests. Off: always all, however long it takes."
    )
    told = f"{_thousands(facts.photons_shown)} of {_thousands(facts.photons_traced)} photons"
    _number("Moving" if facts.moving else "At rest", told, "Photons that this picture is made of, and all there are.")
    return s


def _timings(facts: Facts) -> None:
    imgui.separator_text("Time")
    fps = f"{1 / facts.frame_seconds:.0f} a second" if facts.frame_seconds > 0 else ""
    whole = f"Everything, drawing and waiting for the screen included: {fps}."
    _number("Whole frame", _ms(facts.frame_seconds), whole)
    gi = _ms(facts.gi_seconds) if facts.gi_seconds > 0 else "nothing moved yet"
    _number("GI", gi, "From new poses to irradiance: the median of the last moves.")
    for stage, seconds in facts.timings.items():
        _number("   " + stage, _ms(seconds), f"The stage '{stage}' of the last light computed.")


def _paths(facts: Facts) -> None:
    imgui.separator_text("Paths")
    _label("Traced")
    share = facts.photons_traced / facts.photons_goal if facts.photons_goal else 1.0
    imgui.progress_bar(min(share, 1.0), (-1, 0), "")
    _write_over(f"{_thousands(facts.photons_traced)} of {_thousands(facts.photons_goal)}")
    _tip(
        f"Photons that the picture is made of at rest, and photons wanted: {_thousands(facts.segments)} path segments."
    )
    n = max(facts.photons_shown, 1)
    _number("Photons cut", f"{_thousands(facts.photons_cut)}   ({100 * facts.photons_cut / n:.2g} %)",
            "Photons whose path through the static scene a mobile blocks: the only ones traced anew.")  # fmt: skip
    _number("Old segments", _thousands(facts.old_segments), "Path segments that the mobiles take out.")
    _number("New segments", _thousands(facts.new_segments), "Path segments that the mobiles put in.")
    _number("Triangles", _thousands(facts.triangles), "Of the static part and the mobiles together.")
    _number("Receivers", _thousands(facts.receivers), "One-sided points where irradiance is computed.")


def _probes(facts: Facts) -> None:
    if not facts.probes:
        return
    imgui.separator_text("Probes")
    unit = "lx" if facts.photometric else "W/m²"
    for name, E in facts.probes.items():
        red, green, blue = (f"{float(c):.4g}" for c in E)
        tip = f"Irradiance at the probe: red {red}, green {green}, blue {blue}."
        _number(name, f"{float(luminance(E)):.4g} {unit}", tip)


def _notes(facts: Facts) -> None:
    if not facts.notes:
        return
    imgui.separator_text("Notes on the scene")
    imgui.push_style_color(imgui.Col_.text, (*theme.DIM, 1.0))
    for note in facts.notes:
        imgui.text_wrapped(note)
    imgui.pop_style_color()


def _choice(s: Settings, label: str, name: str, choices: Mapping[str, str], tip: str) -> Settings:
    keys = list(choices)
    _label(label)
    changed, k = imgui.combo(f"##{label}", keys.index(getattr(s, name)), list(choices.values()))
    _tip(tip)
    return replace(s, **{name: keys[k]}) if changed else s


def _label(text: str) -> None:
    """Write a label and put the next widget beside it, as wide as there is room."""
    imgui.align_text_to_frame_padding()
    imgui.text(text)
    imgui.same_line(LABEL_EM * imgui.get_font_size())
    imgui.set_next_item_width(-1)


def _write_over(text: str) -> None:
    """Write in the middle of the last widget; ImGui's own text on a progress bar runs along with it."""
    low, high, size = imgui.get_item_rect_min(), imgui.get_item_rect_max(), imgui.calc_text_size(text)
    at = ((low.x + high.x - size.x) / 2, (low.y + high.y - size.y) / 2)
    imgui.get_window_draw_list().add_text(at, imgui.get_color_u32(imgui.Col_.text), text)


def _number(label: str, value: str, tip: str) -> None:
    """Write a number at the right end of its line."""
    right = imgui.get_content_region_avail().x
    imgui.begin_group()  # positions on a line count from the group's left end
    imgui.text_colored((*theme.DIM, 1.0), label)
    imgui.same_line(right - imgui.calc_text_size(value).x)
    imgui.text(value)
    imgui.end_group()
    _tip(tip)


def _tip(text: str) -> None:
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip | imgui.HoveredFlags_.allow_when_disabled):
        imgui.begin_tooltip()
        imgui.push_text_wrap_pos(24 * imgui.get_font_size())
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()


def _title(key: str) -> str:
    return key.replace("_", " ").capitalize()


def _thousands(n: int) -> str:
    return f"{int(n):,}".replace(",", " ")  # thin spaces would need another font


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f} ms" if seconds < 9.9995e-2 else f"{1e3 * seconds:.0f} ms"


def _round(n: int) -> int:
    """Two digits are enough on a slider."""
    unit = 10 ** max(int(math.log10(n)) - 1, 0)
    return round(n / unit) * unit
