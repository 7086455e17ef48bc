"""The method over the picture: paths of some photons, and what the estimator counts under the cursor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.window import label, theme
from gi_core.gloss.hemisphere import SIDE, directions, disc_of, on_disc
from gi_core.photons.paths import ADDED, KEPT, REMOVED

if TYPE_CHECKING:
    from app.session.method_view import Counted, HemisphereView, MethodView, Strokes
    from app.window.viewport import Viewport


RADIUS_EM = 7.0
CELL_BORDER = (0.35, 0.36, 0.38, 0.6)
EDGE_STEPS = 4  # of a cell's edge
LOBE_GRID = 40  # places of the lobe along a side of the square
CONTOURS_AT = ((0.5, 1.0), (0.1, 0.55), (0.01, 0.3))  # contours: fraction of the lobe's maximum, opacity
CONTOURS = "contours: lobe at 50, 10, 1 %"
NOTE, REFLECTED = f"light by direction; {CONTOURS}", f"shown by a reflection, no light by direction; {CONTOURS}"
Places = list[tuple[float, float]]


def draw_hemisphere(viewport: Viewport, view: HemisphereView, colours: dict[int, tuple[float, ...]]) -> None:
    """Draw the hemisphere into the current window; colours: of rays by kind."""
    em, drawing = imgui.get_font_size(), imgui.get_window_draw_list()
    (x, y), (_, h) = viewport.view.origin, viewport.view.size
    radius = RADIUS_EM * em
    middle = np.array([x + 1.5 * em + radius, y + h - 4.0 * em - radius])  # above the line of hints

    def places(disc: np.ndarray) -> Places:
        return [(float(a), float(b)) for a, b in middle + radius * disc * (1, -1)]

    drawing.add_circle_filled(tuple(middle), 1.06 * radius, imgui.get_color_u32((0.06, 0.062, 0.068, 0.9)), 64)
    shares = view.cells[:, :3].mean(axis=1)
    for outline, share in zip(_cell_outlines(), shares / max(float(shares.max()), 1e-12), strict=True):
        grey = float(share) ** 0.4545
        drawing.add_convex_poly_filled(places(outline), imgui.get_color_u32((grey, grey, grey, 1.0)))
        drawing.add_polyline(places(outline), imgui.get_color_u32(CELL_BORDER), 1.0, imgui.ImDrawFlags_.closed)
    ahead = view.rays[:, 2] > 0
    for place, kind in zip(places(disc_of(view.rays[ahead])), view.kind[ahead].tolist(), strict=True):
        drawing.add_circle_filled(place, theme.pixels(2.6), imgui.get_color_u32(CELL_BORDER), 8)
        drawing.add_circle_filled(place, theme.pixels(1.6), imgui.get_color_u32(colours[kind]), 8)
    eye = viewport.view.camera.eye() - viewport.session.model.origins[0]
    values = view.lobe_towards(eye, directions(_grid())).reshape(LOBE_GRID, LOBE_GRID)
    grid = on_disc(_grid()).reshape(LOBE_GRID, LOBE_GRID, 2)
    for level, opacity in CONTOURS_AT:
        colour = imgui.get_color_u32((*theme.ACCENT, opacity))
        ends = places(_contour(values, grid, level * float(values.max())))
        for a, b in zip(ends[::2], ends[1::2], strict=True):
            drawing.add_line(a, b, colour, theme.pixels(1.8))
    seen = view.frame @ (eye - view.position)
    seen /= max(float(np.linalg.norm(seen)), 1e-30)
    if seen[2] > 0:
        (at_eye,) = places(disc_of(seen[None]))
        drawing.add_circle(at_eye, theme.pixels(5.0), imgui.get_color_u32((*theme.ACCENT, 1.0)), 16, theme.pixels(2.0))
        label.write("eye", at_eye[0] + 0.5 * em, at_eye[1] - 0.5 * em)
    label.write(REFLECTED if view.reflected else NOTE, float(middle[0] - radius), float(middle[1] - radius - 2.2 * em))


def _cell_outlines() -> list[np.ndarray]:
    """Return the outline (4 EDGE_STEPS, 2) of each cell on the unit disc, in the order of cells."""
    t = np.arange(EDGE_STEPS) / EDGE_STEPS
    zero, one = np.zeros(EDGE_STEPS), np.ones(EDGE_STEPS)
    unit = np.concatenate([np.c_[t, zero], np.c_[one, t], np.c_[1 - t, one], np.c_[zero, 1 - t]])
    return [on_disc(2 * (unit + (i, j)) / SIDE - 1) for i in range(SIDE) for j in range(SIDE)]


def _grid() -> np.ndarray:
    line = np.linspace(-1, 1, LOBE_GRID)
    return np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)


def _contour(values: np.ndarray, places: np.ndarray, level: float) -> np.ndarray:
    """Return the ends (2 n, 2) of the lines along which values (g, g) at places (g, g, 2) equal a level.

    Each grid cell is cut into two triangles, so no case is ambiguous.
    """
    corners = [(slice(None, -1), slice(None, -1)), (slice(1, None), slice(None, -1)),
               (slice(1, None), slice(1, None)), (slice(None, -1), slice(1, None))]  # fmt: skip
    ends = []
    for triangle in ((0, 1, 2), (0, 2, 3)):
        v = np.stack([values[corners[k]].reshape(-1) for k in triangle], axis=1)
        p = np.stack([places[corners[k]].reshape(-1, 2) for k in triangle], axis=1)
        above = v > level
        crossed = above.any(axis=1) & ~above.all(axis=1)
        v, p, above = v[crossed], p[crossed], above[crossed]
        alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
        rows = np.arange(len(v))
        for step in (1, 2):
            other = (alone + step) % 3
            t = (level - v[rows, alone]) / (v[rows, other] - v[rows, alone])
            ends.append((1 - t)[:, None] * p[rows, alone] + t[:, None] * p[rows, other])
    pairs = [np.stack([ends[k], ends[k + 1]], axis=1).reshape(-1, 2) for k in (0, 2)]
    return np.concatenate(pairs)


STROKE_COLOURS: dict[int, tuple[float, ...]] = {
    KEPT: (*theme.DIM_TEXT, 0.55),
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
        draw_hemisphere(viewport, view.hemisphere, STROKE_COLOURS)
    drawing.pop_clip_rect()
    em = imgui.get_font_size()
    for k, (kind, name) in enumerate(NAMES.items()):
        count = f"{view.counted.counts[kind]:,} " if view.counted is not None else ""
        label.write(count + name, x + em, y + (2.6 + 1.7 * k) * em, STROKE_COLOURS[kind][:3])
    if view.counted is not None:
        text = f"{view.counted.about}, of {view.counted.photons:,} photons"
        label.write(text, x + em, y + (2.6 + 1.7 * len(NAMES)) * em)
        hint = HELD if viewport.session.held_receiver >= 0 else FOLLOWS
        label.write(hint, x + em, y + (4.3 + 1.7 * len(NAMES)) * em)


def _strokes(viewport: Viewport, strokes: Strokes) -> None:
    origin, drawing, width = viewport.session.model.origins[0], imgui.get_window_draw_list(), theme.pixels(1.0)
    places = viewport.view.on_screen(strokes.ends.reshape(-1, 3) + origin)
    colours = {kind: imgui.get_color_u32(colour) for kind, colour in STROKE_COLOURS.items()}
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
