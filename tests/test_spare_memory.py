"""Memory that nobody uses goes back to the system at rest: when, how often, and that it does go."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import viewer_support as support
from test_session import FRAME, make

from app import at_rest, spare_memory
from app.at_rest import AtRest
from app.spare_memory import ARENAS, PAUSE, SpareMemory, give_back, limit_arenas
from gi_core.scene import Pose

ROOT = Path(__file__).parent.parent
HELD_AND_FREED = """
import sys
sys.path.insert(0, "tests")
from memory_use import resident
from app.spare_memory import give_back
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
from app.spare_memory import limit_arenas
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


def test_it_is_done_for_other_light_after_a_pause_and_once_when_all_is_done():
    clock = support.Clock()
    spare = SpareMemory(clock)
    assert spare.next_work(1) is give_back, "a scene has just been loaded"
    assert spare.next_work(1) is None and spare.last_work(1) is None, "nothing has been done since"
    assert spare.next_work(2) is None, "too soon"
    clock.now += PAUSE
    assert spare.next_work(1) is None, "the same light"
    assert spare.next_work(2) is give_back
    spare.worked()
    assert spare.last_work(2) is give_back and spare.last_work(2) is None


def test_it_comes_before_and_after_what_is_done_at_rest(monkeypatch):
    pieces = [lambda: 1, lambda: 2]
    gathering = SimpleNamespace(told=SimpleNamespace(noise=np.inf), next_work=lambda: pieces.pop() if pieces else None)
    session = SimpleNamespace(
        clock=support.Clock(), light=SimpleNamespace(version=1), auto=None, gathering=gathering, appraisal=None
    )
    monkeypatch.setattr(at_rest.AtRest, "_appraise", lambda self: None)
    work, handed = AtRest(session), []
    while (piece := work.next_work()) is not None:
        handed.append("back" if piece is give_back else "piece")
    assert handed == ["back", "piece", "piece", "back"] and work.next_work() is None


def test_never_in_a_drag_nor_while_light_refines(monkeypatch):
    done = []
    monkeypatch.setattr(spare_memory, "give_back", lambda: done.append(session.light.busy or session.dragging))
    session = make(step_seconds=0.002, steps=20)
    while session.refining:
        session.tick(FRAME)
        session.clock.now += FRAME
        assert not done or not session.refining
    session.begin_drag()
    done.clear()
    for x in range(100):
        session.clock.now += PAUSE
        session.move({"box": Pose((0.01 * x, 0.3, 0.2))})
        session.tick(FRAME)
    assert not done
    session.end_drag()
    for _ in range(20):
        session.clock.now += FRAME
        session.tick(FRAME)
    assert done == [False]
