"""The method over the picture: paths of some photons, segments or hits that count, and leaf cells of rays.

Leaf cells are those near the cursor's point, and those on its ray. Seen along the ray they hide each other; the ray of
a click stays while the camera orbits about it.
"""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from app.draw.picking import Hit
from app.session.method_view import Counted, HemisphereView, MethodView, Strokes
from app.settings import CLICKED
from app.window import label, theme
from app.window.viewport import Viewport
from gi_core.gloss.hemisphere import SIDE, directions, disc_of
from gi_core.photons.paths import ADDED, KEPT, REMOVED
from gi_core.rays.leaf_boxes import LeafBoxes, leaf_boxes, visited

RADIUS_EM = 7.0
EDGE_STEPS = 4  # of a cell's edge
LOBE_GRID = 40  # places of the lobe along a side of the square
CONTOURS = "contours: lobe at 50, 10, 1 %"
NOTE, REFLECTED = f"light by direction; {CONTOURS}", f"shown by a reflection, no light by direction; {CONTOURS}"
Places = list[tuple[float, float]]
STROKE_COLOURS: dict[int, tuple[float, ...]] = {
    KEPT: (*theme.DIM_TEXT, 0.55),
    REMOVED: (*theme.ERROR, 0.95),
    ADDED: (0.45, 0.85, 0.50, 0.95),
}


def draw_hemisphere(viewport: Viewport, view: HemisphereView) -> None:
    """Draw the hemisphere into the current window."""
    cell_border = (0.35, 0.36, 0.38, 0.6)
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
        drawing.add_polyline(places(outline), imgui.get_color_u32(cell_border), 1.0, imgui.ImDrawFlags_.closed)
    ahead = view.rays[:, 2] > 0
    for place, kind in zip(places(disc_of(view.rays[ahead])), view.kind[ahead].tolist(), strict=True):
        drawing.add_circle_filled(place, theme.pixels(2.6), imgui.get_color_u32(cell_border), 8)
        drawing.add_circle_filled(place, theme.pixels(1.6), imgui.get_color_u32(STROKE_COLOURS[kind]), 8)
    eye = viewport.view.camera.eye() - viewport.session.model.origins[0]
    ways = directions(_grid())
    values = view.lobe_towards(eye, ways).reshape(LOBE_GRID, LOBE_GRID)
    grid = disc_of(ways).reshape(LOBE_GRID, LOBE_GRID, 2)
    for level, opacity in ((0.5, 1.0), (0.1, 0.55), (0.01, 0.3)):  # fraction of the lobe's maximum
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
    return [disc_of(directions(2 * (unit + (i, j)) / SIDE - 1)) for i in range(SIDE) for j in range(SIDE)]


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
        draw_hemisphere(viewport, view.hemisphere)
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


