"""Frames are read out into arrays that nobody holds, and only where these do not hold the light already."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.frames.light_pool import LightPool
from gi_core.scene.pose import Pose
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, coloured_room

N = 200  # receivers: four chunks
REST = np.arange(3.0 * N).reshape(-1, 3)


def frame(pool: LightPool, changed: list[int], light: float, rest=REST, told=None) -> np.ndarray:
    """Read a frame out in which some chunks have this light."""
    flags = np.isin(np.arange(4), changed)

    def write(out, wanted):
        rows = np.repeat(wanted, 64)[:N]
        if told is not None:
            told.append(np.flatnonzero(wanted).tolist())
        out[rows] = rest[rows]
        out[np.repeat(flags, 64)[:N]] = light

    return pool.read_out(rest, flags, N, write)


def expected(changed: list[int], light: float, rest=REST) -> np.ndarray:
    return frame(LightPool(), changed, light, rest)


def test_only_what_differs_is_written_into_an_array_that_nobody_holds():
    pool, told = LightPool(), []
    shown = None
    for changed in ([0], [1], [1], [2, 3], []):
        shown = frame(pool, changed, 7.0, told=told)
        assert np.array_equal(shown, expected(changed, 7.0))
    # While one is shown the other is written: where it was changed two frames ago, and where it is now.
    assert told == [[0, 1, 2, 3], [0, 1, 2, 3], [0, 1], [1, 2, 3], [1]]


def test_what_somebody_holds_or_looks_into_is_never_written_to():
    pool, held = LightPool(), []
    for k in range(6):
        light = frame(pool, [k % 4], float(k))
        held.append(light[3:5] if k % 2 else light)
        assert np.array_equal(light, expected([k % 4], float(k)))
    for k, light in enumerate(held):
        whole = expected([k % 4], float(k))
        assert np.array_equal(light, whole[3:5] if k % 2 else whole)


def test_other_light_at_rest_is_written_in_full():
    pool = LightPool()
    for k in range(6):
        rest = REST + k // 2
        assert np.array_equal(frame(pool, [1], 9.0, rest), expected([1], 9.0, rest))


def test_what_breaks_off_leaves_nothing_half_done():
    pool = LightPool()
    for _ in range(2):
        frame(pool, [0], 1.0)

    def broken(out, wanted):
        out[:100] = -1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pool.read_out(REST, np.zeros(4, bool), N, broken)
    for _ in range(3):
        assert np.array_equal(frame(pool, [2], 5.0), expected([2], 5.0))


def test_frames_do_not_touch_light_that_has_been_handed_out():
    solver = Solver(coloured_room((box_mobile(size=0.1),)), photons=4000, radius=0.1)
    solver.solve()
    handed, copies, arrays = [], [], set()
    for k in range(8):
        solver.move("box", Pose((0.3 + 0.05 * k, 0.5, 0.3)))
        arrays.add(id(solver.irradiance))
        if k % 3 == 0:
            handed.append(solver.irradiance)
            copies.append(solver.irradiance.copy())
        assert np.array_equal(solver.irradiance, solver.from_scratch())
    assert all(np.array_equal(a, b) for a, b in zip(handed, copies, strict=True))
    arrays = set()
    for k in range(8):
        solver.move("box", Pose((0.3 + 0.05 * k, 0.5, 0.3)))
        arrays.add(id(solver.irradiance))
    assert len(arrays) == 2
