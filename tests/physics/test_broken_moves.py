"""A move interrupted by an exception has no effect: poses and light agree, and later moves are correct."""

import inspect
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import gi_core
from gi_core.base.pause import Interrupted, breaking_off
from gi_core.base.threads import run_ranges
from gi_core.estimators import tangent_plane
from gi_core.estimators.tangent_plane import TangentPlane
from gi_core.frames.light_setting import LIGHTS
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Mobile, Pose
from gi_core.solver import Solver
from tests.support.scene_builders import box, coloured_room, solve

OURS = str(Path(gi_core.__file__).parent)
PLACES = 40  # interruptions per estimator
START, THERE, ELSEWHERE = (
    Pose((x, 0.5, z), axis_angle((0, 0, 1), t)) for x, z, t in ((0.3, 0, 0), (0.6, 0, 30), (0.5, 0.3, 60))
)
NEXT = {"block": ELSEWHERE}


class BrokenOff(BaseException):
    """Like an interrupt from the keyboard: nothing may swallow it."""


def watched(call, break_at: int = 0) -> int:
    """Call, and raise when the n-th function of the program begins or ends; return the number of such events.

    Not where a generator yields: an exception of a profiler skips its `finally`, and no interrupt comes there.
    """
    count = 0

    def on_event(frame, event, argument):
        nonlocal count
        yields = event == "return" and frame.f_code.co_flags & inspect.CO_GENERATOR
        if event in ("call", "return") and not yields and frame.f_code.co_filename.startswith(OURS):
            count += 1
            if count == break_at:
                raise BrokenOff

    sys.setprofile(on_event)
    try:
        call()
    finally:
        sys.setprofile(None)
    return count


def seen(solver: Solver) -> tuple:
    """Return all results of the last frame."""
    fates = [value.tolist() for value in solver.frame.fates.values()]
    numbers = (
        solver.frame.photons, solver.frame.paths, solver.frame.changes, solver.frame.control_facts,
        solver.frame.segments, solver.frame.timings,
    )  # fmt: skip
    return dict(solver.poses), solver.irradiance.tobytes(), fates, *numbers


def solved(estimator: str, light: str = "photons") -> Solver:
    block = Mobile("block", box((-0.15, -0.15, 0), (0.15, 0.15, 0.3), 2, 0), START)
    solver = solve(coloured_room((block,)), estimator, photons=2000, radius=0.1, neighbours=8, threads=1, light=light)
    solver.move("block", THERE)  # contacts at START are not those that are known last
    return solver


@pytest.mark.parametrize("light", LIGHTS)
def test_interrupted_move_changes_nothing(estimator, light):
    solver = solved(estimator, light)
    for _ in range(2):  # the first call does more: structures built once
        solver.move("block", THERE)
        whole = watched(lambda: solver.move_all(NEXT))
    assert whole > PLACES and solver.frame.changes.photons_cut > 0
    for place in np.linspace(1, whole - 2, PLACES).astype(int):  # the last two: the move is complete and returns
        solver.move("block", THERE)
        before = seen(solver)
        with pytest.raises(BrokenOff):
            watched(lambda: solver.move_all(NEXT), place)
        assert seen(solver) == before, f"broken off at {place} of {whole}"
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        solver.move("block", START)
        assert np.array_equal(solver.irradiance, solver.from_scratch()), f"after {place} of {whole}"
    solver.move_all(NEXT)
    assert seen(solver)[:2] != before[:2]


def broken_in_line(call, function: str, break_at: int) -> int:
    """Call, and raise at the n-th line that a generator runs before it yields; return the number of such lines."""
    lines, yielded = 0, False

    def on_line(frame, event, argument):
        nonlocal lines, yielded
        yielded |= event == "return"
        if event == "line" and not yielded:
            lines += 1
            if lines == break_at:
                raise BrokenOff
        return on_line

    sys.settrace(lambda frame, event, argument: on_line if frame.f_code.co_name == function else None)
    try:
        call()
    finally:
        sys.settrace(None)
    return lines


