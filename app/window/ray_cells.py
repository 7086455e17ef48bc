"""Leaf cells of the structure of rays over the picture: those near the cursor's point, and those on its ray."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from imgui_bundle import imgui

from app.window import label, theme

if TYPE_CHECKING:
    from app.window.viewport import Viewport
    from gi_core.rays.leaf_boxes import LeafBoxes

NEAR = 100  # cells drawn around the point
VISITED, OTHER = (1.0, 0.75, 0.2, 0.9), (*theme.DIM, 0.35)
CORNERS = np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)], bool)
EDGES = np.array([(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit])


class RayCells:
    """Cells of one model's static part; found again when the model, the camera or the cursor changes."""

    def __init__(self) -> None:
        self._boxes: tuple[object, LeafBoxes | None] = (None, None)  # of a model
        self._asked: tuple | None = None
        self._at = (0.5, 0.5)  # of the cursor, in picture coordinates
        self._lines: tuple[tuple[np.ndarray, tuple], ...] = ()  # picture coordinates and colour
        self.text = ""

    def draw(self, viewport: Viewport) -> None:
        """Draw the cells into the current window, and their number."""
        io = imgui.get_io()
        self.update(viewport, (io.mouse_pos.x, io.mouse_pos.y))
        (x, y), (w, h) = viewport.view.origin, viewport.view.size
        drawing = imgui.get_window_draw_list()
        drawing.push_clip_rect((x, y), (x + w, y + h), True)
        for lines, colour in self._lines:
            c = imgui.get_color_u32(colour)
            for (au, av), (bu, bv) in lines.tolist():
                drawing.add_line((x + au * w, y + av * h), (x + bu * w, y + bv * h), c, theme.pixels(1.0))
        drawing.pop_clip_rect()
        if self.text:
            em = imgui.get_font_size()
            label.write(self.text, x + em, y + 2.5 * em, VISITED[:3])

    def update(self, viewport: Viewport, mouse: tuple[float, float]) -> None:
        """Find the cells for a position of the mouse [points]; outside the picture, its last position counts."""
        from gi_core.rays.leaf_boxes import leaf_boxes, visited

        model, view = viewport.session.model, viewport.view
        camera = view.camera
        u, v = ((m - o) / s for m, o, s in zip(mouse, view.origin, view.size, strict=True))
        self._at = (u, v) if 0 <= u < 1 and 0 <= v < 1 else self._at
        u, v = self._at
        asked = model, camera, view.aspect, u, v
        if asked == self._asked:
            return
        self._asked = asked
        if self._boxes[0] is not model:
            self._boxes = model, leaf_boxes(model.accelerator.scenes, 0)
        boxes, name = self._boxes[1], model.accelerator.rays
        if boxes is None:
            self._lines, self.text = (), f"{name} has no cells to show: choose another structure"
            return
        eye, direction = camera.ray(u, v, view.aspect)
        eye = eye - model.origins[0]
        far = np.float32(4 * model.world.size)
        distance, _ = model.accelerator.nearest(0, eye[None], direction[None], np.array([far]))
        on_ray = visited(boxes, eye, direction, float(distance[0]))
        point = eye + float(distance[0]) * direction
        off = np.abs(0.5 * (boxes.low + boxes.high) - point).max(axis=1)
        off[(boxes.triangles == 0) | on_ray] = np.inf
        near = np.argsort(off)[:NEAR]
        matrix = camera.projection(view.aspect) @ camera.relative_to(model.origins[0]).view()
        shown = (near[np.isfinite(off[near])], OTHER), (np.flatnonzero(on_ray), VISITED)
        self._lines = tuple((edges(boxes.low[k], boxes.high[k], matrix), colour) for k, colour in shown)
        full = boxes.triangles[boxes.triangles > 0]
        self.text = (
            f"{name}: {len(full):,} cells of {full.mean():.1f} triangles; cells on the ray: {on_ray.sum()}, "
            f"triangles in them: {boxes.triangles[on_ray].sum():,}"
        )


def edges(low: np.ndarray, high: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return the edges of boxes (n, 3) in picture coordinates, (m, 2, 2); edges behind the eye are left out."""
    corners = np.where(CORNERS, high[:, None], low[:, None])
    clip = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2) @ matrix.T
    ends = clip[:, EDGES].reshape(-1, 2, 4)
    ends = ends[(ends[:, :, 3] > 1e-6 * np.abs(matrix[3]).max()).all(axis=1)]
    at = ends[:, :, :2] / ends[:, :, 3:]
    return np.stack([(at[:, :, 0] + 1) / 2, (1 - at[:, :, 1]) / 2], axis=-1)
