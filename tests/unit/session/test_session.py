"""Parameters of pictures: different light has different parameters, and the same light the same.

Progress of a scene that opens behind the picture. Settings for another scene: those of the old scene go; a saved
scene gives all that it can hold. The end of a program whose threads still work. malloc's arenas: few under glibc,
untouched elsewhere.
"""

import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from app import worker
from app.cli import saved_scene
from app.draw.shot import home_camera
from app.rest.scheduler import RestWork
from app.session.opening import COMPILING
from app.session.picture import Picture
from app.session.reload import QUIET, Reload, settings_for, words_of
from app.session.session import Asked, Field, History
from app.session.solver_jobs import snapshot_of
from app.settings import LampLevel, Settings
from app.window import files
from app.worker import ARENAS, Worker
from gi_core.files.edits import Duplicate, Finish, Freeze, Insert, Promote, Remove
from gi_core.instruments.compile_ahead import SURFACES
from gi_core.scene import Camera, Pose
from tests.support import viewer_support as support
from tests.support.scene_builders import solve


def test_changes_of_one_press_are_one_step_and_one_back_to_the_start_is_none():
    history, key = History(), Field("exposure")
    for press, values in ((None, (0, 1)), (None, (1, 2)), (1, (2, 3, 4)), (2, (4, 5, 4)), (2, (4, 6))):
        history.press = press
        for before, after in zip(values, values[1:], strict=False):
            history.push({key: before, Field("solo"): ""}, {key: after, Field("solo"): ""})
    assert [history.undo() for _ in range(5)] == [{key: 4}, {key: 2}, {key: 1}, {key: 0}, {}]
    assert history.redo() == {key: 1}


def test_different_light_has_different_parameters():
    solver = solve(support.room(4), photons=3000, radius=0.06)
    work, settings = RestWork(solver, lambda: 0.0), Settings(scene="room", exposure=1.0)
    picture = Picture(settings, home_camera(solver))

    def metadata() -> dict[str, str]:
        return picture.metadata(snapshot_of(solver, work))

    by_photons = metadata()
    assert by_photons == metadata()
    assert by_photons["static_light"] == by_photons["mobile_light"] == "photons" and by_photons["control"] == "True"
    assert by_photons["error"] == "not measured" and by_photons["commit"]
    solver.configure(light="best")
    solver.solve()
    best = metadata()
    assert best["mobile_light"] == "gathered, 64 paths per receiver" and best["static_light"] == "photons"
    steps = solver.gather_steps()
    while not solver.frame_light.is_gathered:
        next(steps)
    early = metadata()
    assert early["static_light"].startswith("bounces that are kept")
    early_error = 0.99 * float(early["static_light"].split()[-2]) / 100
    while solver.frame_light.static.gathered.estimate.error >= early_error:
        next(steps)
    assert metadata()["static_light"] != early["static_light"]
    solver.configure(light="photons")
    solver.solve()
    assert metadata() == by_photons
    solver.configure(textbook=True, estimator="photon_map")
    solver.solve()
    assert {k for k, v in metadata().items() if v != by_photons[k]} == {"estimator", "textbook", "irradiance"}
    while (task := work.next_task(settings)) is not None:
        task.run()
    assert metadata()["error"].endswith(" %")


def test_the_reference_is_a_parameter():
    solver = solve(support.room(1), photons=500, radius=0.06)
    work, settings = RestWork(solver, lambda: 0.0), Settings(reference=True, exposure=1.0)
    while work.live_error.picture is None:
        work.next_task(settings).run()
    plain = Picture(settings, home_camera(solver))
    assert plain.metadata(snapshot_of(solver, work))["light_shown"] == "reference"
    assert plain != plain._replace(settings=replace(settings, tone_map="clip"))


def test_an_edit_that_compiles_kernels_says_so_at_once():
    """The first gloss compiles for tens of seconds; other phases of an edit flash, so they show after QUIET."""
    opening = SimpleNamespace(phase="loading scene", progress=("loading scene", None))
    reload, now = Reload(lambda settings: None), [0.0]
    reload.coming, reload._edited = SimpleNamespace(opening=opening, clock=lambda: now[0]), Asked((), {})
    assert reload.is_editing and reload.progress is None
    for kind in SURFACES:
        opening.phase, opening.progress = COMPILING[kind], (f"{COMPILING[kind]}: about 30 s left", 0.3)
        assert reload.progress == opening.progress
    opening.phase, now[0] = "tracing", QUIET
    assert reload.progress == opening.progress
    assert COMPILING["gloss"] == "compiling kernels for gloss, once per machine"


