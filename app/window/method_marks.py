"""The method over the picture: paths of some photons, the disc under the cursor and the segments that cross it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.session.method_view import ADDED, KEPT, REMOVED
from app.window import hemisphere_plot, label, theme

if TYPE_CHECKING:
    from app.session.method_view import Disc, MethodView, Strokes
    from app.window.viewport import Viewport

COLOURS: dict[int, tuple[float, ...]] = {
    KEPT: (*theme.DIM, 0.55),
    REMOVED: (*theme.ERROR, 0.95),
    ADDED: (0.45, 0.85, 0.50, 0.95),
}
NAMES = {KEPT: "as without objects", REMOVED: "removed: an object blocks them", ADDED: "added: from there on"}
CORNERS = 48  # of a drawn disc


def draw(viewport: Viewport, view: MethodView | None) -> None:
    """Draw the parts that have been asked for into the current window."""
    if view is None or (view.paths is None and view.disc is None):
        return
    (x, y), (w, h) = viewport.view.origin, viewport.view.size
    drawing = imgui.get_window_draw_list()
    drawing.push_clip_rect((x, y), (x + w, y + h), True)
    if view.paths is not None:
        _strokes(viewport, view.paths)
    if view.disc is not None:
        _strokes(viewport, view.disc.crossings)
        _disc(viewport, view.disc)
    if view.hemisphere is not None:
        hemisphere_plot.draw(viewport, view.hemisphere, COLOURS)
    drawing.pop_clip_rect()
    em = imgui.get_font_size()
    for k, (kind, name) in enumerate(NAMES.items()):
        count = f"{view.disc.counts[kind]:,} " if view.disc is not None else ""
        label.write(count + name, x + em, y + (2.6 + 1.7 * k) * em, COLOURS[kind][:3])
    if view.disc is not None:
        text = f"segments across the disc of {view.disc.radius:.3g} m, of {view.disc.photons:,} photons"
        label.write(text, x + em, y + (2.6 + 1.7 * len(NAMES)) * em)


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


def _disc(viewport: Viewport, disc: Disc) -> None:
    """Draw a disc's rim and its normal."""
    n = disc.normal / np.linalg.norm(disc.normal)
    side = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    side /= np.linalg.norm(side)
    turn = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    rim = disc.position + disc.radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(n, side)))
    tip = disc.position + disc.radius * n
    points = np.concatenate([rim, disc.position[None], tip[None]])
    places = viewport.view.on_screen(points + viewport.session.model.origins[0])
    drawing, colour = imgui.get_window_draw_list(), imgui.get_color_u32((*theme.ACCENT, 1.0))
    around = zip(places[:CORNERS], [*places[1:CORNERS], places[0]], strict=True)
    for a, b in (*around, (places[CORNERS], places[CORNERS + 1])):
        if a is not None and b is not None:
            drawing.add_line(a, b, colour, theme.pixels(2.0))