FULL, OTHER = (1.0, 0.75, 0.2, 0.95), (*theme.DIM_TEXT, 0.45)
CORNERS = np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)], bool)
EDGES = np.array([(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit])


class RayCells:
    """Cells of one model's static part; found again when the model, the camera or the ray changes."""

    def __init__(self) -> None:
        self._boxes: tuple[object, LeafBoxes | None] = (None, None)  # of a model
        self._asked: tuple | None = None
        self._at = (0.5, 0.5)  # of the cursor, in picture coordinates
        self._clicked: Hit | None = None  # place whose ray is shown; None: that of the cursor
        self._ray = np.zeros(3), np.zeros(3)  # origin and unit direction in the world
        self._lines: tuple[tuple[np.ndarray, tuple, float], ...] = ()  # picture coordinates, colour, width
        self.text = ""

    def draw(self, viewport: Viewport) -> None:
        """Draw the cells into the current window, and their number."""
        io = imgui.get_io()
        self.update(viewport, (io.mouse_pos.x, io.mouse_pos.y))
        (x, y), (w, h) = viewport.view.origin, viewport.view.size
        drawing = imgui.get_window_draw_list()
        drawing.push_clip_rect((x, y), (x + w, y + h), True)
        for lines, colour, width in self._lines:
            c = imgui.get_color_u32(colour)
            for (au, av), (bu, bv) in lines.tolist():
                drawing.add_line((x + au * w, y + av * h), (x + bu * w, y + bv * h), c, theme.pixels(width))
        drawing.pop_clip_rect()
        if self.text:
            em = imgui.get_font_size()
            label.write(self.text, x + em, y + 2.5 * em, FULL[:3])

    def update(self, viewport: Viewport, mouse: tuple[float, float]) -> None:
        """Find the cells of the ray through the mouse [points], whose last place in the picture counts, or of a click.

        The ray of a click stays while the camera moves.
        """
        thick, thin = 2.0, 1.0  # [points]
        session, view = viewport.session, viewport.view
        model, camera, settings = session.model, view.camera, session.settings
        poses, clicked = session.pose_list, viewport.clicked if settings.cells == CLICKED else None
        if clicked is None:
            u, v = ((m - o) / s for m, o, s in zip(mouse, view.origin, view.size, strict=True))
            self._at = (u, v) if 0 <= u < 1 and 0 <= v < 1 else self._at
            self._ray = camera.ray(*self._at, view.aspect)
        elif clicked is not self._clicked:
            to = clicked.point - camera.eye()
            self._ray = camera.eye(), to / np.linalg.norm(to)
        self._clicked = clicked
        asked = model, camera, view.aspect, tuple(map(tuple, self._ray)), tuple(poses), settings.cull
        if asked == self._asked:
            return
        self._asked = asked
        if self._boxes[0] is not model:
            self._boxes = model, leaf_boxes(model.accelerator.scenes, 0)
        boxes, name = self._boxes[1], model.accelerator.rays
        if boxes is None:
            self._lines, self.text = (), f"{name} has no cells to show: choose another structure"
            return
        eye, direction = self._ray
        hit = session.picker.pick(eye, direction, poses, settings.cull)
        length = 4 * model.world.size if hit is None else hit.distance
        eye = eye - model.origins[0]
        end, full = eye + length * direction, boxes.triangles > 0
        on_ray = visited(boxes, eye, direction, length)
        off = np.abs(0.5 * (boxes.low + boxes.high) - end).max(axis=1)
        off[~full | on_ray] = np.inf
        near = np.argsort(off)[: 100 if hit is not None else 0]  # 100 cells around the point
        matrix = camera.projection(view.aspect) @ camera.relative_to(model.origins[0]).view()
        shown = (
            (near[np.isfinite(off[near])], OTHER, thin),
            (np.flatnonzero(on_ray & ~full), (1.0, 0.75, 0.2, 0.4), thin),
            (np.flatnonzero(on_ray & full), FULL, thick),
        )
        self._lines = (
            *((on_picture(edges(boxes.low[k], boxes.high[k]), matrix), colour, width) for k, colour, width in shown),
            (on_picture(np.array([[eye, end]]), matrix), (1.0, 1.0, 1.0, 0.9), thick),
        )
        self.text = (
            f"{name}: {full.sum():,} cells of {boxes.triangles[full].mean():.1f} triangles  \N{MIDDLE DOT}  "
            f"cells on the ray: {on_ray.sum()}, {(on_ray & ~full).sum()} of them empty, "
            f"triangles in them: {boxes.triangles[on_ray].sum():,}"
        )


def edges(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the ends (12 n, 2, 3) of the edges of boxes (n, 3)."""
    return np.where(CORNERS, high[:, None], low[:, None])[:, EDGES].reshape(-1, 2, 3)


def on_picture(lines: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return lines (n, 2, 3) in picture coordinates, (m, 2, 2); parts behind the eye are left out."""
    cut_distance = 1e-3  # [m] in front of the eye: lines are cut there
    a, b = np.moveaxis(np.concatenate([lines, np.ones((*lines.shape[:2], 1))], axis=2) @ matrix.T, 1, 0)
    ahead = np.maximum(a[:, 3], b[:, 3]) > cut_distance
    a, b = a[ahead], b[ahead]
    ends = []
    for p, q in ((a, b), (b, a)):
        behind = p[:, 3] < cut_distance
        share = np.where(behind, (cut_distance - p[:, 3]) / np.where(behind, q[:, 3] - p[:, 3], 1.0), 0.0)
        cut = p + share[:, None] * (q - p)
        ends.append(cut[:, :2] / cut[:, 3:])
    at = np.stack(ends, axis=1)
    return np.stack([(at[:, :, 0] + 1) / 2, (1 - at[:, :, 1]) / 2], axis=-1)
