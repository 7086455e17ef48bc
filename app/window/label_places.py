"""Places of labels: beside their points, inside the picture, over nothing that stands there already."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

ROWS, COLUMNS = 8, 2  # of boxes above and below a point, and on either side of it
SLACK = 1.0  # points that neighbours may share
Box = tuple[float, float, float, float]  # left, top, right, bottom [points]


class LabelPlaces:
    """Boxes that are taken, inside an area."""

    def __init__(self, area: Box, taken: Iterable[Box] = ()) -> None:
        self._area = area
        self._taken = list(taken)

    def take(self, wanted: Iterable[Box]) -> Box | None:
        """Take the first box that is free and inside the area, and return it; None without one."""
        left, top, right, bottom = self._area
        for box in wanted:
            a, b, c, d = box
            inside = a >= left and b >= top and c <= right and d <= bottom
            a, b, c, d = a + SLACK, b + SLACK, c - SLACK, d - SLACK
            if inside and all(c <= x or a >= z or d <= y or b >= w for x, y, z, w in self._taken):
                self._taken.append(box)
                return box
        return None

    def beside(self, at: tuple[float, float], size: tuple[float, float], gap: float) -> Iterator[Box]:
        """Yield boxes of a size around a point, the nearest first: right of it, left, above, below, farther away."""
        (x, y), (width, height) = at, size
        right = [x + gap + k * width for k in range(COLUMNS)]
        left = [x - gap - (k + 1) * width for k in range(COLUMNS)]
        for start in (right[0], left[0]):
            yield start, y - height / 2, start + width, y + height / 2
        rows = ((row, row * height + y) for row in range(-ROWS, ROWS + 1))
        boxes = [
            (start, middle - height / 2, start + width, middle + height / 2)
            for row, middle in rows
            for start in (*right, *left, *([x - width / 2] if row else []))
        ]
        yield from sorted(boxes, key=lambda box: _distance(at, box))


def _distance(at: tuple[float, float], box: Box) -> float:
    """Return the distance from a point to a box."""
    (x, y), (left, top, right, bottom) = at, box
    return math.hypot(max(left - x, 0.0, x - right), max(top - y, 0.0, y - bottom))
