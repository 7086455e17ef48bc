"""Work split over threads, and work that overlaps with it."""

from __future__ import annotations

import threading
import time

import pytest

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
