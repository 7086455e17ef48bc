"""The reference in rounds: no bias for any allocation of paths, and the same bits with and without interruption."""

import numpy as np
import pytest

from gi_core.base import random_numbers
from gi_core.gather import reference as rounds
from gi_core.gather.reference import ReferenceRounds, ReferenceState, reference_irradiance, set_sizes
from gi_core.model import Model
from gi_core.scene.types import PointLight, SkyLight
from tests.support import scene_builders as build
from tests.support.significance import chi_square, seeds_test

P, N = build.ROOM_POINTS
UNEVEN = np.array([1.0, 0.01, 30.0, 0.5, 4.0])


def gathered(scene, sets: int, seed=0, points=(P, N), step=None, **more):
    """Return the state once every point has that many sets."""
    rounds = ReferenceRounds(scene, *points, seed, **more)
    while rounds.state.rounds < sets:
        rounds.step(step)
    return rounds.state


# -- even numbers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [1, 4, 7])
def test_a_set_is_a_net(m):
    """Every elementary box of volume 2^-m, of any shape, holds one point of a pair of dimensions."""
    n = 1 << m
    for first in (0, 5 * n, (3 << 32) + 9 * n):
        for pair in (0, 6):
            u, v = (numbers(first, n, pair + k, m) for k in (0, 1))
            for a in range(m + 1):
                box = np.floor(u * 2**a) * 2 ** (m - a) + np.floor(v * 2 ** (m - a))
                assert len(np.unique(box)) == n


def test_every_number_is_uniform_and_pairs_are_independent():
    m, sets = 3, 4000
    u, v, w = (np.array([numbers(k << m, 1 << m, d, m) for k in range(sets)]) for d in (0, 1, 2))
    for x in (u[:, 0], u[:, 5], v[:, 3], w[:, 7]):  # single paths, over all sets
        chi_square(np.bincount((x * 16).astype(int), minlength=16), np.full(16, sets / 16), "uniform")
    cell = (u * 4).astype(int) * 4 + (w * 4).astype(int)
    for k in range(1 << m):
        chi_square(np.bincount(cell[:, k], minlength=16), np.full(16, sets / 16), "pairs", significance=0.01 / 8)


def numbers(first: int, count: int, dimension: int, m: int) -> np.ndarray:
    return np.array([random_numbers.stratified(11, first + k, 1, dimension, m) for k in range(count)])


def test_smaller_sets_come_first_and_leave_no_trace():
    """A quarter of the paths, but one per delta light. Whole sets have the bits of those that began at once."""
    scene, options = build.coloured_room(), {"weights": UNEVEN, "rounds": 2}
    rounds = ReferenceRounds(scene, P, N, 3, **options)
    rounds.smaller = 2
    while rounds.state.rounds < 4:
        rounds.step()
    assert rounds.done == 1.0
    small = rounds.state.log2_set.copy()
    rounds.enlarge(2)
    while rounds.state.rounds < 2:
        rounds.step()
    whole = gathered(scene, 2, 3, **options)
    assert np.array_equal(small, np.maximum(whole.log2_set - 2, 1)) and whole.log2_set.max() > 2
    assert all(np.array_equal(a, b) for a, b in zip(rounds.state, whole, strict=True))


# -- delta lights -------------------------------------------------------------------------------------


@pytest.mark.parametrize("lamps", [1, 3, 16, 17])
def test_a_set_samples_each_delta_light_once_at_its_start(lamps):
    """Up to as many as it has paths, 16; their light then has no noise, apart by lamp and in rounds of any step."""
    rng = np.random.default_rng(lamps)
    lights = [PointLight(f"{k}", (*rng.uniform(-1, 1, 2), 0.5), (*rng.uniform(0.1, 2, 3),)) for k in range(lamps)]
    scene = build.plane_scene(*lights)
    points = np.array([[0.3, 0.0, 0.0], [-0.2, 0.4, 0.0]]), np.array([[0.0, 0.0, 1.0]] * 2)
    state = gathered(scene, 3, 1, points, step=40, per_lamp=True)
    exact = np.abs(state.standard_error) <= 1e-12 * state.mean.max()
    assert exact.all() == (lamps <= 16)
    if lamps <= 16:
        alone = sum(reference_irradiance(build.plane_scene(light), *points, 1, 1)[0] for light in lights)
        assert state.mean[:, :3] == pytest.approx(alone, rel=1e-12)


