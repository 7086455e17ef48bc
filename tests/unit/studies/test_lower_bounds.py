"""Bounds of a frame are sums of its work, and below its measured times."""

from __future__ import annotations

import pytest

from app.cli.progress import Bar
from app.settings import Settings, make_solver, open_scene
from gi_core.solver import Solver
from studies import lower_bounds
from studies.lower_bounds import Found, Work

pytestmark = pytest.mark.slow


def solved(**settings) -> Solver:
    chosen = Settings("cornell", photons=2000, **{"light": "photons"} | settings)
    solver = make_solver(open_scene(chosen), chosen)
    solver.solve()
    return solver


@pytest.fixture
def found(estimator) -> Found:
    with Bar() as bar:
        return lower_bounds.measure(solved(estimator=estimator), 24, bar)


def test_bounds_are_below_measured_times(found, estimator):
    """The machine may be busy with something else, so only a bound above the whole frame is an error."""
    assert found.bound_ms == pytest.approx(sum(b.ms for b in found.bounds.values()))
    assert 0 < found.bound_ms < found.frame_ms
    assert "estimate" in found.bounds and set(found.bounds) <= set(found.stages_ms)
    for bound in found.bounds.values():
        assert bound.ms == pytest.approx(sum(1e3 * n / rate for n, rate in bound.work.values()))
    assert (found.queries is None) == (estimator != "photon_map")
    if (q := found.queries) is not None:
        assert 0 < q.stale_share < 1 and q.count > 0 and q.us_per_query > 0
        assert q.allowed_ms == pytest.approx(q.full_estimate_ms * q.stale_share)


def test_the_table_has_stages_ratios_and_counts(found, estimator):
    text = "\n".join(lower_bounds.table(found))
    assert f"{found.bound_ms:10.3f}{found.frame_ms / found.bound_ms:8.1f}" in text
    assert "rays at" in text and "B/s" in text
    assert ("disc tests" in text) == (estimator == "tangent_plane")
    assert ("queries of" in text) == (estimator == "photon_map")


def test_work_of_one_unit_is_added_up_and_scaled_to_its_count(monkeypatch):
    monkeypatch.setattr(lower_bounds, "best_seconds", lambda run: run())
    works = [
        Work("cuts", "rays", 100, 10, lambda: 1e-3),  # 10 ms
        Work("cuts", "rays", 300, 100, lambda: 1e-3),  # 3 ms
        Work("cuts", "bytes", 5, 10, lambda: 2e-3),  # 1 ms
        Work("estimate", "bytes", 10, 10, lambda: 2e-3),
    ]
    bounds = lower_bounds.bounds_of(works)
    assert bounds["cuts"].ms == pytest.approx(14) and bounds["estimate"].ms == pytest.approx(2)
    assert bounds["cuts"].work["rays"] == (400, pytest.approx(400 / 13e-3))


def test_mobiles_that_gather_have_a_bound():
    """Their discs are not searched: no segments near them exist."""
    with Bar() as bar:
        found = lower_bounds.measure(solved(light="best"), 4, bar)
    assert "gather" in found.stages_ms and found.bound_ms > 0
