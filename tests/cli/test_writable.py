"""Unwritable paths are refused before the work, in one sentence; kernels work without their folder."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app import __main__ as program
from app.cli import saved_scene
from app.cli.writable import check_writable, write_whole
from app.rest.live_error import ReferenceJob
from app.rest.reference_store import ReferenceStore
from app.settings import Settings, UsageError
from gi_core.solver import Solver
from tests.support.scene_builders import coloured_room

ROOT = Path(__file__).resolve().parents[2]


def test_check_writable_leaves_no_trace(tmp_path):
    check_writable("--out", tmp_path / "a.png")
    assert not list(tmp_path.iterdir())
    (tmp_path / "a.png").write_text("old")
    check_writable("--out", tmp_path / "a.png")
    assert (tmp_path / "a.png").read_text() == "old"


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_what_a_killed_process_left_is_removed(tmp_path):
    """Parts of scenes and references stayed for ever; those of a process that runs, and other files, do."""
    code = "import os, sys, pathlib; from app.cli.writable import replacing\n"
    code += "with replacing(pathlib.Path(sys.argv[1])) as part: part.touch(); os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.toml")], cwd=ROOT)
    (left,) = tmp_path.iterdir()
    others = {tmp_path / name for name in (f"{0:08x}.{os.getpid()}.part", "a.part", "0000000g.1.part")}
    for path in others:
        path.touch()
    saved_scene.write(tmp_path / "b.toml", Settings())
    assert left.suffix == ".part" and set(tmp_path.iterdir()) == {*others, tmp_path / "b.toml"}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_a_pipe_is_written_to_and_stays(tmp_path):
    """As `bench --json /dev/stdout`; root would otherwise put a file in place of a device."""
    os.mkfifo(tmp_path / "pipe")
    end = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_whole(tmp_path / "pipe", "text")
    assert os.read(end, 10) == b"text" and (tmp_path / "pipe").is_fifo()
    os.close(end)


def test_folders_and_missing_folders_are_refused(tmp_path):
    (tmp_path / "pictures.png").mkdir()
    with pytest.raises(UsageError, match="must name a file, and .*pictures.png is a folder"):
        check_writable("--out", tmp_path / "pictures.png")
    with pytest.raises(UsageError, match="in a folder that exists"):
        check_writable("--out", tmp_path / "gone" / "a.png")


@pytest.fixture
def sealed(monkeypatch):
    """Creating a file fails, as on a read-only file system; permissions do not stop every user."""

    def touch(self, *_, **__):
        raise OSError(30, "Read-only file system", str(self))

    monkeypatch.setattr(Path, "touch", touch)


@pytest.mark.parametrize("command", [["render", "furnace", "--out"], ["bench", "cornell", "--json"]])
def test_commands_refuse_before_the_work(tmp_path, sealed, command, capsys, monkeypatch):
    def work(*_, **__):
        raise AssertionError("it has begun to work")

    monkeypatch.setattr("gi_core.files.load.load_scene", work)
    file = tmp_path / ("a.png" if command[0] == "render" else "a.json")
    assert program.main([*command, str(file)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert (
        said[-1] == f"gi-viewer: {command[-1]} {file} cannot be written (Read-only file system); name a file elsewhere"
    )


@pytest.mark.slow
def test_missing_kernel_folder_is_reported_and_harmless(tmp_path):
    """The parent folder is a file; compiled kernels go to a folder that ends with the process."""
    (tmp_path / "cache").write_text("")
    code = (
        "import json, os, numpy as np\n"
        "from gi_core.base import jit, kernel_cache\n"
        "from gi_core.base.grouping import components\n"
        "components(np.zeros((1, 2), np.int64), 2)\n"
        "problem, = kernel_cache.problems\n"
        "print(json.dumps([problem, os.environ['NUMBA_CACHE_DIR'], len(os.listdir(jit.cache_folder()))]))\n"
    )
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=kept | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    problem, folder, files = json.loads(done.stdout)
    if sys.platform == "linux":
        assert "cannot be written (Not a directory)" in problem and files
        assert not os.path.exists(folder)


def test_gathered_light_is_used_without_a_writable_folder(monkeypatch, capsys, tmp_path):
    """The folder is a file: no user can create anything in it."""
    nowhere = tmp_path / "file"
    nowhere.write_text("")
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(nowhere / "kept"))
    out = tmp_path / "a.png"
    asked = ["furnace", "--light", "best", "--photons", "2000", "--size", "32x20", "--out", str(out)]
    monkeypatch.setattr("gi_core.gather.static.ENOUGH", 0.2)
    assert program.main(["render", *asked]) == 0 and out.exists()

    solver = Solver(coloured_room(), photons=100)
    reference = ReferenceJob(solver, solver.poses, np.arange(3), *np.ones((2, 3)))
    while reference.rounds < 2:
        reference.step()
    reference.keep()
    assert reference.irradiance.any() and ReferenceStore(solver.model, solver.poses, np.arange(3)).load() is None
    capsys.readouterr()

    monkeypatch.setattr("gi_core.files.load.load_scene", None)  # refused before the work
    assert program.main(["reference", "furnace"]) == 2
    said = capsys.readouterr().err
    assert f"the folder {nowhere / 'kept'} cannot be written" in said
    assert "set GI_VIEWER_REFERENCE_DIR to another folder" in said
