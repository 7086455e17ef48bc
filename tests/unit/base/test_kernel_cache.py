"""Kernels on disk: only a folder of this user is read, damaged files are compiled again, a full disk ends caching."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
RUN = """
import json, os, resource, sys
if len(sys.argv) > 1:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
from gi_core.base import jit, kernel_cache

@jit.kernel
def triple(x):
    return 3 * x

results = [triple(14), triple(0.5)]
print(json.dumps([results, sum(triple.stats.cache_hits.values()), str(jit.cache_folder()), kernel_cache.problems]))
"""
pytestmark = pytest.mark.skipif(os.name != "posix", reason="owners and modes are POSIX's")


@pytest.fixture
def run(tmp_path):
    script = tmp_path / "kernels.py"
    script.write_text(RUN)

    def called(*arguments: str, **environment):
        kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
        environment = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT), **environment}
        done = subprocess.run(
            [sys.executable, str(script), *arguments],
            env=kept | environment,
            capture_output=True,
            text=True,
            timeout=200,
        )
        assert done.returncode == 0 and done.stderr == "", done.stderr
        results, hits, folder, problems = json.loads(done.stdout)
        assert results == [42, 1.5]
        return hits, Path(folder), problems

    return called


def test_folder_is_private_and_files_are_reused(run):
    hits, folder, problems = run()
    assert (hits, problems) == (0, []) and folder.stat().st_mode & 0o777 == 0o700
    assert run() == (2, folder, [])


def trap(file: Path) -> Path:
    """Write an index that runs code when it is loaded."""

    class Trap:
        def __reduce__(self):
            return os.system, (f"touch {file}",)

    for index in file.parent.glob("cache/*/kernels-*/*/*.nbi"):
        index.write_bytes(pickle.dumps(Trap()))
    return file


@pytest.mark.parametrize("change", ["mode", "owner", "file"])
def test_foreign_files_are_not_loaded(run, tmp_path, change):
    _, folder, _ = run()
    trapped = trap(tmp_path / "ran")
    if change == "mode":
        folder.chmod(0o777)
    elif os.geteuid():
        pytest.skip("only root can give files away")
    else:
        os.chown(folder if change != "file" else next(folder.rglob("*.nbi")), 12345, -1)
    hits, elsewhere, (problem,) = run()
    assert hits == 0 and not trapped.exists() and elsewhere != folder and not elsewhere.exists()
    assert problem.startswith(f"{folder} ") and "compiled at every start" in problem and problem.isprintable()


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [b"", b"junk", 100], ids=str)
def test_damaged_files_are_compiled_again(run, kind, content):
    _, folder, _ = run()
    for file in folder.rglob(f"*.{kind}"):
        file.write_bytes(content if isinstance(content, bytes) else file.read_bytes()[:content])
    hits, _, problems = run()
    assert hits == 0 and problems == []
    assert run() == (2, folder, [])


def test_a_full_disk_ends_caching(run):
    """RLIMIT_FSIZE stands for the disk: every write beyond it fails."""
    hits, folder, problems = run("300")
    assert hits == 0 and len(problems) == 1
    assert "cannot be written (File too large)" in problems[0] and "compiled at every start" in problems[0]
    assert not [f for f in folder.rglob("*") if ".tmp." in f.name]
    assert run() == (0, folder, []) and run() == (2, folder, [])
