"""Weights of light in view: a sunlit outside does not decide whether a room has little noise."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.base.pause import steps
from gi_core.gather import static
from gi_core.gather.importance import BACKS, WHITE, areas_in_reach, visual_shares
from gi_core.gather.static import StaticGather
from gi_core.geometry.error import relative_error
from gi_core.model import Model
from gi_core.scene.origin import translated
from gi_core.scene.types import Camera
from tests.support.scene_builders import box, grey, merge, quad, sunny_house, sunny_room


def test_even_light_and_dim_places_count_by_area():
    model = Model(sunny_house(), 1)
    areas = model.object_receivers.areas[: model.first_probe]
    even = np.full(len(areas), 3.0)
    assert np.allclose(visual_shares(model, even, areas), 1.0)
    dim = np.where(np.arange(len(areas)) % 50, even, 0.3)
    assert np.allclose(visual_shares(model, dim, areas), 1.0)


def test_light_counts_by_area_up_to_white():
    model = Model(sunny_house(), 1)
    rows = model.surfaces.receiver_range(0)
    points, areas = model.evaluation_points[0][rows], model.object_receivers.areas[rows]
    outside = points[:, 0] > 6.5
    E = np.where(outside, 100.0, 2.0)
    shares = visual_shares(model, E, areas)
    assert outside.any() and np.allclose(shares[~outside], 1.0)
    assert np.allclose(shares[outside], 2.0 / 100.0 * WHITE * 2.0 / 100.0)


@pytest.mark.parametrize("walls", range(BACKS + 1))
def test_a_camera_behind_one_sided_walls_sees_through_them(walls):
    """A room inside boxes whose fronts are inside as well; beyond BACKS the median is that of all surfaces."""
    boxes = [box((-k, -k, -k), (1 + k, 1 + k, 1 + k), 2, 0, inward=True) for k in range(walls)]
    floor = quad((0.4, 0.4, 0.2), (0.2, 0, 0), (0, 0.2, 0), (2, 2), 0)  # faces up, towards the camera
    scene = replace(sunny_room(), static=merge(floor, *boxes), materials=(grey(0.5),), mobiles=(), up=(0, 0, 1))
    model = Model(replace(scene, camera=Camera((0.5, 0.5, 20.0), (0.5, 0.5, 0.0), 0.3)), 1)
    areas = model.object_receivers.areas[: model.first_probe]
    E = np.full(len(areas), 50.0)
    E[np.unique(model.surfaces.corner_front[: len(floor.faces)])] = 1.0
    level = 1.0 if walls < BACKS else 50.0
    assert (visual_shares(model, E, areas)[E == 50.0] < 1.0).all() == (level == 1.0)


def test_a_scene_far_from_the_origin_has_the_same_weights():
    """Survey data: geometry and camera are shifted near the origin, once."""
    found = []
    for by in (0.0, 4096.0):
        model = Model(translated(sunny_house(), np.array([by, -by, 0.0])), 1)
        assert model.origins[0].any() == (by > 0)
        rows = model.surfaces.receiver_range(0)
        areas = model.object_receivers.areas[rows]
        E = np.where(model.evaluation_points[0][rows][:, 0] > 6.5 - model.origins[0, 0] + by, 100.0, 2.0)
        found.append(visual_shares(model, E, areas))
    assert np.allclose(*found)


def test_errors_count_by_area_in_the_open_and_little_in_gaps():
    """Tiles a millimetre above a floor: light between vertices is wrong below them, where no one looks."""
    tiles = [quad((x, 0.01, 0.001), (0.3, 0, 0), (0, 0.98, 0), (2, 6), 1) for x in (0.02, 0.35, 0.68)]
    room = merge(box((0, 0, 0), (1, 1, 1), 4, 0, inward=True), *tiles)
    scene = replace(sunny_room(), static=room, materials=(grey(0.5), grey(0.5)._replace(two_sided=True)), mobiles=(),
                    up=(0, 0, 1), camera=Camera((0.5, 0.05, 0.6), (0.5, 0.9, 0.4), 60.0))  # fmt: skip
    model = Model(scene, 1)
    rows = model.surfaces.receiver_range(0)
    (points, normals), areas = (a[rows] for a in model.evaluation_points), model.object_receivers.areas[rows]
    reached = areas_in_reach(model)[rows]
    below = (points[:, 2] < 0.002) & ((normals[:, 2] < 0) | (points[:, 2] < 0.0005))
    walls = [(abs(normals[:, k]) > 0.9) & (points[:, k] * normals[:, k] <= 0) for k in (0, 1)]
    share = [reached[at].sum() / areas[at].sum() for at in (below, *walls)]
    assert areas[below].sum() > 1.5 and share[0] < 0.2 * min(share[1:])
    assert max(share[1:]) < 2 * min(share[1:])
    without = Model(replace(scene, camera=None), 1)
    assert np.array_equal(areas_in_reach(without), without.object_receivers.areas)
    gather = StaticGather(model, 1)
    gather._measure(np.ones((len(areas), 3)), 1.0)
    of, times = gather._sample.rows, gather._sample.times
    assert times[below[of]].sum() < 0.3 * areas[below].sum() / areas.sum() * times.sum()


def test_darkness_counts_by_area():
    model = Model(replace(sunny_house(), camera=None), 1)
    areas = model.object_receivers.areas[: model.first_probe]
    assert (visual_shares(model, np.zeros(len(areas)), areas) == 1.0).all()


def test_a_room_has_little_noise_when_its_scene_counts_as_gathered(monkeypatch):
    """Weighted by area, it has several times as much: nearly all light is outside."""
    monkeypatch.setattr(static, "ENOUGH", 0.03)
    model = Model(sunny_house(), 1)
    rows = model.surfaces.receiver_range(0)
    areas, inside = model.object_receivers.areas[rows], model.evaluation_points[0][rows][:, 0] < 6.0

    def noise_inside() -> float:
        light = []
        for seed in (1, 2):
            g = StaticGather(model, seed)
            g.gather()
            light.append(g.estimate.irradiance)
        assert areas[inside] @ light[0][inside, 0] < 0.05 * (areas @ light[0][:, 0])
        return relative_error(*light, areas * inside / np.maximum(light[1][:, 1], 0.3)).l1 / np.sqrt(2)

    now = noise_inside()
    monkeypatch.setattr(static, "visual_shares", lambda model, E, areas: np.ones(len(areas)))
    assert now < 0.06 and noise_inside() > 3 * now


def test_light_of_an_earlier_run_keeps_its_weights():
    """It is shown before there is radiosity to weigh it."""
    model = Model(sunny_house(), 1)
    first = StaticGather(model, 1)
    for _ in steps(lambda: first.gather()):
        if first.state is not None and first.state.rounds > 1:
            break
    again = StaticGather(model, 1)
    assert again.go_on_from(first.kept())
    next(steps(lambda: again.gather()))
    assert (again.weights < 0.9 * areas_in_reach(model)[: len(again.weights)]).mean() > 0.1
    assert np.array_equal(again.weights, first.weights)