# -- no bias ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def answer() -> tuple[Model, np.ndarray]:
    """A model of the room, and irradiance at P within 1 %."""
    scene = build.coloured_room()
    model = Model(scene)
    truth, error = reference_irradiance(scene, P, N, 100_000, 99, model=model)
    assert (error < 0.01 * truth).all()
    return model, truth


@pytest.mark.slow
def test_the_mean_of_many_runs_is_the_answer(answer):
    """Each run has another pilot and therefore other sets; few rounds, so that a selection bias would show."""
    model, truth = answer
    more = {"weights": UNEVEN, "model": model}
    runs = [gathered(model.scene, 2, s, **more) for s in range(40)]
    assert len(np.unique([r.log2_set for r in runs])) > 3
    seeds_test(np.array([r.mean for r in runs]), truth, "runs of their own")


@pytest.mark.slow
def test_standard_error_equals_the_scatter_of_seeds():
    scene = build.coloured_room()
    model = Model(scene)
    runs = [gathered(scene, 5, s, weights=UNEVEN, model=model) for s in range(40)]
    scatter = np.std([r.mean for r in runs], axis=0, ddof=1)
    stated = np.sqrt(np.mean([r.standard_error**2 for r in runs], axis=0))
    assert scatter == pytest.approx(stated, rel=0.45)
    assert np.median(scatter / stated) == pytest.approx(1, rel=0.15)


@pytest.mark.slow
def test_sets_and_weights_lower_the_error():
    """At equal numbers of paths: stratified against independent, and allocated by weight against uniform."""
    scene = build.coloured_room()
    even = gathered(scene, 200, 5)
    _, independent = reference_irradiance(scene, P, N, int(even.paths[0]), 5)
    assert np.median((even.standard_error / independent) ** 2) < 0.8
    by_weight = gathered(scene, 8, 5, weights=UNEVEN)
    alike = gathered(scene, max(1, round(by_weight.paths.sum() / len(P) / 16)), 5)
    assert by_weight.noise(UNEVEN) < 0.8 * alike.noise(UNEVEN)


def test_set_sizes_follow_weight_and_scatter():
    """Paths are proportional to (w s)^(2/3): eight times the weight, four times the paths."""
    pilot = np.tile([1.0, 0.5], (3, 1))
    m = set_sizes(pilot, np.array([1.0, 8.0, 64.0]))
    assert (np.diff(m) == 2).all() and m[0] > 0
    assert set_sizes(np.zeros((2, 2)), np.ones(2)).tolist() == [0, 0]  # all dark


# -- laid down and taken up ---------------------------------------------------------------------------


def test_resumed_is_uninterrupted_bit_for_bit():
    """Wherever the state has changed: in the pilot, within a round, between two. A part of a set is traced again."""
    scene = build.coloured_room()
    whole, state, steps = gathered(scene, 3, 7, step=16, weights=UNEVEN), ReferenceState.empty(len(P)), 0
    while state.rounds < 3:
        rounds, before = ReferenceRounds(scene, P, N, 7, UNEVEN, state=state), known(state)
        while known(rounds.state) == before:
            rounds.step(16)
        state, steps = rounds.state, steps + 1
    assert steps > 12
    for a, b in zip(state, whole, strict=True):
        assert np.array_equal(a, b)


def known(state: ReferenceState) -> tuple[int, int]:
    """Return the numbers of pilots and of sets."""
    return int(np.isfinite(state.pilot[:, 0]).sum()), int(state.sets.sum())


