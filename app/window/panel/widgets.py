"""Widgets of the sections: label, choice, switch, buttons, number, tooltip; and number formats."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from imgui_bundle import imgui

from app.settings import Settings
from app.values import finite
from app.window import theme

LABEL_EM = 6.6  # width of the column of labels
SPEED = 1e-3  # of the scene's size, per pixel of a drag
LEAST_SIDE = 1e-3  # [m] of a plane or panel
ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
DASH = "\N{EM DASH}"  # an unknown number
Number = TypeVar("Number", int, float)


def choice(s: Settings, name: str, field: str, choices: Mapping[str, str], about: str) -> Settings:
    """Draw a combo box for a field of the settings; `choices`: value -> displayed name."""
    keys = list(choices)
    label(name)
    changed, k = imgui.combo(f"##{name}", keys.index(getattr(s, field)), list(choices.values()))
    tip(about)
    return with_field(s, field, keys[k]) if changed else s


def switch(s: Settings, name: str, field: str, about: str) -> Settings:
    """Draw a checkbox for a field of the settings."""
    changed, on = imgui.checkbox(name, getattr(s, field))
    tip(about)
    return with_field(s, field, on) if changed else s


def with_field(s: Settings, field: str, value: Any) -> Settings:
    """Return settings with another value of one field."""
    change: dict[str, Any] = {field: value}
    return replace(s, **change)


def one_of(name: str, shown: str, choices: Mapping[Any, tuple[str, str]], chosen: Any = None) -> Any:
    """Draw a list of choices that begins with the text `shown`; return the key of one that is clicked, else None.

    choices: displayed name and tooltip by key; chosen: the key that is marked.
    """
    clicked = None
    if imgui.begin_combo(f"##{name}", shown):
        for key, (text, about) in choices.items():
            clicked = key if imgui.selectable(text, key == chosen)[0] else clicked
            if about:
                tip(about)
        imgui.end_combo()
    return clicked


class Button(NamedTuple):
    """A button of an action of the window."""

    action: str  # key of app.window.actions
    name: str
    about: str
    enabled: bool = True


def buttons(actions: set[Any], *wanted: Button) -> None:
    """Draw buttons, two per row; a last one alone fills its row. `actions` receives those that are pressed."""
    half = (imgui.get_content_region_avail().x - imgui.get_style().item_spacing.x) / 2
    for k, button in enumerate(wanted):
        if k % 2:
            imgui.same_line()
        imgui.begin_disabled(not button.enabled)
        if imgui.button(button.name, (half if k % 2 or k + 1 < len(wanted) else -1, 0)):
            actions.add(button.action)
        tip(button.about)
        imgui.end_disabled()


def wrapped(text: str, colour: tuple[float, float, float] = theme.DIM_TEXT) -> None:
    """Write a text of several lines."""
    imgui.push_style_color(imgui.Col_.text, (*colour, 1.0))
    imgui.text_wrapped(text)
    imgui.pop_style_color()


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
    """Return the reason for idle() of a widget of one estimator, where the picture is not its light."""
    return "" if estimator == s.estimator else f"only {estimator} uses it"


def explained(text: str) -> str:
    """Return a tooltip with the reasons why its widget has no effect."""
    return "\n".join([text, *(f"No effect now: {reason}." for reason in _idle if reason)])


def label(text: str) -> None:
    """Write a label; the next widget fills the rest of the line."""
    imgui.align_text_to_frame_padding()
    imgui.text(text)
    imgui.same_line(LABEL_EM * imgui.get_font_size())
    imgui.set_next_item_width(-1)


class Typing(NamedTuple):
    """The slider whose number is typed, with its text and number before."""

    item: int = 0
    text: str = ""
    number: Any = 0


_typing = [Typing()]


def slider(
    name: str,
    value: Number,
    low: Number,
    high: Number,
    shown: str,
    logarithmic: bool = False,
    read: Callable[[str], Any] | None = None,
) -> tuple[bool, Number]:
    """Draw a slider between its label and its value in words, so that the knob hides no number; return a change.

    read: the reader of a number typed after Ctrl+click, see `app.values`; None: any number, to be cut to the range.
    """
    label(name)
    em = imgui.get_font_size()
    start, right = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
    imgui.set_cursor_pos((start.x + right - imgui.calc_text_size(shown).x, start.y))
    imgui.align_text_to_frame_padding()
    imgui.text(shown)
    imgui.same_line()
    imgui.set_cursor_pos(start)
    imgui.set_next_item_width(max(right - 5.4 * em, 3 * em))
    flags = imgui.SliderFlags_.logarithmic if logarithmic else imgui.SliderFlags_.none
    draw: Any = imgui.slider_int if isinstance(low, int) else imgui.slider_float
    changed, number = draw(f"##{name}", value, low, high, "", flags)
    if changed and isinstance(number, float):
        number = float(f"{number:.6g}")  # of float32
    item = imgui.get_item_id()
    is_typed, was_typed = imgui.internal.temp_input_is_active(item), _typing[0].item == item
    if is_typed or was_typed:  # ImGui reads 1 from 1e6 and from 1,800,000
        text = imgui.internal.get_input_text_state(item).get_text()
        before = _typing[0] if was_typed else Typing(item, text, value)
        number = before.number if text == before.text else _read(text, before.number, low, high, read)
        changed, _typing[0] = number != value, before if is_typed else Typing()
    return changed, number


def _read(text: str, before: Number, low: Number, high: Number, read: Callable[[str], Any] | None) -> Number:
    """Return a typed number, the one before where the text is none. Whole numbers may have groups of digits."""
    text = text.replace(",", ".")
    text = text.replace(".", "") if isinstance(low, int) and "e" not in text.lower() else text
    try:
        return read(text) if read is not None else type(low)(min(max(finite(text), low), high))
    except argparse.ArgumentTypeError:
        return before


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
    """Write a name and, right-aligned, its value; below it, in lines, where both do not fit on a line."""
    start = imgui.get_content_region_avail().x - imgui.calc_text_size(value).x
    imgui.begin_group()  # positions on a line count from the group's left end
    imgui.text_colored((*theme.DIM_TEXT, 1.0), name)
    if start > imgui.calc_text_size(name).x:
        imgui.same_line(start)
        imgui.text(value)
    else:
        imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(start, 0.0))
        imgui.text_wrapped(value)
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
