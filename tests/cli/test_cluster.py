"""Frames, references and baked light by several processes, one of them killed half way: the same files."""

from __future__ import annotations

import functools
import os
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest

from app import __main__ as cli
from app.cli import cluster
from app.cli.cluster import Crew, Machines
from app.commands import bake, reference, render
from app.measure.chart.page import _processes
from app.measure.chart.run import Run
from app.rest import spread_paths
from app.rest.static_job import restore
from app.rest.timed_gathering import gather
from app.settings import Settings, make_solver
from gi_core.defaults.choose import choose
from gi_core.gather.static import StaticGather
from gi_core.scene import Pose
from tests.cli.test_render import checkered_room
from tests.cli.test_render_files import ticking
from tests.support.cli_support import one_line
from tests.support.small_charts import small_charts

SMALL = Settings(photons=4000, radius=0.06, size=(96, 72))
FRAMES = 4


@pytest.fixture(autouse=True)
def whole_pilot(monkeypatch):
    """Other processes trace all pilot photons, so this one does."""
    monkeypatch.setattr("gi_core.solver.choose", choose)


@pytest.fixture(scope="module")
def machines():
    with cluster.opened(2, None) as machines:
        yield machines


@pytest.fixture
def a_scene(monkeypatch, tmp_path):
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / "reference"))
    scene = checkered_room(2.0)
    moved = replace(scene, mobiles=(scene.mobiles[0]._replace(pose=Pose((0.4, 0.3, 0.5))),))
    for command, opened in ((render, scene), (reference, scene), (bake, moved)):
        monkeypatch.setattr(command, "open_scene", lambda settings, opened=opened: opened)


@pytest.fixture
def one_is_killed(machines, monkeypatch):
    """Kill a process after the first result; return the list of those killed."""
    killed, give = [], Crew.map

    def give_and_kill(self, run, tasks):
        for result in give(self, run, tasks):
            if not killed:
                killed.append(next(iter(machines.client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)
            yield result

    monkeypatch.setattr(Crew, "map", give_and_kill)
    return killed


def files(folder) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def test_frames_are_the_same_files_though_a_process_is_killed(machines, a_scene, one_is_killed, tmp_path, monkeypatch):
    """With gathered static light, which the processes get from here; each picture has its light's hash."""
    found = []
    for name, team in (("here", None), ("there", machines)):
        monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / "kept" / name))
        (tmp_path / name).mkdir()
        counted = functools.partial(gather, clock=ticking(0.01))  # as much light on any machine
        monkeypatch.setattr("app.rest.timed_gathering.gather", counted)
        render.render(SMALL, tmp_path / name / "a.png", FRAMES, seconds=4.0, machines=team)
        found.append(files(tmp_path / name))
    assert one_is_killed and len(found[0]) == FRAMES and found[0] == found[1]
    assert b"static_light\0gathered" in found[0]["a.0001.png"]


def test_reference_and_baked_light_are_the_same_files(machines, a_scene, one_is_killed, tmp_path, monkeypatch):
    monkeypatch.setattr(spread_paths, "PATHS_PER_TASK", 1 << 12)
    found = []
    for name, team in (("here", None), ("there", machines)):
        monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / name))
        reference.reference(SMALL, 0.2, team)
        bake.bake(SMALL, tmp_path / f"{name}.glb", 0.0, error=0.2, machines=team)
        found.append((files(tmp_path / name), (tmp_path / f"{name}.glb").read_bytes()))
    assert one_is_killed and len(found[0][0]) == 2 and found[0] == found[1]


TIMES = "frame_ms", "frame_p95_ms", "first_frame_ms", "process", "threads"  # not functions of the seed


def test_charts_have_the_same_errors_though_a_process_is_killed(
    machines, a_scene, one_is_killed, tmp_path, monkeypatch
):
    small_charts(monkeypatch)
    settings, rows = replace(SMALL, estimator="impact_count", photons=None), []
    for name, team in (("here", None), ("there", machines)):
        scene = checkered_room(2.0)
        (tmp_path / name).mkdir()
        run = Run(scene, settings, True, 3, 60, tmp_path / name, lambda *_: None, team)
        run.measure()
        rows.append(run.results.rows)
        assert all(r["frame_ms"] > 0 and r["threads"] >= 1 for r in rows[-1])
    plain = [[{k: str(v) for k, v in row.items() if k not in TIMES} for row in found] for found in rows]
    assert plain[0] == plain[1] and all(0 < r["total all"] < 1 for r in rows[0])
    assert one_is_killed and len(rows[0]) == 4
    here, there = ({r["process"] for r in found} for found in rows)
    assert len(here) == 1 and not here & there and str(one_is_killed[0]) not in {p.split(":")[-1] for p in here}
    words = _processes(rows[1] + rows[0], {"threads": 2})
    assert words.startswith(f"timed by {len(here | there)} processes: ") and next(iter(here)) in words


def test_restored_light_is_what_it_was():
    """Another solver shows gathered light from its arrays alone: no path is traced, no bit differs."""
    gathered, plain = (make_solver(checkered_room(2.0), replace(SMALL, light="best")) for _ in range(2))
    for solver in (gathered, plain):
        solver.solve()
    for progress in gathered.gather_steps():
        if progress.picture:
            break
    before = plain.irradiance
    restore(plain, gathered.frame_light.static.gathered.light)
    assert gathered.frame_light.static.is_gathered and plain.frame_light.static.is_gathered
    np.testing.assert_array_equal(plain.irradiance, gathered.irradiance)
    assert not np.array_equal(before, plain.irradiance) and isinstance(plain.frame_light.static.gathered, StaticGather)


def test_a_failed_task_raises_here(machines):
    with pytest.raises(ZeroDivisionError):
        list(machines.crew(_nothing, None).map(_divide, [(1,), (0,)]))


def _nothing(job, threads) -> int:
    return 1


def _divide(one: int, by: int) -> float:
    return one / by


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--workers 2 --scheduler tcp://127.0.0.1:9", "--workers starts processes here, --scheduler has its own"),
        ("--scheduler tcp://127.0.0.1:9", "--scheduler tcp://127.0.0.1:9: no dask scheduler answers ("),
        ("--scheduler nonsense://x", "--scheduler nonsense://x: no dask scheduler answers ("),
    ],
)
def test_bad_clusters_get_a_sentence(words, message, capsys, monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    assert cli.main(["render", "no such scene.glb", "--frames", "2", *words.split()]) == 2
    assert message in one_line(capsys.readouterr().err)


def test_a_scheduler_without_workers_gets_a_sentence(capsys, monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as empty:
        words = ["render", "no such scene.glb", "--frames", "2", "--scheduler", empty.scheduler_address]
        assert cli.main(words) == 2
    said = f"no worker has joined; start `dask worker {words[-1]}` on a machine"
    assert one_line(capsys.readouterr().err) == f"gi-viewer: --scheduler {words[-1]}: {said}\n"


def test_without_options_nothing_is_started(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with cluster.opened(None, None) as machines:
        assert machines is None
    assert Machines(None, 3)._threads == 3
