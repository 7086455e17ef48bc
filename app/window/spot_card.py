"""Where the light at a pin comes from: bars beside the pin that was clicked."""

from __future__ import annotations

from imgui_bundle import imgui

from app.draw.legend import PLATE, ROUND_EM, TEXT
from app.session.readouts import percent, shown
from app.window import theme
from app.window.camera_control import View
from app.window.panel.widgets import shortened
from app.window.viewport import Viewport
from gi_core.gather.origins import GROUPS, Share, Way
from gi_core.scene.types import UNITS

WAY_OPACITY = 0.8, 0.5, 0.3  # of the last leg, of the one before, and of earlier ones
MOST_BARS = 5  # of a group; the last one is of all others
BAR_STEP_EM, COLUMNS_EM = 1.25, (9.2, 4.4, 5.6)  # height of a line; widths of names, bars and numbers


def draw(viewport: Viewport) -> None:
    """Draw the card of the asked pin into the current window, beside the pin and inside the picture."""
    session, view = viewport.session, viewport.view
    pin, asked = session.settings.asked, session.light.snapshot.rest.asked
    at = dict(zip(session.settings.pins, viewport.pins.places(view), strict=False)).get(pin)
    if pin is None or at is None:
        return
    answer = asked if asked is not None and asked.pin == pin else None
    unit = UNITS[session.scene.units].per_area
    text = "tracing" if answer is None else shown(*answer.origins.total, unit)
    lines: list[str | Share] = [f"{pin.name}: {text}"]
    for group in () if answer is None else GROUPS:
        lines += [f"by {group}", *answer.origins.shares(group, MOST_BARS)]
    em, opacity = imgui.get_font_size(), 1.0 if answer is not None and answer.is_current else 0.5
    width, height = (sum(COLUMNS_EM) + 1.2) * em, (BAR_STEP_EM * len(lines) + 0.6) * em
    (x, y), (w, h) = view.origin, view.size
    left = at[0] + em if at[0] + em + width <= x + w else at[0] - em - width
    left, top = max(left, x), min(max(at[1] - height / 2, y), max(y + h - height, y))
    drawing = imgui.get_window_draw_list()
    if answer is not None and answer.is_current:
        drawing.push_clip_rect((x, y), (x + w, y + h), True)
        for way in answer.origins.ways:
            _way(way, view, drawing)
        drawing.pop_clip_rect()
    plate = imgui.get_color_u32((*PLATE, 0.9))
    drawing.add_rect_filled((left, top), (left + width, top + height), plate, ROUND_EM * em)
    for k, line in enumerate(lines):
        _line(line, left + 0.6 * em, top + (0.3 + k * BAR_STEP_EM) * em, opacity)


def _way(way: Way, view: View, drawing: imgui.ImDrawList) -> None:
    """Draw a way of light from the lamp on, brighter towards the pin."""
    colour = [c ** (1 / 2.2) for c in way.colour]
    places = view.on_screen(way.places)
    for k, (a, b) in enumerate(zip(places, places[1:], strict=False)):
        if a is not None and b is not None:
            drawing.add_line(a, b, imgui.get_color_u32((*colour, WAY_OPACITY[min(k, 2)])), 0.09 * imgui.get_font_size())


def _line(line: str | Share, x: float, y: float, opacity: float) -> None:
    """Draw a heading, or a share: its name, its bar in the colour of its light, its number."""
    em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
    if isinstance(line, str):
        drawing.add_text((x, y), imgui.get_color_u32((*theme.ACCENT, opacity)), line)
        return
    name, bar, number = (width * em for width in COLUMNS_EM)
    text, red_green_blue = imgui.get_color_u32((*TEXT, opacity)), (c ** (1 / 2.2) for c in line.colour)
    drawing.add_text((x, y), text, shortened(line.name, name - 0.5 * em))
    left, top, bottom = x + name, y + 0.15 * em, y + 0.85 * em
    under, colour = (imgui.get_color_u32((*c, opacity)) for c in (theme.FRAME, red_green_blue))
    drawing.add_rect_filled((left, top), (left + bar, bottom), under)
    drawing.add_rect_filled((left, top), (left + line.share * bar, bottom), colour)
    value = percent(line)
    drawing.add_text((left + bar + number - imgui.calc_text_size(value).x, y), text, value)
