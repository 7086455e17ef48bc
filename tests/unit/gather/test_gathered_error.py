"""The error stated for gathered static light includes its bias, in a room lit through one deep window."""

import numpy as np
import pytest

from gi_core.gather import static
from gi_core.gather.reference import ReferenceState
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area, gather_sample
from gi_core.gather.static import ErrorSample
from gi_core.model import Model
from tests.support.scene_builders import classroom, solve

pytestmark = pytest.mark.slow

SCENE = classroom(0.6)


@pytest.fixture(scope="module")
def truth() -> ReferenceSample:
    """Whole paths at 400 receivers, of 3 % noise."""
    model = Model(SCENE)
    areas = model.object_receivers.areas
    rows, times = draw_by_area(np.flatnonzero(areas > 0), areas, 400, 5)
    *_, truth = gather_sample(model, model.start_poses(), rows, times, 77, 0.03)
    return truth


@pytest.mark.parametrize(("photons", "enough"), [(1 << 12, 0.02), (1 << 15, 0.02)])
def test_stated_error_is_the_true_one_and_the_mean_is_right(photons, enough, truth, monkeypatch):
    """The first and the last light are measured; others may state too much. Few photons do no harm: none count."""
    monkeypatch.setattr(static, "ENOUGH", enough)
    solver = solve(SCENE, photons=photons, light="best", seed=2)
    stated, true = [], []
    for progress in solver.gather_steps():
        g = solver.frame_light.static.gathered
        if g.state is not None:  # whole paths begin
            break
        if progress.picture:
            stated.append(g.estimate.error)
            true.append(truth.error(solver.irradiance))
    over = np.array(stated) / true
    assert len(over) > 1 and max(true) > 0.04 and 0.7 < over.min() and over.max() < 2 and max(over[[0, -1]]) < 1.5
    assert truth.relative_total(solver.irradiance) == pytest.approx(1, abs=0.01)


def test_a_sample_without_two_rounds_has_no_error():
    """A background may come before: another radius or a solo, while the sample of earlier light is traced."""
    for sets in (0, 1):
        state = ReferenceState.empty(4)._replace(sets=np.full(4, sets, np.int32))
        sample = ErrorSample(np.arange(4), np.ones(4), state)
        assert sample.error(np.ones((4, 3))) == 0.0


def test_noise_of_few_receivers_hides_no_error_of_the_others():
    """A quarter of the receivers has nearly all noise of the sample, the others have the error."""
    n, sets, found = 256, 8, []
    noisy = np.arange(n) % 4 == 0
    right, times = np.ones((n, 3)), np.ones(n)
    E = right + 0.02 * np.where(np.arange(n) % 8 < 4, 1.0, -1.0)[:, None] * ~noisy[:, None]
    for seed in range(20):
        chance = np.random.default_rng(seed).standard_normal((sets, n, 1)) * np.where(noisy, 0.2, 0.01)[:, None]
        squares = np.repeat(((chance - chance.mean(axis=0)) ** 2).sum(axis=0), 3, axis=1)
        state = ReferenceState.empty(n)._replace(
            sets=np.full(n, sets, np.int32), mean=right + chance.mean(axis=0), squares=squares
        )
        found.append(ErrorSample(np.arange(n), times, state))
    true = 0.75 * 0.02
    assert np.mean([s.error(E) for s in found]) == pytest.approx(true, rel=1 / 3)
    assert np.mean([s.reference.error(E) for s in found]) > 4 / 3 * true, "noise subtracted from all at once"
