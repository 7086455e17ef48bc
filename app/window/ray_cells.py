"""Leaf cells of the structure of rays over the picture: those near the cursor's point, and those on its ray.

Seen along the ray they hide each other; the ray of a click stays while the camera orbits about it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.settings import CLICKED
from app.window import label, theme

if TYPE_CHECKING:
    from app.draw.picking import Hit
    from app.window.viewport import Viewport
    from gi_core.rays.leaf_boxes import LeafBoxes

FULL, EMPTY, OTHER = (1.0, 0.75, 0.2, 0.95), (1.0, 0.75, 0.2, 0.4), (*theme.DIM_TEXT, 0.45)
RAY_COLOUR = (1.0, 1.0, 1.0, 0.9)
THICK, THIN = 2.0, 1.0  # [points]
CORNERS = np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)], bool)
EDGES = np.array([(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit])
CUT_DISTANCE = 1e-3  # [m] in front of the eye: lines are cut there


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
        from gi_core.rays.leaf_boxes import leaf_boxes, visited

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
            (near[np.isfinite(off[near])], OTHER, THIN),
            (np.flatnonzero(on_ray & ~full), EMPTY, THIN),
            (np.flatnonzero(on_ray & full), FULL, THICK),
        )
        self._lines = (
            *((on_picture(edges(boxes.low[k], boxes.high[k]), matrix), colour, width) for k, colour, width in shown),
            (on_picture(np.array([[eye, end]]), matrix), RAY_COLOUR, THICK),
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
    a, b = np.moveaxis(np.concatenate([lines, np.ones((*lines.shape[:2], 1))], axis=2) @ matrix.T, 1, 0)
    ahead = np.maximum(a[:, 3], b[:, 3]) > CUT_DISTANCE
    a, b = a[ahead], b[ahead]
    ends = []
    for p, q in ((a, b), (b, a)):
        behind = p[:, 3] < CUT_DISTANCE
        share = np.where(behind, (CUT_DISTANCE - p[:, 3]) / np.where(behind, q[:, 3] - p[:, 3], 1.0), 0.0)
        cut = p + share[:, None] * (q - p)
        ends.append(cut[:, :2] / cut[:, 3:])
    at = np.stack(ends, axis=1)
    return np.stack([(at[:, :, 0] + 1) / 2, (1 - at[:, :, 1]) / 2], axis=-1)
