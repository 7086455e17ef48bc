"""Widgets of the sections: label, choice, number, tooltip; and number formats."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from imgui_bundle import imgui

from app.settings import Settings
from app.window import theme

LABEL_EM, VALUE_EM = 6.6, 5.4  # width of the columns of labels and of numbers beside sliders
SPEED = 1e-3  # of the scene's size, per pixel of a drag
LEAST_SIDE = 1e-3  # [m] of a plane or panel
ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
DASH = "\N{EM DASH}"  # an unknown number


def choice(s: Settings, name: str, field: str, choices: Mapping[str, str], about: str) -> Settings:
    """Draw a combo box for a field of the settings; `choices`: value -> displayed name."""
    keys = list(choices)
    label(name)
    changed, k = imgui.combo(f"##{name}", keys.index(getattr(s, field)), list(choices.values()))
    tip(about)
    change: dict[str, Any] = {field: keys[k]}
    return replace(s, **change) if changed else s


_idle: list[str] = []  # reasons why the widgets being drawn have no effect; "": they have


@contextmanager
def idle(reason: str) -> Iterator[None]:
    """Draw widgets grey that have no effect, for a reason that their tooltips give; "": as they are."""
    imgui.begin_disabled(bool(reason))
    _idle.append(reason)
    try:
        yield
    finally:
        _idle.pop()
        imgui.end_disabled()


def only(estimator: str, s: Settings) -> str:
    """Return the reason for idle() of a widget of one estimator, where neither side of the picture is its light."""
    return "" if estimator in (s.estimator, s.compare) else f"only {estimator} uses it"


def explained(text: str) -> str:
    """Return a tooltip with the reasons why its widget has no effect."""
    return "\n".join([text, *(f"No effect now: {reason}." for reason in _idle if reason)])


def label(text: str) -> None:
    """Write a label; the next widget fills the rest of the line."""
    imgui.align_text_to_frame_padding()
    imgui.text(text)
    imgui.same_line(LABEL_EM * imgui.get_font_size())
    imgui.set_next_item_width(-1)


def int_slider(name: str, value: int, low: int, high: int, shown: str, logarithmic: bool = False) -> tuple[bool, int]:
    """Draw a slider between its label and its value in words, so that the knob hides no number."""
    _beside(name, shown)
    flags = imgui.SliderFlags_.logarithmic if logarithmic else imgui.SliderFlags_.none
    return imgui.slider_int(f"##{name}", value, low, high, "", flags)


def float_slider(
    name: str, value: float, low: float, high: float, shown: str, logarithmic: bool = False
) -> tuple[bool, float]:
    """Draw a slider for a float, as int_slider()."""
    _beside(name, shown)
    flags = imgui.SliderFlags_.logarithmic if logarithmic else imgui.SliderFlags_.none
    return imgui.slider_float(f"##{name}", value, low, high, "", flags)


def _beside(name: str, shown: str) -> None:
    """Write label and value of a slider; the slider comes between them."""
    label(name)
    em = imgui.get_font_size()
    start, right = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
    imgui.set_cursor_pos((start.x + right - imgui.calc_text_size(shown).x, start.y))
    imgui.align_text_to_frame_padding()
    imgui.text(shown)
    imgui.same_line()
    imgui.set_cursor_pos(start)
    imgui.set_next_item_width(max(right - VALUE_EM * em, 3 * em))


def fields(
    name: str, values: Sequence[float], speed: float, digits: str, labels: Sequence[str] = "xyz"
) -> tuple[tuple[float, ...], bool, bool, bool]:
    """Draw number fields beside a label; return the numbers, whether they changed, and whether editing begins or ends.

    labels: of the fields, for identity.
    """
    label(name)
    imgui.begin_group()
    gap = imgui.get_style().item_inner_spacing.x
    width = (imgui.get_content_region_avail().x - (len(values) - 1) * gap) / len(values)
    numbers, edited, first, last = list(values), False, False, False
    for k, axis in enumerate(labels):
        if k:
            imgui.same_line(0, gap)
        imgui.set_next_item_width(width)
        changed, value = imgui.drag_float(f"##{name} {axis}", unsigned_zero(values[k], digits), speed, 0, 0, digits)
        if changed and abs(value) < 1e6:
            numbers[k], edited = float(str(np.float32(value))), True  # the field has float32
        first |= imgui.is_item_activated()
        last |= imgui.is_item_deactivated()
    imgui.end_group()
    return tuple(numbers), edited, first, last


def unsigned_zero(value: float, digits: str) -> float:
    """Return a number, 0 if it would be shown as a negative zero."""
    number = (digits % value).split()[0]  # a unit may follow
    return value if set(number) & set("123456789") else 0.0


def write_over(text: str) -> None:
    """Write in the middle of the last widget; ImGui's own text on a progress bar moves with the bar."""
    low, high, size = imgui.get_item_rect_min(), imgui.get_item_rect_max(), imgui.calc_text_size(text)
    at = ((low.x + high.x - size.x) / 2, (low.y + high.y - size.y) / 2)
    imgui.get_window_draw_list().add_text(at, imgui.get_color_u32(imgui.Col_.text), text)


def number(name: str, value: str, about: str) -> None:
    """Write a name and, right-aligned, its value."""
    right = imgui.get_content_region_avail().x
    imgui.begin_group()  # positions on a line count from the group's left end
    imgui.text_colored((*theme.DIM_TEXT, 1.0), name)
    imgui.same_line(right - imgui.calc_text_size(value).x)
    imgui.text(value)
    imgui.end_group()
    tip(about)


def tip(text: str) -> None:
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip | imgui.HoveredFlags_.allow_when_disabled):
        imgui.begin_tooltip()
        imgui.push_text_wrap_pos(24 * imgui.get_font_size())
        imgui.text_unformatted(explained(text))
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()


def shortened(text: str, width: float) -> str:
    """Return a text, cut to a width [points] with an ellipsis."""
    cut = text
    while len(cut) > 1 and imgui.calc_text_size(cut).x > width:
        cut = text[: len(cut.removesuffix(ELLIPSIS)) - 1].rstrip() + ELLIPSIS
    return cut


def title(key: str) -> str:
    return key.replace("_", " ").capitalize()


def thousands(n: int) -> str:
    return f"{int(n):,}"


def ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f} ms" if seconds < 9.9995e-2 else f"{1e3 * seconds:.0f} ms"


def rounded(n: int) -> int:
    """Return n rounded to two digits."""
    unit = 10 ** max(int(math.log10(n)) - 1, 0)
    return round(n / unit) * unit