def test_the_log_says_what_was_edited():
    red, green = Finish("white", (("reflectance", (0.5, 0, 0)),)), Finish("white", (("reflectance", (0, 0.5, 0)),))
    seat, chair = Finish("chair", (), "seat"), Insert("armchair", "armchair.glb")
    gone = Remove("cat"), Remove("stone")
    copy, free, fixed = Duplicate("chair 2", "chair", Pose()), Promote("desk", (0, 0, 0)), Freeze("desk", Pose())
    assert words_of((), (red,)) == "edited: material white"
    assert words_of((red,), (green,)) == "edited: material white"
    assert words_of((red,), (red, seat)) == "edited: seat of chair"
    assert words_of((), (chair,)) == "inserted: armchair"
    assert words_of((chair,), (chair, *gone)) == "removed: cat, stone"
    assert words_of((chair, *gone), (chair,)) == "undone: removed: cat, stone"
    assert words_of((), (copy, free)) == "duplicated: chair; made movable: desk"
    assert words_of((), (fixed,)) == "made static: desk"
    assert words_of((red,), (red,)) == ""


def test_an_edit_undone_before_it_opened_has_no_line_in_the_log():
    shown = SimpleNamespace(settings=Settings(scene="cornell"))
    reload = Reload(lambda settings: None)
    reload.same, reload._before = True, shown.settings
    assert reload.news(shown) == "reloaded: cornell"
    reload._edited = Asked((), {})
    assert reload.news(shown) == ""
    shown.settings = Settings(scene="cornell", edits=(Remove("pawn"),))
    assert reload.news(shown) == "removed: pawn"


OLD = Settings(
    "a.toml", photons=5_000, lamps=(LampLevel("ceiling", 0.5),), solo="ceiling", tone_map="clip", light="photons",
    poses=(("cat", (0.0, 0.0, 0.0)),), camera=Camera((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 40.0), reference=True,
)  # fmt: skip


def test_a_plain_scene_takes_over_looks_alone():
    s = settings_for(SimpleNamespace(settings=OLD, requests=SimpleNamespace(filled={})), "b.glb", ("c.glb",))
    assert s == Settings("b.glb", ("c.glb",), tone_map="clip", light="photons", reference=True)


def test_a_saved_scene_gives_all_that_it_holds(tmp_path):
    path = tmp_path / "b.toml"
    there = Settings("cornell", lamps=(LampLevel("light", 2.0),), poses=(("pawn", (0.1, 0.2, 0.3, 1.0, 0, 0, 0)),))
    saved_scene.write(path, there)
    s = settings_for(SimpleNamespace(settings=OLD, requests=SimpleNamespace(filled={})), str(path), ("c.glb",))
    assert s.levels(()) == there.levels(()) and not s.solo
    assert replace(s, lamps=(), document="") == replace(there, lamps=(), mobiles=("c.glb",), reference=True)


def test_a_dimmed_lamp_and_a_moved_object_are_changes():
    kept = files.Files()
    session = SimpleNamespace(settings=Settings(), poses={"pawn": 1}, edits=(), ready=True)
    kept._clean = files._state(session)
    assert not kept.has_changed(session)
    session.settings = replace(session.settings, lamps=(LampLevel("light", 0.5),))
    assert kept.has_changed(session)
    session.settings = Settings(show="irradiance", estimator="photon_map", light="best")
    assert not kept.has_changed(session)
    session.poses = {"pawn": 2}
    assert kept.has_changed(session)


RUNS = 6  # of which half aborted
PROGRAM = """
import time
import numpy as np
from app.worker import Worker

numbers = np.random.default_rng(0).integers(0, 1000, 200_000)

def work():
    until = time.monotonic() + 0.3
    while time.monotonic() < until:
        np.unique(numbers)
    print("done")

worker = Worker()
call = worker.submit(work)
assert not call.wait(0.05)
"""


def test_the_end_of_the_program_awaits_a_running_call():
    for _ in range(RUNS):
        ended = subprocess.run(
            [sys.executable, "-c", PROGRAM], cwd=Path(__file__).parents[3], capture_output=True, text=True
        )
        assert (ended.returncode, ended.stdout, ended.stderr) == (0, "done\n", "")


def test_a_call_after_the_end_of_a_worker_fails_at_once():
    for started in (False, True):
        worker = Worker()
        if started:
            assert worker.submit(lambda: 1).result() == 1
        worker.close()
        late = worker.submit(lambda: 2)
        assert late.wait(0.0)
        with pytest.raises(RuntimeError, match="has ended"):
            late.result()


ROOT = Path(__file__).parents[3]
IN_THREADS = """
import ctypes, re, sys, threading
from app.worker import limit_arenas
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


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="malloc_info is glibc's")
def test_many_threads_share_few_arenas(tmp_path):
    def arenas(how):
        ran = [sys.executable, "-c", IN_THREADS, how, tmp_path / "arenas"]
        return int(subprocess.run(ran, cwd=ROOT, capture_output=True, text=True, check=True).stdout)

    assert arenas("limited") <= ARENAS < arenas("as it is")


@pytest.mark.parametrize("problem", [None, OSError, TypeError])
def test_other_c_libraries_are_left_alone(monkeypatch, problem):
    def library(name):
        if problem is not None:
            raise problem("not here")
        return SimpleNamespace()  # another C library

    monkeypatch.setattr(worker.ctypes, "CDLL", library)
    assert worker.limit_arenas() is None
