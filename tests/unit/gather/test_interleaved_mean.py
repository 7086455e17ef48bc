"""Means over neighbours: which ones, of which kinds, and how much each counts."""

import numpy as np
import pytest

from gi_core.gather import interleaved_mean, mobile
from gi_core.gather.interleaved_mean import (
    AVERAGED,
    KINDS,
    LEAST_BOUNCES,
    MOST_BOUNCES,
    SAME_WAY,
    bounce_shares,
    closeness,
    kinds,
    near_receivers,
    shared_directions,
)
from gi_core.gather.mobile import MobileGather
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Mobile, PointLight, Pose, Scene
from tests.support.scene_builders import box, grey, merge, quad, sphere


def grid(n: int = 9) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, normals and corners of a level sheet."""
    sheet = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (n - 1, n - 1))
    return sheet.vertices, np.tile([0.0, 0.0, 1.0], (n * n, 1)), sheet.faces


def rows(near) -> list[np.ndarray]:
    return np.split(near.of, near.first[1:-1])


def test_the_nearest_count_and_the_receiver_itself_first():
    positions, normals, corners = grid()
    near = near_receivers(positions, normals, corners)
    for i, of in enumerate(rows(near)):
        distance = np.sort(((positions - positions[i]) ** 2).sum(axis=1))
        assert of[0] == i and len(set(of)) == len(of) == AVERAGED
        assert np.allclose(np.sort(((positions[of] - positions[i]) ** 2).sum(axis=1)), distance[:AVERAGED])
    assert np.array_equal(near.apart, ((positions[near.of] - np.repeat(positions, AVERAGED, axis=0)) ** 2).sum(axis=1))
    assert not near.turned.any()


def test_neither_a_crease_nor_a_sheet_is_crossed():
    """The sides of a box, and both sides of a sheet, are adjacent but have separate receivers."""
    sheet = quad((2, 0, 0), (1, 0, 0), (0, 1, 0), (4, 4), 1)
    things = Mobile("things", merge(box((0, 0, 0), (1, 1, 1), 4), sheet), Pose())
    model = Model(Scene(quad((0, 0, -1), (1, 0, 0), (0, 1, 0)), (grey(0.5), grey(0.5, True)), (things,)), 1)
    gather = MobileGather(model, 0)
    _, normals = (a[gather.first :] for a in evaluation_points(model.surfaces, model.object_receivers))
    of = np.repeat(np.arange(len(normals)), np.diff(gather._near.first))
    assert len(normals) == 6 * 25 + 2 * 25
    assert ((normals[of] * normals[gather._near.of]).sum(axis=1) > SAME_WAY).all()
    there = (gather._near.of >= 6 * 25) == (of >= 6 * 25)
    assert there.all() and np.diff(gather._near.first).min() == AVERAGED


def test_kinds_are_mixed():
    positions, normals, corners = grid(12)
    near = near_receivers(positions, normals, corners)
    found = kinds(near)
    counts = np.bincount(found, minlength=KINDS)
    assert len(counts) == KINDS and counts.min() > 0.8 * len(found) / KINDS
    assert all(len(set(found[of])) == KINDS for of in rows(near))
    beside_it = [found[i] in found[of[1:5]] for i, of in enumerate(rows(near))]
    assert np.mean(beside_it) < 0.2


def test_each_kind_is_stratified_and_all_together_more():
    """Elevations stratify the hemisphere; all kinds together have less than half the error of one."""
    light = np.array([0.5, 0.3, 0.8])
    one, all_kinds = [], []
    for seed in range(200):
        bounce = shared_directions(seed, 8, KINDS)
        height = np.sort(bounce[..., 2].reshape(-1) ** 2)
        assert np.array_equal(np.floor(height * len(height)), np.arange(len(height)))
        found = np.maximum(0, bounce @ light) ** 2
        one.append(found[seed % KINDS].mean())
        all_kinds.append(found.mean())
    expected = np.mean(all_kinds)
    assert np.mean(one) == pytest.approx(expected, rel=0.02)
    assert np.std(all_kinds) < 0.4 * np.std(one)


def test_uniform_light_stays_and_means_stay_in_range():
    positions, normals, corners = grid()
    near, chance = near_receivers(positions, normals, corners), np.random.default_rng(0)
    close, light = 2 * chance.random(len(positions)), chance.random((len(positions), 3))
    same = np.broadcast_to([1.0, 2.0, 4.0], light.shape).copy()
    bounces = chance.integers(1, 32, len(positions))
    assert np.allclose(interleaved_mean.average_neighbours(near, close, bounces, same, 1), same, rtol=1e-14)
    found = interleaved_mean.average_neighbours(near, close, bounces, light, 1)
    for i, of in enumerate(rows(near)):
        assert (found[i] > light[of].min(axis=0) - 1e-12).all() and (found[i] < light[of].max(axis=0) + 1e-12).all()
    assert light.std() > 1.5 * found.std()


def test_neighbour_weights_fall_with_hit_distance_and_bounces():
    positions, normals, corners = grid()
    near, chance = near_receivers(positions, normals, corners), np.random.default_rng(0)
    light, n = chance.random((len(positions), 3)), len(positions)

    def mean(near, close, bounces, light, threads):
        return interleaved_mean.average_neighbours(near, close, np.full(n, bounces), light, threads)

    whole = np.array([light[of].mean(axis=0) for of in rows(near)])
    assert np.allclose(mean(near, np.zeros(n), 8, light, 1), whole, rtol=1e-12), "nothing is near: all alike"
    assert np.allclose(mean(near, np.full(n, 1e9), 8, light, 1), light, rtol=1e-9), "all is near: itself alone"
    assert np.allclose(mean(near, np.full(n, 1.0), 1 << 40, light, 1), light, rtol=1e-6)
    few, more = (np.abs(mean(near, np.full(n, 1.0), b, light, 1) - light).sum() for b in (4, 1024))
    assert more < 0.2 * few
    # A receiver close to a surface neither uses its neighbours' light nor gives its own.
    close = np.zeros(n)
    close[40] = 1e9
    found = mean(near, close, 8, light, 1)
    assert np.allclose(found[40], light[40], rtol=1e-9)
    beside_it = [i for i, of in enumerate(rows(near)) if i != 40 and 40 in of]
    others = [light[[j for j in rows(near)[i] if j != 40]].mean(axis=0) for i in beside_it]
    assert beside_it and np.allclose(found[beside_it], others, rtol=1e-9)
    # Nor does one with another normal: here by a sixth of a right angle.
    tilted = normals + np.array([0.25, 0.0, 0.0]) * (np.arange(n) % 2)[:, None]
    tilted /= np.sqrt((tilted**2).sum(axis=1))[:, None]
    near = near_receivers(positions, tilted, corners)
    turned = near.turned > 0
    own = np.repeat(np.arange(n), np.diff(near.first))
    assert np.array_equal(turned, (own - near.of) % 2 == 1)
    found = mean(near, np.zeros(n), 1 << 20, light, 1)
    alike = np.array([light[of[(of - of[0]) % 2 == 0]].mean(axis=0) for of in rows(near)])
    assert np.allclose(found, alike, atol=1e-3)


def test_neighbours_count_by_their_bounces():
    """Where nothing is near, the mean is that of all bounces."""
    positions, normals, corners = grid()
    near, chance = near_receivers(positions, normals, corners), np.random.default_rng(1)
    light, bounces = chance.random((len(positions), 3)), chance.integers(1, 32, len(positions))
    found = interleaved_mean.average_neighbours(near, np.zeros(len(positions)), bounces, light, 1)
    expected = [np.average(light[of], axis=0, weights=bounces[of]) for of in rows(near)]
    assert np.allclose(found, expected, rtol=1e-12)


def test_closeness_is_the_geometric_mean():
    """1 over the geometric mean: 1, 2, 4, 8 m are 1 / 2.83 m."""
    out = np.zeros(3)
    closeness(np.array([0, 4, 5, 9]), np.array([1, 2, 4, 8, 3, 0.5, 0.5, 0.5, 0.5], np.float32), out)
    assert np.allclose(out, [2**-1.5, 1 / 3, 2.0])


def test_shares_of_bounces_follow_areas():
    areas = np.random.default_rng(0).lognormal(0, 1.5, 4000)
    shares = bounce_shares(areas)
    assert 0.99 < shares.mean() <= 1 and shares.min() == LEAST_BOUNCES and shares.max() == MOST_BOUNCES
    between = (shares > LEAST_BOUNCES) & (shares < MOST_BOUNCES)
    ratio = shares[between] / areas[between] ** (2 / 3)
    assert between.mean() > 0.3 and ratio.max() / ratio.min() < 2**0.251, "rounded to quarters of a doubling"
    assert (np.diff(shares[np.argsort(areas)]) >= 0).all()
    # The error over the area, of noise 1 / sqrt(bounces), is less than with equal shares.
    assert (areas / np.sqrt(shares)).sum() < 0.85 * areas.sum()


@pytest.mark.parametrize("areas", [np.full(7, 0.3), np.zeros(4), np.ones(1)])
def test_equal_areas_have_equal_bounces(areas):
    assert (bounce_shares(areas) == 1).all()


def test_shadow_edges_stay_in_place():
    """A bulb alone: E = I cos / d2 at every receiver in its light, black behind the terminator."""
    ball = Mobile("ball", sphere((0, 0, 0), 0.2, 3, 1), Pose((0.5, 0.5, 0.5)))
    bulb = PointLight("bulb", (0.5, 0.5, 0.95), (4 * np.pi,) * 3)
    black_walls = box((0, 0, 0), (1, 1, 1), 2, 0, inward=True)
    model = Model(Scene(black_walls, (grey(0.0), grey(0.8)), (ball,), (bulb,), up=(0, 0, 1)), 1)
    at = model.transforms(model.start_poses())
    gather = MobileGather(model, 0)
    found = gather.irradiance(at, np.zeros((model.first_probe, 3)), 8)
    way = np.array(bulb.position) - (gather._positions + at.position[1])
    cosine = (way * gather._normals).sum(axis=1) / np.sqrt((way**2).sum(axis=1))
    assert not found[cosine <= 0].any()
    clear = cosine > 0.1  # nearer to the edge facets of the ball itself are in the way
    assert np.allclose(found[clear], (cosine / (way**2).sum(axis=1))[clear, None], rtol=1e-12)


def test_averaging_removes_a_third_of_the_error_of_few_bounces(monkeypatch):
    """A ball between walls, each of another brightness."""
    walls = box((0, 0, 0), (1, 1, 1), 6, 0, inward=True)
    ball = Mobile("ball", sphere((0, 0, 0), 0.15, 2, 1), Pose((0.5, 0.4, 0.6)))
    model = Model(Scene(walls, (grey(0.7), grey(0.5)), (ball,), up=(0, 0, 1)), 1)
    at = model.transforms(model.start_poses())
    static = 1.0 + 4.0 * (model.object_receivers.positions[: model.first_probe] > 0.7)
    truth = MobileGather(model, 99).irradiance(at, static, 4096)

    def off(paths: int) -> float:
        return np.mean(
            [np.abs(MobileGather(model, seed).irradiance(at, static, paths) - truth).mean() for seed in range(4)]
        )

    averaged, many = off(8), off(512)
    monkeypatch.setattr(mobile, "average_neighbours", lambda near, close, bounces, light, threads: light)
    assert averaged < 0.6 * off(8) and many < 0.1 * averaged


def test_isolated_and_coincident_receivers():
    """A receiver without faces; two faces that lie on each other: nothing is divided by 0."""
    corners = np.array([[0, 1, 2], [0, 2, 1]])
    positions = np.zeros((4, 3))
    near = near_receivers(positions, np.tile([0.0, 0.0, 1.0], (4, 1)), corners)
    assert [set(of) for of in rows(near)] == [{0, 1, 2}, {0, 1, 2}, {0, 1, 2}, {3}]
    assert len(set(kinds(near)[:3])) == 3
    light = np.arange(12.0).reshape(4, 3)
    found = interleaved_mean.average_neighbours(near, np.full(4, 1e9), np.full(4, 8), light, 1)
    assert np.allclose(found, [light[:3].mean(axis=0)] * 3 + [light[3]])
