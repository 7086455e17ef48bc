"""Light at places that little of it reaches: in motion by a budget, and at a pose at rest."""

import numpy as np
import pytest

from gi_core.gather.reference_sample import draw_by_area, gather_sample
from tests.support.hidden_places import books, cupboard, partition, table_room, two_rooms
from tests.support.scene_builders import solve

PLACES, NOISE = 60, 0.02  # receivers, and the noise of their truth


def under_the_table(x: np.ndarray, normal: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    return mobile & (x[:, 2] < 0.71) & (normal[:, 2] < 0.5)


def between_books(x: np.ndarray, normal: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    return mobile & (np.abs(normal[:, 0]) > 0.9)


def in_the_cupboard(x: np.ndarray, normal: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    inside = ((x > (1.115, 2.555, 0.01)) & (x < (1.885, 2.935, 1.79))).all(axis=1)
    return inside & ~mobile


def behind_the_partition(x: np.ndarray, normal: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    return (x[:, 0] > 2.6) & ~mobile


def dark_side(x: np.ndarray, normal: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    return mobile & (normal[:, 0] > 0.9)


def by_the_wall(x: np.ndarray, normal: np.ndarray, mobile: np.ndarray) -> np.ndarray:
    return (x[:, 0] > 3.05) & (x[:, 0] < 3.2) & (np.abs(normal[:, 0]) < 0.1) & ~mobile


@pytest.mark.parametrize(
    ("scene", "places", "in_motion", "at_rest"),
    [
        (table_room, [under_the_table], 0.09, 0.02),
        (books, [between_books], 0.75, 0.04),
        (cupboard, [in_the_cupboard], 0.20, 0.05),
        (two_rooms, [by_the_wall], 2.00, 0.25),
        (partition, [behind_the_partition, dark_side], 0.40, 0.04),
    ],
)
def test_hidden_places_have_their_light(scene, places, in_motion, at_rest):
    """Light interpolated across a partition was 9 % off behind it at rest, and 12 % on its dark side."""
    solver = solve(scene(), photons=1 << 19, light="best", seed=1)
    r, mobile = solver.receivers, solver.surfaces.object_of(np.arange(len(solver.irradiance))) > 0
    truths = []
    for place in places:
        rows = np.flatnonzero(place(r.positions, r.normals, mobile) & (r.areas > 0))
        *_, truth = gather_sample(solver.model, solver.poses, *draw_by_area(rows, r.areas, PLACES, 3), 5, NOISE)
        truths.append(truth)
    for _ in solver.gather_steps():
        pass
    solver.move_all(solver.poses, 1 << 16, 32)
    assert max(truth.error(solver.irradiance) for truth in truths) < in_motion
    solver.move_all(solver.poses)
    for _ in solver.gather_pose_steps():
        pass
    assert max(truth.error(solver.irradiance) for truth in truths) < at_rest
