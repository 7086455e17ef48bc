"""Memory that nobody uses goes back to the system at rest: when, how often, and that it does go."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.session import solver_thread, spare_memory
from app.session.spare_memory import ARENAS, PAUSE, SOON, SpareMemory, give_back, limit_arenas
from gi_core.scene import Pose
from tests.support import viewer_support as support
from tests.window.test_session import FRAME, make

ROOT = Path(__file__).parents[3]
HELD_AND_FREED = """
import sys
from tests.support.memory_use import resident
from app.session.spare_memory import give_back
blocks = [bytes(100_000) for _ in range(3000)]  # too small to be mapped each on its own
last = bytes(100_000)  # keeps the heap's end where it is
del blocks
before = resident()
give_back()
print(before - resident())
"""


@pytest.mark.skipif(spare_memory._of_glibc("malloc_trim") is None, reason="malloc cannot be asked")
def test_what_was_freed_goes_back_to_the_system():
    """300 MB are freed below a block that is still held: glibc keeps all of them until it is asked."""
    told = subprocess.run([sys.executable, "-c", HELD_AND_FREED], cwd=ROOT, capture_output=True, text=True, check=True)
    assert float(told.stdout) > 200


IN_THREADS = """
import ctypes, re, sys, threading
from app.session.spare_memory import limit_arenas
if sys.argv[1] == "limited":
    limit_arenas()
together = threading.Barrier(8)
def work():
    together.wait()
    blocks = [ctypes.create_string_buffer(50_000) for _ in range(10)]
    together.wait()
threads = [threading.Thread(target=work) for _ in range(8)]
[t.start() for t in threads]
[t.join() for t in threads]
libc = ctypes.CDLL(None)
with open(sys.argv[2], "w") as out:
    libc.fdopen.restype = ctypes.c_void_p
    file = libc.fdopen(out.fileno(), b"w")
    libc.malloc_info(0, ctypes.c_void_p(file))
    libc.fflush(ctypes.c_void_p(file))
print(len(re.findall("<heap nr", open(sys.argv[2]).read())))
"""


@pytest.mark.skipif(spare_memory._of_glibc("malloc_info") is None, reason="malloc tells nothing")
def test_many_threads_share_few_arenas(tmp_path):
    def arenas(how):
        ran = [sys.executable, "-c", IN_THREADS, how, tmp_path / "told"]
        return int(subprocess.run(ran, cwd=ROOT, capture_output=True, text=True, check=True).stdout)

    assert arenas("limited") <= ARENAS < arenas("as it is")


@pytest.mark.parametrize("problem", [None, OSError, TypeError])
def test_where_there_is_no_such_thing_nothing_is_done(monkeypatch, problem):
    def library(name):
        if problem is not None:
            raise problem("not here")
        return SimpleNamespace()  # another C library

    monkeypatch.setattr(spare_memory.ctypes, "CDLL", library)
    spare_memory._of_glibc.cache_clear()
    try:
        assert give_back() is None and limit_arenas() is None
    finally:
        spare_memory._of_glibc.cache_clear()


def test_it_is_done_after_a_pause_if_anything_was():
    clock = support.Clock()
    spare = SpareMemory(clock)
    clock.now += SOON
    assert not spare.due(), "nothing has been done"
    spare.used()
    assert spare.due() and not spare.due()
    spare.used()
    assert not spare.due(), "too soon"
    clock.now += PAUSE
    assert spare.due()


def test_between_steps_and_at_rest_but_never_in_a_drag_and_not_for_ever(monkeypatch):
    done = []

    def note():
        done.append(session.dragging)

    monkeypatch.setattr(solver_thread, "give_back", note)
    session = make(step_seconds=0.002, steps=20)
    session.tick(FRAME)
    assert done == [], "the scene before may still be there"
    session.clock.now += SOON
    while session.refining:
        session.clock.now += 0.1
        session.tick(FRAME)
    assert done == [False], "once while light refines"
    session.begin_drag()
    for x in range(100):
        session.clock.now += PAUSE
        session.move({"box": Pose((0.01 * x, 0.3, 0.2))})
        session.tick(FRAME)
    assert len(done) == 1
    session.end_drag()
    counts = []
    for _ in range(100):
        session.clock.now += PAUSE
        session.tick(FRAME)
        counts.append(len(done))
    assert counts[-1] > 1 and not any(done)
    assert counts[50] == counts[-1], "nothing is done any more"
