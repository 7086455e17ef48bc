"""The method over the picture: paths of some photons, and what the estimator counts under the cursor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.window import hemisphere_plot, label, theme
from gi_core.photons.paths import ADDED, KEPT, REMOVED

if TYPE_CHECKING:
    from app.session.counted import Counted
    from app.session.method_view import MethodView
    from app.session.strokes import Strokes
    from app.window.viewport import Viewport

COLOURS: dict[int, tuple[float, ...]] = {
    KEPT: (*theme.DIM, 0.55),
    REMOVED: (*theme.ERROR, 0.95),
    ADDED: (0.45, 0.85, 0.50, 0.95),
}
NAMES = {KEPT: "as without objects", REMOVED: "removed: an object blocks them", ADDED: "added: from there on"}
FOLLOWS, HELD = "a click holds this receiver", "held: a click on it again follows the cursor"


def draw(viewport: Viewport, view: MethodView | None) -> None:
    """Draw the parts that have been asked for into the current window."""
    if view is None or (view.paths is None and view.counted is None):
        return
    (x, y), (w, h) = viewport.view.origin, viewport.view.size
    drawing = imgui.get_window_draw_list()
    drawing.push_clip_rect((x, y), (x + w, y + h), True)
    if view.paths is not None:
        _strokes(viewport, view.paths)
    if view.counted is not None:
        _strokes(viewport, view.counted.drawn)
        _outline(viewport, view.counted)
    if view.hemisphere is not None:
        hemisphere_plot.draw(viewport, view.hemisphere, COLOURS)
    drawing.pop_clip_rect()
    em = imgui.get_font_size()
    for k, (kind, name) in enumerate(NAMES.items()):
        count = f"{view.counted.counts[kind]:,} " if view.counted is not None else ""
        label.write(count + name, x + em, y + (2.6 + 1.7 * k) * em, COLOURS[kind][:3])
    if view.counted is not None:
        text = f"{view.counted.about}, of {view.counted.photons:,} photons"
        label.write(text, x + em, y + (2.6 + 1.7 * len(NAMES)) * em)
        hint = HELD if viewport.session.held_receiver >= 0 else FOLLOWS
        label.write(hint, x + em, y + (4.3 + 1.7 * len(NAMES)) * em)


def _strokes(viewport: Viewport, strokes: Strokes) -> None:
    origin, drawing, width = viewport.session.model.origins[0], imgui.get_window_draw_list(), theme.pixels(1.0)
    places = viewport.view.on_screen(strokes.ends.reshape(-1, 3) + origin)
    colours = {kind: imgui.get_color_u32(colour) for kind, colour in COLOURS.items()}
    for a, b, kind, hits in zip(places[::2], places[1::2], strokes.kind.tolist(), strokes.hits.tolist(), strict=True):
        if b is None:
            continue
        if a is not None:
            drawing.add_line(a, b, colours[kind], width)
        if hits:
            drawing.add_circle_filled(b, 2.0 * width, colours[kind], 6)


def _outline(viewport: Viewport, of: Counted) -> None:
    """Draw the lines round the area, and its normal, as long as the first of them is away."""
    length = np.linalg.norm(of.outline[0, 0] - of.position) if len(of.outline) else 0.0
    tip = of.position + length * of.normal / np.linalg.norm(of.normal)
    lines = np.concatenate([of.outline, [[of.position, tip]]]).reshape(-1, 3)
    places = viewport.view.on_screen(lines + viewport.session.model.origins[0])
    drawing, colour = imgui.get_window_draw_list(), imgui.get_color_u32((*theme.ACCENT, 1.0))
    for a, b in zip(places[::2], places[1::2], strict=True):
        if a is not None and b is not None:
            drawing.add_line(a, b, colour, theme.pixels(2.0))
