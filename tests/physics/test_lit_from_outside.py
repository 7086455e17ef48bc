"""Frames of few photons in rooms that are lit through a window, and where paths are long."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gi_core.gather.estimate import Estimate, Source
from gi_core.gather.reference import reference_irradiance
from gi_core.gather.reference_sample import draw_by_area
from gi_core.geometry.error import luminance
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Scene
from tests.support.lit_from_outside import bathroom, l_room, sky_room
from tests.support.scene_builders import solve

PLACES, PATHS = 100, 4096  # 2 % of noise


def truth(scene: Scene, rows: np.ndarray) -> np.ndarray:
    """Return irradiance (n, 3) at receivers of the static part."""
    model = Model(scene)
    points, normals = (a[rows] for a in evaluation_points(model.surfaces, model.receivers_at(model.start_poses())))
    return reference_irradiance(scene, points, normals, PATHS, 5, model=model)[0]


def error(E: np.ndarray, T: np.ndarray, times: np.ndarray) -> tuple[float, float]:
    """Return the relative l1 error of luminance, and the relative error of its sum."""
    off, total = luminance(E) - luminance(T), times @ luminance(T)
    return times @ np.abs(off) / total, times @ off / total


@pytest.mark.parametrize(
    ("place", "most", "most_of_mean", "least_change"),
    [(l_room, 0.06, 0.02, 0.3), (partial(sky_room, 0.3), 0.06, 0.01, 0.03), (partial(bathroom, 0.2), 0.05, 0.02, 0.02)],
)
def test_a_frame_of_a_budget_shows_the_light_at_its_pose(place, most, most_of_mean, least_change):
    """131,072 even photons are 17 % off in the L-shaped room; 64 directions 10 % under the sky."""
    scene = place()
    solver = solve(scene, photons=1 << 19, light="best", seed=1)
    n, lamps = solver.surfaces.receiver_range(0).stop, solver.lamps.count
    rows, times = draw_by_area(np.arange(n), solver.receivers.areas, PLACES, 3)
    still, moved = truth(replace(scene, mobiles=()), rows), truth(scene, rows)
    assert error(still, moved, times)[1] > least_change, "the box takes much light"
    light = solver.frame.background.irradiance_per_lamp(1 << 19).reshape(n, lamps, 3)
    light[rows] *= (still / np.maximum(light[rows].sum(axis=1), 1e-300))[:, None]
    light = light.reshape(n, 3 * lamps)
    solver.frame_light.static.best = Estimate(Source.PHOTONS, light, np.zeros((n, lamps)), 0.0, 0.0)
    solver.move_all(solver.poses, 1 << 16, 32)
    found, of_mean = error(solver.irradiance[rows], moved, times)
    assert found < most and abs(of_mean) < most_of_mean
