"""The picture of a hemisphere: outlines of cells and contours of the lobe on the unit disc."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.window import method_marks
from gi_core.gloss.hemisphere import CELLS, cell_of, direction_of, on_disc

GRID = method_marks.LOBE_GRID


def area(outline: np.ndarray) -> float:
    (x, y), (u, v) = outline.T, np.roll(outline, -1, axis=0).T
    return 0.5 * float((x * v - u * y).sum())


def test_cells_have_equal_areas_and_lie_where_their_directions_do():
    outlines = method_marks._cell_outlines()
    assert len(outlines) == CELLS
    sizes = np.abs([area(outline) for outline in outlines])
    np.testing.assert_allclose(sizes, math.pi / CELLS, rtol=0.02)  # arcs are drawn as chords
    assert sizes.sum() == pytest.approx(math.pi, rel=0.01)
    for cell, outline in enumerate(outlines):
        x, y = outline.mean(axis=0)
        r = math.hypot(x, y)  # z = 1 - r^2 on the disc of equal areas
        flat = math.sqrt(2 - r * r)
        assert cell_of(flat * x, flat * y, 1 - r * r) == cell


def test_the_grid_of_the_lobe_lies_on_the_disc():
    a, b = method_marks._grid().T
    for k in range(0, len(a), 37):
        x, y, z = direction_of(a[k], b[k])
        r = np.hypot(*on_disc(np.array([[a[k], b[k]]]))[0])
        assert z == pytest.approx(1 - r * r, abs=1e-12) and math.hypot(x, y) == pytest.approx(r * math.sqrt(2 - r * r))


def test_contours_lie_on_their_level():
    """Of a cone about a point: a circle about it, closed."""
    square = method_marks._grid()
    disc, middle, radius = on_disc(square), np.array([0.2, -0.1]), 0.4
    values = -np.linalg.norm(disc - middle, axis=1)
    ends = method_marks._contour(values.reshape(GRID, GRID), disc.reshape(GRID, GRID, 2), -radius)
    np.testing.assert_allclose(np.linalg.norm(ends - middle, axis=1), radius, atol=4e-3)
    lengths = np.linalg.norm(ends[::2] - ends[1::2], axis=1)
    assert lengths.sum() == pytest.approx(2 * math.pi * radius, rel=0.01)
    assert len(method_marks._contour(values.reshape(GRID, GRID), disc.reshape(GRID, GRID, 2), 1.0)) == 0
