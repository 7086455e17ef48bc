"""Pauses: handed back as steps, broken off, ended with their contexts, in the thread of the first step."""

from __future__ import annotations

import threading
import traceback
import weakref
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from gi_core.base.pause import Interrupted, Progress, breaking_off, pause, steps, undivided

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
