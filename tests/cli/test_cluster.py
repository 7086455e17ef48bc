"""Frames, references, baked light by several processes, one killed half way: the same files; who may enter them."""

import functools
import os
import signal
import socket
import stat
import subprocess
import sys
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app import __main__ as cli
from app.cli import cluster
from app.cli.cluster import Machines
from app.commands import bake, reference, render
from app.measure.chart.measure import Run
from app.measure.chart.page import _processes
from app.rest import reference_store
from app.rest.scheduler import gather
from app.session.picture import restore
from app.settings import Settings, make_solver
from gi_core.defaults import choose
from gi_core.gather.static import StaticGather
from gi_core.scene import Pose
from tests.cli.test_render import checkered_room
from tests.cli.test_render_files import ticking
from tests.support.cli_support import one_line
from tests.support.small_scale import small_charts

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
    killed, give = [], Machines._map

    def give_and_kill(self, *of):
        for result in give(self, *of):
            if not killed:
                killed.append(next(iter(machines.client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)
            yield result

    monkeypatch.setattr(Machines, "_map", give_and_kill)
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
        monkeypatch.setattr("app.rest.scheduler.gather", counted)
        render.render(SMALL, tmp_path / name / "a.png", FRAMES, seconds=4.0, machines=team)
        found.append(files(tmp_path / name))
    assert one_is_killed and len(found[0]) == FRAMES and found[0] == found[1]
    assert b"static_light\0photons" not in found[0]["a.0001.png"]


def test_reference_and_baked_light_are_the_same_files(machines, a_scene, one_is_killed, tmp_path, monkeypatch):
    monkeypatch.setattr(reference_store, "PATHS_PER_TASK", 1 << 12)
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
    restore(plain, gathered.frame_light.static.gathered.estimate)
    assert gathered.frame_light.is_gathered and plain.frame_light.is_gathered
    np.testing.assert_array_equal(plain.irradiance, gathered.irradiance)
    assert not np.array_equal(before, plain.irradiance) and isinstance(plain.frame_light.static.gathered, StaticGather)


def test_a_failed_task_raises_here(machines):
    with pytest.raises(ZeroDivisionError):
        list(machines.crew(_nothing, None)(_divide, [(1,), (0,)]))


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
        ("--scheduler tls://127.0.0.1:9", "--scheduler tls://127.0.0.1:9: tls:// needs certificates: set DASK_"),
    ],
)
def test_bad_clusters_get_a_sentence(words, message, capsys, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER_TIME", 0.5)
    assert cli.main(["render", "no such scene.glb", "--frames", "2", *words.split()]) == 2
    assert message in one_line(capsys.readouterr().err)


def refusal(address, capsys, monkeypatch) -> str:
    """Return the sentence that render says about --scheduler address."""
    monkeypatch.setattr(cluster, "ANSWER_TIME", 0.5)
    assert cli.main(["render", "no such scene.glb", "--frames", "2", "--scheduler", address]) == 2
    return one_line(capsys.readouterr().err)


def test_a_scheduler_without_workers_gets_a_sentence(capsys, monkeypatch):
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as empty:
        address = empty.scheduler_address
        said = f"no worker has joined; start `dask worker {address}` on a machine"
        assert refusal(address, capsys, monkeypatch) == f"gi-viewer: --scheduler {address}: {said}\n"


def test_certificates_of_dasks_settings_open_a_scheduler_of_tls(capsys, monkeypatch, tmp_path):
    import dask
    from distributed import LocalCluster, Security

    own = Security.temporary()
    files = {}
    for name, text in (
        ("ca-file", own.tls_ca_file),
        ("client.cert", own.tls_client_cert),
        ("client.key", own.tls_client_key),
    ):
        (tmp_path / name).write_text(text)
        files[f"distributed.comm.tls.{name}"] = str(tmp_path / name)
    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", security=own) as empty:
        address = empty.scheduler_address
        with dask.config.set(files):
            assert "no worker has joined" in refusal(address, capsys, monkeypatch)
        with dask.config.set(files | {"distributed.comm.tls.ca-file": str(tmp_path / "none")}):
            assert "no dask scheduler answers (" in refusal(address, capsys, monkeypatch)


def test_a_silent_scheduler_gets_a_sentence_in_time(capsys, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address, started = f"tcp://127.0.0.1:{silent.getsockname()[1]}", time.monotonic()
        assert f"{address}: no dask scheduler answers (not within 0.5 s)" in refusal(address, capsys, monkeypatch)
        assert time.monotonic() - started < 5


INTRUDER = """
import asyncio, os, pickle, sys
from distributed import Security
from distributed.core import rpc

forged = Security.temporary().get_connection_args("client")
if os.geteuid() == 0:
    os.setuid(65534)

async def enter(port, scheme, arguments, operation):
    try:
        address = f"{scheme}://127.0.0.1:{port}"
        async with asyncio.timeout(5), rpc(address, timeout=5, connection_args=arguments) as process:
            await getattr(process, operation)(function=pickle.dumps(os.geteuid))
    except Exception:
        return "refused"
    return "ran"

async def main():
    ways = [(port, *way) for port in sys.argv[1:] for way in (("tcp", {}), ("tls", forged))]
    tried = [enter(*way, operation) for way in ways for operation in ("run", "run_function")]
    print(await asyncio.gather(*tried))

asyncio.run(main())
"""


def ports() -> list[int]:
    """Return the ports on which this process and its children listen."""
    import psutil

    this = psutil.Process()
    sockets = [c for process in (this, *this.children(recursive=True)) for c in process.net_connections("tcp")]
    return [socket.laddr.port for socket in sockets if socket.status == psutil.CONN_LISTEN]


def intruder(ports) -> str:
    """Return what another user could run at these ports; the same user, without certificates, if this is not root."""
    words = [sys.executable, "-c", INTRUDER, *map(str, ports)]
    return subprocess.run(words, capture_output=True, text=True, check=True, timeout=200).stdout


def test_other_users_cannot_enter_the_processes(machines):
    from distributed import LocalCluster

    answers = intruder(ports())
    assert answers.count("refused") == 4 * len(ports()) >= 16 and "ran" not in answers
    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as open_to_all:
        assert "ran" in intruder([open_to_all.scheduler_address.rpartition(":")[2]])  # the intruder knows the way


def test_other_users_can_neither_read_their_state_nor_place_modules(machines):
    for port in ports():
        for page in ("health", "info/main/workers.html", "metrics", "json/counts.json", "status"):
            with pytest.raises(OSError):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}", timeout=5)
    searched = {folder for paths in machines.ask(_search_path) for folder in (*paths, *sys.path) if "dask" in folder}
    assert searched
    for folder in searched:
        above = [folder, *map(str, Path(folder).parents)]
        assert any(
            stat.S_IMODE(os.stat(path).st_mode) == 0o700 and os.stat(path).st_uid == os.geteuid() for path in above
        )


def _search_path() -> list[str]:
    return sys.path


def test_without_options_nothing_is_started(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with cluster.opened(None, None) as machines:
        assert machines is None
    assert Machines(None, 3)._threads == 3