def test_interrupt_while_discs_are_shortened_restores_them():
    """The next frame found those already shortened at the poses of the interrupted one."""
    solver = solved("tangent_plane")
    lines = broken_in_line(lambda: solver.move_all(NEXT), "regions_of", 0)
    assert lines > 5
    for line in range(1, lines + 1):
        solver.move("block", THERE)
        with pytest.raises(BrokenOff):
            broken_in_line(lambda: solver.move_all(NEXT), "regions_of", line)
        assert np.array_equal(solver.irradiance, solver.from_scratch()), f"line {line} of {lines}"


@pytest.mark.parametrize("light", LIGHTS)
def test_frame_stopped_at_any_place_changes_nothing(estimator, light, monkeypatch):
    """In a move, and in a solve that may then go on with more photons."""
    monkeypatch.setattr(tangent_plane, "PIECE", 500)
    monkeypatch.setattr("gi_core.base.pause.PIECE_ROWS", 64)
    solver, asked = solved(estimator, light), []
    with breaking_off(lambda: asked.append(True)):
        solver.move_all(NEXT)
    light_there = solver.irradiance
    assert len(asked) > 6 + 2 * (estimator != "impact_count")
    solver.move("block", THERE)
    for places in range(len(asked)):
        left, before = iter(range(places)), seen(solver)
        with pytest.raises(Interrupted), breaking_off(lambda left=left: next(left, None) is None):
            solver.move_all(NEXT)
        assert seen(solver) == before
    solver.move_all(NEXT)
    assert np.array_equal(solver.irradiance, light_there)
    solver.move("block", THERE)
    before = seen(solver)
    solver.configure(photons=4000)
    for _ in range(2):
        with pytest.raises(Interrupted), breaking_off(lambda: True):
            list(solver.solve_steps())
        assert seen(solver)[:2] == before[:2]
    solver.move("block", START)
    solver.solve()
    assert solver.frame.photons == 4000 and np.array_equal(solver.irradiance, solver.from_scratch())


def test_a_drag_waits_for_few_segments(monkeypatch):
    """The estimate of 1.5 million photons lasts a tenth of a second: a frame may be stopped within it."""
    monkeypatch.setattr(tangent_plane, "PIECE", 500, raising=False)
    solver, between, accumulate = solved("tangent_plane"), [0], TangentPlane._accumulate_part

    def counted(self, o, segments, *others):
        between[-1] += segments.size
        accumulate(self, o, segments, *others)

    monkeypatch.setattr(TangentPlane, "_accumulate_part", counted)
    with breaking_off(lambda: between.append(0)):
        solver.move_all(NEXT)
    assert sum(between) > 2000 and max(between) <= 500
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_move_before_tracing_sets_poses_alone():
    solver = solved("tangent_plane")
    untraced = Solver(solver.scene, photons=2000, radius=0.1)
    untraced.move_all(NEXT)
    assert untraced.poses == NEXT and not untraced.irradiance.any()
    untraced.solve()
    solver.move_all(NEXT)
    assert np.array_equal(untraced.irradiance, solver.irradiance)


def test_exception_in_one_thread_waits_for_the_others():
    ended = np.zeros(3, bool)

    def work(part, start, stop):
        if part == 0:
            raise BrokenOff
        time.sleep(0.05)  # not yet done when the first raises
        ended[part] = True

    with pytest.raises(BrokenOff):
        run_ranges(work, 3, 3, 1)
    assert ended[1:].all()


def test_interrupted_configuration_completes_at_the_next_solve():
    solver, wanted = solved("tangent_plane"), solved("tangent_plane")
    for s in (solver, wanted):
        s.configure(radius=0.2)
    before = [progress.picture for progress in wanted.solve_steps(pictures=False)].index(True)
    steps = solver.solve_steps(pictures=False)
    for _ in range(before):  # all that precedes the picture
        next(steps)
    steps.close()
    assert not np.array_equal(solver.irradiance, wanted.irradiance)
    solver.solve()
    assert np.array_equal(solver.irradiance, wanted.irradiance)
