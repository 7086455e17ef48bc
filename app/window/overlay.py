"""Text over the picture and below it: progress, hints, labels, the status line."""

from __future__ import annotations

import time
from pathlib import Path

from imgui_bundle import imgui

from app.session.log import ERROR, INFO, WARNING, Log, LogEntry
from app.session.reload import Reload
from app.session.session import Session
from app.window import label, legend, theme
from app.window.panel.widgets import shortened
from app.window.viewport import Viewport
from gi_core.scene.errors import utf8

KEY_HINT = "H: help    Tab: panel"
MESSAGE_SECONDS = {INFO: 3.0, WARNING: 8.0, ERROR: 20.0}  # on show
MESSAGE_COLOURS = {INFO: theme.DIM_TEXT, WARNING: theme.WARNING, ERROR: theme.ERROR}


def draw(viewport: Viewport, session: Session, reload: Reload, ready: bool) -> None:
    """Write over the picture: progress of the opening, else labels, hint, and progress of a load or refinement."""
    em = imgui.get_font_size()
    (x, y), (w, h) = viewport.view.origin, viewport.view.size
    if not ready:
        _draw_opening(session, reload.waiting, (x, y, w, h), em)
        return
    corner, room = (x + em, y + h - 2.6 * em), w - 2 * em
    _draw_shown(viewport, (x, y, w, h), em)
    if viewport.legend is not None:
        legend.draw(viewport.legend, viewport.view)
        room = legend.box(viewport.legend, viewport.view)[0] - x - 2 * em
    message = message_at(session.log, time.monotonic())
    if message is not None and imgui.calc_text_size(message.text).x > imgui.get_main_viewport().size.x - 2 * em:
        label.write(message.text, *corner, MESSAGE_COLOURS[message.level], room=room)  # too long for the status line
    elif hint := viewport.hint():
        label.write(hint, *corner, room=room)
    if reload.progress is not None:
        if not reload.is_editing:  # another scene takes the place of this one
            shade = imgui.get_color_u32(imgui.Col_.modal_window_dim_bg)
            imgui.get_window_draw_list().add_rect_filled((x, y), (x + w, y + h), shade)
        _draw_progress(*reload.progress, x + w / 2, y + h / 2, em)


def _draw_shown(viewport: Viewport, area: tuple[float, float, float, float], em: float) -> None:
    """Label the picture: reference, error legend, pending work, an estimator just chosen."""
    shown, (x, y, w, _) = viewport.shown, area
    if shown is None:
        return
    if shown.named:
        label.write(shown.side.label, x + em, y + em)
    elif name := viewport.named_estimator():
        label.write(name, x + em, y + em)
    if shown.coming:
        label.write(shown.coming, x + w - em, y + em, theme.DIM_TEXT, right=True)


def _draw_opening(session: Session, waiting: list[str], area: tuple[float, float, float, float], em: float) -> None:
    """Write how far the opening of the first scene is; waiting: files that open after it."""
    opening, (x, y, w, h) = session.opening, area
    if opening is None:
        problem = session.problem or "see the status line"
        label.write(f"Could not open the scene: {problem}", x + w / 2, y + h / 2, theme.ERROR, centred=True)
        return
    _draw_progress(*opening.progress, x + w / 2, y + h / 2, em)
    has_objects = opening.look is not None and len(opening.look.models) > 1
    hint = "Objects can be dragged when it is done" if has_objects else ""
    if hint := f"Then opens: {utf8(Path(waiting[0]).name)}" if waiting else hint:
        label.write(hint, x + em, y + h - 2.6 * em, room=w - 2 * em)


def _draw_progress(text: str, done: float | None, x: float, y: float, em: float) -> None:
    """Write how far the opening of a scene is, with a bar below, about a point; done: the fraction, None: unknown."""
    label.write(text, x, y - label.plate(text)[1] / 2 - 0.6 * em, centred=True)  # of any lines, above the bar
    width = 18 * em
    imgui.set_cursor_screen_pos((x - width / 2, y + 0.4 * em))
    # A negative fraction makes ImGui's bar oscillate: work of unknown duration.
    fraction = -imgui.get_time() if done is None else done
    imgui.progress_bar(fraction, (width, 0.35 * em), "")


def message_at(log: Log, now: float) -> LogEntry | None:
    """Return the last message while it is new; now: the log's time [s]."""
    entry = log.last
    return entry if entry is not None and now - entry.when < MESSAGE_SECONDS[entry.level] else None


def draw_status(log: Log, readout: str, state: str, now: float) -> None:
    """Write the status line: a new message or the light under the cursor; at the right the state of the light.

    state: in words, "" before the first picture; now: the log's time [s].
    """
    start, (x, y) = imgui.get_cursor_pos(), imgui.get_cursor_screen_pos()
    message, whole = message_at(log, now), imgui.get_content_region_avail().x
    text, colour = (readout, theme.TEXT) if message is None else (message.text, MESSAGE_COLOURS[message.level])
    width, right = imgui.calc_text_size(text).x, f"{state}    {KEY_HINT}" if state else KEY_HINT
    if width + imgui.calc_text_size(right).x >= whole and state:
        right = state
    room = whole - imgui.calc_text_size(right).x
    text = shortened(text, (room if message is None else whole) - imgui.get_font_size())
    if imgui.calc_text_size(text).x < room:
        imgui.set_cursor_pos((start.x + room, start.y))
        imgui.text_disabled(right)
        imgui.set_cursor_pos(start)
    imgui.text_colored((*colour, 1.0), text)
    if imgui.is_window_hovered() and imgui.is_mouse_hovering_rect((x, y), (x + room, y + imgui.get_text_line_height())):
        # 12 messages of the log, in the status line's tooltip
        lines = "\n".join(e.text for e in list(log.entries)[-12:])
        imgui.set_tooltip(lines or "Light under the cursor; messages.")
