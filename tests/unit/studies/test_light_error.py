"""The error of resting light (`studies.light_error`): its receivers, and its result for known light."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.scene.types import Camera, Scene
from gi_core.solver import Solver
from studies import light_error
from tests.support.receiver_samples import in_view
from tests.support.scene_builders import floor, grey, merge, solve
from tests.unit.display.test_dilation import inside, standing

ABOVE = Camera((0.0, -0.3, 0.9), (0.0, 0.0, 0.0), 75.0)  # under the lamp, which faces down


@pytest.fixture(scope="module")
def solver():
    return solve(replace(standing(), camera=ABOVE), photons=20_000, radius=0.04)


def test_visible_receivers_face_the_camera_unoccluded_in_frame(solver):
    seen = np.zeros(len(solver.irradiance), bool)
    seen[in_view(solver)] = True
    p, n = solver.receivers.positions, solver.receivers.normals
    covered, on_floor = inside(solver)
    beside = on_floor & ~covered & (np.abs(p[:, 0]) < 0.5) & (p[:, 1] < -0.3) & (p[:, 1] > -0.5)
    assert beside.sum() > 5 and seen[beside].all()
    assert covered.sum() > 20 and not seen[covered].any()
    assert not seen[((np.array(ABOVE.position) - p) * n).sum(axis=1) < 0].any()
    assert not seen[on_floor & (p[:, 1] > 0.95) & (np.abs(p[:, 0]) < 0.2)].any()  # behind the box


def test_receiver_just_under_a_surface_is_not_visible():
    """A floor under tiles half a thousandth of its width thick."""
    tiles = floor(1.0, 10, centre=(0.0, 0.0, 0.001))
    scene = Scene(merge(floor(2.0, 20), tiles), (grey(0.5),), camera=ABOVE, up=(0.0, 0.0, 1.0), name="tiles")
    solver = Solver(scene, photons=0, radius=0.04)
    p = solver.receivers.positions
    seen = p[in_view(solver)]
    under = (np.abs(p[:, :2]) < 0.49).all(axis=1) & (p[:, 2] == 0)
    assert under.sum() > 50 and (seen[(np.abs(seen[:, :2]) < 0.49).all(axis=1), 2] > 0).all()
    assert (seen[:, 2] == 0).sum() > 50


def test_covered_floor_is_excluded_with_open_only(solver, monkeypatch, tmp_path):
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    covered, _ = inside(solver)
    of = light_error.sample(solver, solver.irradiance, 2000, 0.2)
    everywhere, is_open, view, open_view = of.weights
    assert everywhere.sum() == view.sum() == 2000 and (is_open <= everywhere).all() and (open_view <= view).all()
    hidden = light_error.unreached_rows(solver, solver.irradiance)
    assert len(hidden) > 10 and covered[hidden].any()
    assert set(of.rows[is_open < everywhere]) == set(hidden) & set(of.rows[everywhere > 0])
    assert not view[np.isin(of.rows, hidden)].any()


def test_reference_noise_is_subtracted():
    chance = np.random.default_rng(2)
    truth = np.ones((4000, 3)) * (1 + 0.05 * chance.standard_normal((4000, 1)))
    of = light_error.Sample(np.arange(4000), np.ones((1, 4000)), truth, np.array([0.05 * np.sqrt(2 / np.pi)]))
    exact, off = np.ones((4000, 3)), np.ones((4000, 3)) * (1 + 0.1 * chance.standard_normal((4000, 1)))
    assert light_error.errors(exact, of)[0] < 0.01
    assert light_error.errors(off, of)[0] == pytest.approx(0.1 * np.sqrt(2 / np.pi), rel=0.05)
    other = np.ones((4000, 3)) * (1 + 0.1 * chance.standard_normal((4000, 1)))
    assert light_error.scatter(off, other, of) == pytest.approx(0.1 * np.sqrt(2 / np.pi), rel=0.05)


def test_in_a_furnace_photons_err_by_chance_alone(monkeypatch, tmp_path):
    """Radiance is the same everywhere, so no disc is too large; one that reads only half its light has a bias."""
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    lines = light_error.measure("furnace", 600, 0.05, 2, ["tangent_plane"], photons=4000, radius=0.1)
    rows = {line.split(" | ")[0].strip("| "): line.rstrip(" |").split(" | ")[1:] for line in lines}
    everywhere, _, _, _, noise, bias = map(float, rows["tangent_plane, 4,000 photons, 0.1 m"])
    assert 3 < noise < 40 and bias < 0.6 * noise and everywhere == pytest.approx(np.hypot(noise, bias), abs=0.2)
    assert float(rows["the same, smoothed"][0]) < 0.5 * everywhere
