"""More photons than fit into memory: as many as fit are traced, and the solver reports it."""

import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from app.session.log import Log
from gi_core.base import memory
from gi_core.estimators import ESTIMATORS
from gi_core.frames import background
from gi_core.frames.background import Photons
from gi_core.photons.paths import PathStore
from gi_core.retrace.cuts import CoarseStore
from gi_core.solver import Solver
from tests.support.scene_builders import coloured_room, solve

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[3]


MACHINE = {"proc/meminfo": "MemTotal: 9 kB\nMemAvailable:     4000 kB\n"}
GROUP = {"proc/self/cgroup": "0::/a/b\n"}
STAT = "inactive_file 200000\ntotal_inactive_file 300000\n"
OLD = {"proc/self/cgroup": "3:cpu:/\n5:cpuset,memory:/docker/7\n0::/\n"}


@pytest.mark.parametrize(
    ("files", "left"),
    [
        ({}, None),
        (MACHINE, 4_096_000),
        ({"proc/meminfo": "garbage"}, None),
        (MACHINE | GROUP, 4_096_000),
        (MACHINE | GROUP | {"a/b/memory.max": "3000000\n", "a/b/memory.current": "1000000\n"}, 2_000_000),
        (MACHINE | GROUP | {"a/b/memory.max": "max\n", "a/b/memory.current": "1000000\n"}, 4_096_000),
        (MACHINE | GROUP | {"a/b/memory.max": "1\n", "a/b/memory.current": "1000000\n"}, 0),
        (GROUP | {"a/memory.max": "3000000\n", "a/memory.current": "1000000\n", "a/memory.stat": STAT}, 2_200_000),
        (GROUP | {"memory.max": "3000000\n", "memory.current": "1000000\n"}, 2_000_000),  # a container's own view
        (OLD | {"memory/memory.limit_in_bytes": "500000", "memory/memory.usage_in_bytes": "1"}, 499_999),
        (
            OLD
            | {
                "memory/docker/7/memory.limit_in_bytes": "500000",
                "memory/docker/7/memory.usage_in_bytes": "400000",
                "memory/docker/7/memory.stat": STAT,
                "memory/memory.limit_in_bytes": str(2**63 - 4096),
                "memory/memory.usage_in_bytes": "1",
            },
            400_000,
        ),
    ],
)
def test_least_of_machine_and_groups(files, left, tmp_path, monkeypatch):
    for name, text in files.items():
        file = tmp_path / (name if name.startswith("proc") else f"sys/fs/cgroup/{name}")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    monkeypatch.setattr(memory, "_ROOT", tmp_path)
    assert memory.available() == left


limited = pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS")
LIMITED = """
import resource, sys
from {module} import {name}
{name}{before}
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {spare},) * 2)
"""


def run_limited(code: str, spare: int, module: str = "gi_core.solver", name: str = "Solver", before: str = ""):
    """Run code in a process that may allocate only `spare` bytes more than its imports."""
    code = LIMITED.format(module=module, name=name, spare=spare, before=before) + code
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)


@limited
def test_least_of_address_space():
    done = run_limited("from gi_core.base import memory\nprint(memory.available())", 300_000_000)
    assert 200_000_000 < int(done.stdout) <= 300_000_000


@limited
def test_photons_fit_the_address_space():
    """Paths of twenty million photons need gigabytes; those that fit are shown, without a traceback."""
    code = """
from gi_core.frames import background
background.SPARE_MEMORY = 200 << 20
from tests.support.scene_builders import coloured_room
solver = Solver(coloured_room(), "impact_count", photons=20_000_000, radius=0.1, threads=1)
solver.solve()
print(solver.frame.photons, solver.frame.store.memory_full)
"""
    done = run_limited(code, 500 << 20)
    assert done.stderr == ""
    photons, full = done.stdout.split()
    assert 20_000 < int(photons) < 20_000_000 and full == "True"


@limited
def test_command_traces_the_photons_that_fit():
    """At 40 MB, `bench` either measures as many photons as fit, with one line about them, or ends in one sentence."""
    code = "sys.exit(main(['bench', 'cornell', '--photons', '5000000']))"
    done = run_limited(code, 40 << 20, "app.__main__", "main", "(['info', 'furnace', '--photons', '100'])")
    lines = done.stderr.strip().splitlines()
    assert done.returncode in (0, 2) and lines
    full = "gi-viewer: memory holds no more than" if done.returncode == 0 else "gi-viewer: memory is full ("
    assert lines[-1].startswith(full)


@limited
def test_command_ends_in_one_sentence(tmp_path):
    """At 80 MB, of which kernels take some 30: with 40, LLVM sometimes aborts where it loads them."""
    words = ["render", "cornell", "--photons", "500000", "--out", str(tmp_path / "a.png"), "--size", "16384x16384"]
    words += ["--seconds", "0"]
    code = f"sys.exit(main({words!r}))"
    done = run_limited(code, 80 << 20, "app.__main__", "main", "(['info', 'furnace', '--photons', '100'])")
    assert done.returncode == 2, done.stderr
    *warnings, line = done.stderr.strip().splitlines()
    assert line.startswith("gi-viewer: memory is full (")
    assert all(text.startswith("gi-viewer: memory holds no more than") for text in warnings)


def test_a_failed_allocation_leaves_the_solver_whole(estimator, monkeypatch):
    """At every place where photons are stored; the picture stays, and more photons then give the bits of a new one."""
    solver = solve(coloured_room(), estimator, photons=2000, radius=0.15, neighbours=50)
    light = solver.irradiance
    for where, name in ((CoarseStore, "append"), (PathStore, "reserve"), (PathStore, "append"), (Photons, "_estimate")):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, Mock(side_effect=MemoryError))
            solver.configure(photons=6000)
            with pytest.raises(MemoryError):
                solver.solve()
            assert solver.irradiance is light
    solver.solve()
    whole = solve(coloured_room(), estimator, photons=6000, radius=0.15, neighbours=50)
    assert np.array_equal(solver.irradiance, whole.irradiance)
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_full_memory_is_one_line_of_the_log(capsys):
    log = Log()
    log.failure("refinement", MemoryError("Unable to allocate 9 GiB"))
    assert log.last.text.startswith("refinement: memory is full (Unable to allocate 9 GiB): take fewer photons")
    log.failure("refinement", MemoryError())
    assert "memory is full (an allocation failed)" in log.last.text
    assert capsys.readouterr().err == ""


def test_photons_are_limited_by_memory(estimator, monkeypatch):
    wanted = Solver(coloured_room(), estimator, photons=40_000, radius=0.15)
    taken = [0]
    real = background.PathStore.append

    def counted(store, *given):
        real(store, *given)
        taken[0] = store.photons

    a_photon = 4 * (background.BYTES_PER_VERTEX + ESTIMATORS[estimator](wanted.model, wanted.setting).bytes_per_hit)
    monkeypatch.setattr(background.PathStore, "append", counted)
    monkeypatch.setattr(memory, "available", lambda: background.SPARE_MEMORY + (20_000 - taken[0]) * a_photon)
    assert list(wanted.solve_steps())[-1].stage == "done"
    assert wanted.frame.store.memory_full
    assert 10_000 < wanted.frame.photons < 40_000
    assert np.array_equal(wanted.irradiance, wanted.from_scratch())
    again = [p.picture for p in wanted.solve_steps()]
    assert not any(again)  # nothing to do
    monkeypatch.undo()
    wanted.solve()
    assert not wanted.frame.store.memory_full
    assert wanted.frame.photons == 40_000
