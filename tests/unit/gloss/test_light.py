"""Directional light of a frame, of all receivers or of some."""

from __future__ import annotations

import numpy as np

from gi_core.gloss.hemisphere import CELLS
from gi_core.gloss.light import FIELDS, GlossLight


def test_directions_of_some_receivers_are_those_of_all():
    """Receivers share owners; some of these owners have changed cells."""
    chance = np.random.default_rng(5)
    place = np.array([0, 0, 3, 1, 2, 3, 4, 1], np.int32)
    resting, cells = (chance.random((n, CELLS, FIELDS)).astype(np.float32) for n in (5, 2))
    light = GlossLight(np.arange(8), np.arange(5), place, resting, np.array([1, 3]), cells)
    every = light.directions()
    for rows in ([0], [2, 3], [7, 4, 5], [0, 1, 2, 3, 4, 5, 6, 7]):
        some = light.directions(np.array(rows))
        assert np.array_equal(some.cells[some.place[rows]], every.cells[every.place[rows]])
        assert len(some.cells) == len(set(place[rows]))
    assert np.array_equal(every.cells[[1, 3]], cells) and np.array_equal(light.resting, resting)
