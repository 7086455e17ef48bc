"""Receivers whose edge passes through another part are no neighbours: their light differs."""

import numpy as np
import pytest

from gi_core.model import Model
from gi_core.scene.types import Scene
from tests.support.scene_builders import box, grey, merge, quad, sphere


def links(model: Model, near) -> set[tuple[tuple, tuple]]:
    """Return pairs of positions that are neighbours."""
    p = [tuple(x) for x in np.round(model.object_receivers.positions, 6).tolist()]
    return {(p[i], p[j]) for i in range(len(near.first) - 1) for j in near.of[near.first[i] : near.first[i + 1]]}


@pytest.mark.parametrize("two_sided", [False, True])
def test_a_wall_parts_the_floor_under_it(two_sided):
    floor, wall = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (4, 4)), box((0.2, -2, -0.1), (0.3, 2, 1))
    model = Model(Scene(merge(floor, wall), (grey(0.5, two_sided),)))
    lost = links(model, model.linked) - links(model, model.adjacency)
    assert lost and all(a[2] == b[2] == 0.0 and min(a[0], b[0]) < 0.2 and max(a[0], b[0]) > 0.3 for a, b in lost)
    assert all(min(a[0], b[0]) >= 0.3 or max(a[0], b[0]) <= 0.2 for a, b in links(model, model.adjacency) if a[2] == 0)


def test_sides_in_the_open_stand_for_those_under_a_wall():
    floor, wall = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (4, 4)), box((0.2, -2, -0.1), (0.3, 2, 1))
    model = Model(Scene(merge(floor, wall), (grey(0.5),)))
    s, x = model.surfaces, model.object_receivers.positions[:, 0]
    sides = model.open_sides.reshape(-1, 2, 3)[:, 0]
    under = np.flatnonzero(
        (np.ptp(x[s.corner_front], axis=1) > 0.4) & (x[s.corner_front].min(axis=1) == 0.0) & (s.normals[:, 2] > 0.9)
    )
    under = under[np.abs(model.object_receivers.positions[s.corner_front[under], 2]).max(axis=1) == 0.0]
    assert len(under) == 8 and (sides[np.setdiff1d(np.arange(len(sides)), under)] == -1).sum() > 60
    for f in under:
        for corner, other in zip(s.corner_front[f], sides[f] >> 1, strict=True):
            beyond = x[s.corner_front[other]]
            assert corner in s.corner_front[other] and (beyond.max() <= 0.2 or beyond.min() >= 0.3)


@pytest.mark.parametrize(
    "mesh", [box((0, 0, 0), (1, 1, 1), 4, 0, True), box((0, 0, 0), (1, 1, 1), 3), sphere((3, 0, 0), 1.0)]
)
@pytest.mark.parametrize("two_sided", [False, True])
def test_edges_in_the_open_stay(mesh, two_sided):
    model = Model(Scene(mesh, (grey(0.5, two_sided),)))
    assert np.array_equal(model.adjacency.of, model.linked.of) and np.array_equal(
        model.adjacency.first, model.linked.first
    )
