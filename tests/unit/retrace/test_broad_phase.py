"""The scan: every background segment that passes near a mobile, and few others."""

import numpy as np
import pytest

from gi_core.retrace.cuts import PAD, find_near
from gi_core.scene.types import Pose
from tests.support.scene_builders import box_mobile, coloured_room, solve

MARGIN = 0.05


@pytest.fixture(scope="module")
def solved():
    return solve(coloured_room((box_mobile("one", 0.1), box_mobile("two", 0.2))), "impact_count", photons=4000)


@pytest.mark.parametrize("place", [(0.5, 0.5, 0.5), (0.02, 0.9, 0.0), (1.2, 0.5, 0.5), (-40.0, 0.0, 3.0)])
@pytest.mark.parametrize("photons", [4000, 1234])
def test_near_segments_are_found_in_order_with_few_others(solved, place, photons):
    model = solved.model
    at = model.transforms({"one": Pose(place), "two": Pose((0.8, 0.2, 0.7))})
    paths, coarse = solved.frame.store.subset(photons)
    found_photon, found = find_near(model.world, coarse, at, MARGIN, threads=1)

    first = np.setdiff1d(np.arange(len(paths.side)), paths.offsets[1:] - 1)  # vertices that start a segment
    o, d = paths.position[first].astype(float), np.diff(paths.position, axis=0)[first].astype(float)
    distance = np.full(len(first), np.inf)
    for m in (1, 2):
        centre = at.rotation[m] @ model.world.sphere_centre[m] + at.position[m]
        t = np.clip(((centre - o) * d).sum(axis=1) / (d * d).sum(axis=1), 0, 1)
        away = np.linalg.norm(o + t[:, None] * d - centre, axis=1) - model.world.sphere_radius[m] - MARGIN
        distance = np.minimum(distance, away)
    near = first[distance <= 0]
    assert len(near) > 100
    assert np.isin(near, found).all()
    a_point = np.linalg.norm(d, axis=1) < 2 / coarse.grid.per_metre  # starts and ends at one level of the grid
    assert np.isin(found, first[(distance <= 3 * PAD * model.world.size) | a_point]).all()
    assert a_point.mean() < 0.01
    assert (np.diff(found) > 0).all()
    assert np.array_equal(found_photon, np.searchsorted(paths.offsets, found, side="right") - 1)


def test_all_segments_may_be_near(solved):
    paths, coarse = solved.frame.store.subset(4000)
    at = solved.model.transforms({"one": Pose((0.5, 0.5, 0.5)), "two": Pose((0.5, 0.5, 0.5))})
    _, all_of_them = find_near(solved.model.world, coarse, at, 10.0, threads=1)
    assert len(all_of_them) == len(paths.side) - 4000 > 4096
