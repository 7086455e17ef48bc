"""Work split over threads, and work that overlaps with it.

Pauses: handed back as steps, broken off, ended with their contexts, in the thread of the first step.
"""

import threading
import time
import traceback
import weakref
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from gi_core.base.pause import Interrupted, Progress, breaking_off, pause, steps, undivided
from gi_core.base.threads import overlapped, run_ranges, usable


def parts(threads: int) -> list[tuple[int, int]]:
    return run_ranges(lambda _, first, last: (first, last), 12, threads, 1)


def wait_until(done) -> None:
    for _ in range(2000):
        if done():
            return
        time.sleep(0.005)
    pytest.fail("waited for 10 s")


def test_ranges_use_all_threads_and_nested_ones_a_single_thread():
    assert parts(3) == [(0, 4), (4, 8), (8, 12)]
    assert run_ranges(lambda *_: parts(3), 2, 2, 1) == [[(0, 12)], [(0, 12)]]


def test_ranges_leave_a_thread_to_overlapping_work_until_it_ends():
    may_end, threads = threading.Event(), []

    def work():
        threads.append(threading.get_ident())
        may_end.wait(10)

    with overlapped([work], 3):
        assert parts(3) == [(0, 6), (6, 12)] and usable(2) == 1
        may_end.set()
        wait_until(lambda: usable(3) == 3)
        assert len(parts(3)) == 3
    assert threads and threads[0] != threading.get_ident() and usable(3) == 3


def test_the_end_of_a_context_waits_for_the_call_in_progress_alone():
    begun, ended, others = threading.Event(), [], []

    def work():
        begun.set()
        time.sleep(0.05)
        ended.append(True)

    with overlapped([work, lambda: others.append(True)], 2):
        begun.wait(10)
    assert ended and not others


def test_calls_come_in_turn_in_one_thread():
    seen = []
    with overlapped([lambda k=k: seen.append((k, threading.get_ident(), usable(2))) for k in range(50)], 2):
        wait_until(lambda: len(seen) == 50)
    assert [k for k, *_ in seen] == list(range(50))
    assert len({thread for _, thread, _ in seen}) == 1 and {n for *_, n in seen} == {1}


def test_a_single_thread_makes_no_calls():
    with overlapped([lambda: pytest.fail("called")], 1):
        assert usable(1) == 1
    with overlapped([], 2):
        assert usable(2) == 2


def test_errors_of_both_reach_the_caller():
    begun = threading.Event()

    def work():
        begun.set()
        raise KeyError("beside")

    with pytest.raises(KeyError, match="beside"), overlapped([work], 2):
        begun.wait(10)
    with pytest.raises(ValueError, match="here"), overlapped([begun.set], 2):
        raise ValueError("here")
    assert usable(2) == 2


HALF = Progress("half", 0.5, True)


class Held:
    """In the place of a scene."""


def work(held: Held, ends: list) -> None:
    try:
        pause(HALF)
        pause()
    finally:
        ends.append(threading.get_ident())


def nested(ends: list) -> None:
    for progress in steps(partial(work, Held(), ends)):
        pause(progress)


def undivided_first() -> None:
    with undivided():
        pause(HALF)
    pause()


def fails() -> None:
    pause()
    raise ValueError("of the work")


def test_steps_follow_pauses():
    """A pause without news repeats the progress, but not its picture; without an iterator it does nothing."""
    for run in partial(work, Held()), nested:
        assert list(steps(partial(run, []))) == [HALF, HALF._replace(picture=False)]
    work(Held(), ends := [])
    assert ends and list(steps(lambda: None)) == []


@pytest.mark.parametrize("close", [True, False])
@pytest.mark.parametrize("run", [partial(work, Held()), nested])
def test_abandoned_work_ends_its_contexts_at_once(run, close):
    """A drop ends it as a close does: nothing that a suspended computation holds refers to it."""
    running = steps(partial(run, ends := []))
    next(running)
    assert not ends
    if close:
        running.close()
    del running
    assert len(ends) == 1 and len(list(steps(partial(nested, [])))) == 2


def test_an_error_leaves_the_step_with_its_frames():
    next(running := steps(fails))
    with pytest.raises(ValueError, match="of the work") as failure:
        next(running)
    assert traceback.extract_tb(failure.tb)[-1].name == "fails" and next(running, None) is None


def test_an_undivided_part_is_broken_off_but_not_handed_back():
    assert list(steps(undivided_first)) == [Progress("", 0.0, False)]
    with breaking_off(lambda: True):
        for broken in partial(next, steps(undivided_first)), pause:
            with pytest.raises(Interrupted):
                broken()
        assert len(list(steps(pause))) == 1, "the caller has control at each step"
    pause()


def test_steps_dropped_by_another_thread_end_in_their_own():
    """With its next step; and nothing of them stays in memory."""
    here, ends = weakref.ref(held := Held()), []
    with ThreadPoolExecutor(1) as pool:
        running = steps(partial(work, held, ends))
        pool.submit(next, running).result()
        del running, held
        assert not ends
        pool.submit(list, steps(pause)).result()
        assert ends == [pool.submit(threading.get_ident).result()] and here() is None
