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


@pytest.mark.parametrize(
    "mesh", [box((0, 0, 0), (1, 1, 1), 4, 0, True), box((0, 0, 0), (1, 1, 1), 3), sphere((3, 0, 0), 1.0)]
)
@pytest.mark.parametrize("two_sided", [False, True])
def test_edges_in_the_open_stay(mesh, two_sided):
    model = Model(Scene(mesh, (grey(0.5, two_sided),)))
    assert np.array_equal(model.adjacency.of, model.linked.of) and np.array_equal(
        model.adjacency.first, model.linked.first
    )
