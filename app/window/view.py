"""The view: the camera and the picture's place in the window, which relate cursor positions to points of the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from app.draw.camera import Turntable

CLICK_PIXELS = 2.0  # shorter motions of the mouse are a click


class View:
    """`origin` and `size` [points] of the picture in the window; `camera`: None before the first scene."""

    def __init__(self) -> None:
        self.camera: Turntable | None = None
        self.origin = (0.0, 0.0)
        self.size = (1.0, 1.0)

    @property
    def aspect(self) -> float:
        return self.size[0] / max(self.size[1], 1)

    def uv(self, mouse) -> tuple[float, float]:
        """Return a point of the window in the picture, (0, 0) top left, (1, 1) bottom right."""
        return (mouse.x - self.origin[0]) / self.size[0], (mouse.y - self.origin[1]) / self.size[1]

    def contains(self, mouse) -> bool:
        """Return whether a point of the window is in the picture."""
        u, v = self.uv(mouse)
        return 0 <= u < 1 and 0 <= v < 1

    def ray(self, mouse) -> tuple[np.ndarray, np.ndarray]:
        """Return origin (3,) [m] and unit direction (3,) of the ray through a point of the window."""
        return self.camera.ray(*self.uv(mouse), self.aspect)

    def on_screen(self, points: np.ndarray) -> list[tuple[float, float] | None]:
        """Return where points (n, 3) [m] are in the window; None behind the eye."""
        matrix = self.camera.projection(self.aspect) @ self.camera.view()
        x, y, _, w = matrix @ np.c_[points, np.ones(len(points))].T
        (left, top), (width, height) = self.origin, self.size
        with np.errstate(divide="ignore", invalid="ignore"):
            across, down = left + width * (x / w + 1) / 2, top + height * (1 - y / w) / 2
        return [(a, b) if near > 0 else None for a, b, near in zip(across.tolist(), down.tolist(), w, strict=True)]