def test_steps_of_any_length_and_threads_give_the_same_bits(monkeypatch):
    scene = build.coloured_room()
    a = gathered(scene, 2, 7, weights=UNEVEN)
    monkeypatch.setattr("gi_core.gather.path_tracer.BLOCK", 32)
    b = gathered(scene, 2, 7, weights=UNEVEN, step=1 << 9, model=Model(scene, threads=2))
    c = gathered(scene, 2, 7, weights=UNEVEN, step=8)
    assert a.log2_set.max() > 5  # a set takes several steps
    for seed in range(6):  # a longer step ends the set of one point that a shorter one began, and no other
        rng, mixed = np.random.default_rng(seed), ReferenceRounds(scene, P, N, 7, UNEVEN)
        while mixed.state.rounds < 2:
            mixed.step(int(rng.choice([8, 24, 1 << 9])))
        assert all(np.array_equal(x, y) for x, y in zip(a, mixed.state, strict=True))
    for x, y, z in zip(a, b, c, strict=True):
        assert np.array_equal(x, y) and np.array_equal(x, z)


def test_given_state_is_not_modified():
    scene = build.coloured_room()
    first = gathered(scene, 1, 7)
    kept = [a.copy() for a in first]
    ReferenceRounds(scene, P, N, 7, state=first).step()
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(first, kept, strict=True))


# -- degenerate ---------------------------------------------------------------------------------------


def test_no_points_no_normal_no_light():
    sky = build.plane_scene(SkyLight("s", (1.0,) * 3))
    none = ReferenceRounds(sky, np.zeros((0, 3)), np.zeros((0, 3)), 0, np.zeros(0))
    none.step()
    assert np.isnan(none.state.noise(np.zeros(0))) and none.state.rounds == 0
    without = gathered(sky, 2, 0, (np.zeros((2, 3)), np.array([[0, 0, 1.0], [0, 0, 0]])), weights=np.ones(2))
    assert without.mean[1].tolist() == [0, 0, 0] and without.mean[0] == pytest.approx(np.pi)
    dark = gathered(build.plane_scene(), 2, 0, weights=UNEVEN)
    assert not dark.mean.any() and np.isnan(dark.noise(UNEVEN))
    empty = ReferenceState.empty(2)
    assert np.isinf(empty.standard_error).all() and empty.noise(np.ones(2)) == np.inf


def test_bad_arguments_are_refused():
    scene = build.coloured_room()
    with pytest.raises(ValueError, match="5 finite numbers >= 0"):
        ReferenceRounds(scene, P, N, 0, -UNEVEN)
    with pytest.raises(ValueError, match="the state has 2 points, but there are 5"):
        ReferenceRounds(scene, P, N, 0, state=ReferenceState.empty(2))


def test_noise_of_few_rounds_is_unbiased():
    """Over many points, the mean standard error of two rounds is that of eight times the root of four."""
    scene = build.coloured_room()
    points = tuple(np.tile(a, (200, 1)) for a in (P, N))
    weights, noise = np.ones(1000), {}
    for sets in (2, 8):
        noise[sets] = gathered(scene, sets, 0, points).noise(weights)
    assert noise[2] == pytest.approx(2 * noise[8], rel=0.05)
    assert rounds.ROUNDS > 4  # far more than two


def test_a_pilot_sees_rare_light():
    """Light by way of a mirror comes on one path in fifty; eight paths saw none at most points."""
    rng, rare = np.random.default_rng(1), np.arange(400) % 2 == 1

    def paths(rows, first, count, m, stream):
        light = np.where(rare[rows, None], 50.0 * (rng.random((len(rows), count)) < 1 / 50), 1.0 + rng.random(count))
        return np.repeat(light[:, :, None], 3, axis=2)

    gathered = rounds.Rounds(paths, rounds.luminance_of_all, np.ones(400), ReferenceState.empty(400))
    while gathered.state.rounds < 1:
        gathered.step()
    m = gathered.state.log2_set.astype(int)
    # 1 - (1 - 1/50)^64 = 0.73 of the pilots meet the light; of those with eight paths 0.15.
    assert (m[rare] > m[~rare].max() + 1).mean() > 0.6
