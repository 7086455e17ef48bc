"""Kernels on disk: only a folder of this user is read, damaged files are compiled again, a full disk ends caching."""

import json
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gi_core.base import kernel_cache
from gi_core.base.jit import cache_folder, source_hash

ROOT = Path(__file__).resolve().parents[3]
RUN = """
import json, os, resource, sys
if len(sys.argv) > 1:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
from gi_core.base import jit, kernel_cache

@jit.kernel
def triple(x):
    return 3 * x

@jit.kernel
def double(x):
    return 2 * x

@jit.kernel
def same(x):
    return x

results = [triple(14), triple(0.5), double(3), same(7)]
hits = [sum(kernel.stats.cache_hits.values()) for kernel in (triple, double, same)]
print(json.dumps([results, hits, str(jit.cache_folder()), kernel_cache.problems]))
"""
NONE, ALL = [0, 0, 0], [2, 1, 1]  # cache hits of the kernels
pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name != "posix", reason="owners and modes are POSIX's")]


@pytest.fixture(scope="module")
def started(tmp_path_factory) -> Callable:
    """Return a function that runs the kernels with a folder for caches, and fills one such folder."""
    script = tmp_path_factory.mktemp("kernels") / "kernels.py"
    script.write_text(RUN)

    def called(caches: Path, *arguments: str):
        environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
        environment |= {"XDG_CACHE_HOME": str(caches), "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [sys.executable, str(script), *arguments], env=environment, capture_output=True, text=True, timeout=200
        )
        assert done.returncode == 0 and done.stderr == "", done.stderr
        results, hits, folder, problems = json.loads(done.stdout)
        assert results == [42, 1.5, 6, 7]
        return hits, Path(folder), problems

    return called


@pytest.fixture
def run(started, tmp_path):
    """Return a function that runs the kernels in the cache folder of a test."""
    return lambda *arguments: started(tmp_path / "cache", *arguments)


@pytest.fixture(scope="module")
def filled(started, tmp_path_factory) -> Path:
    """Fill a folder for caches, and test that kernels are compiled once."""
    caches = tmp_path_factory.mktemp("filled")
    hits, folder, problems = started(caches)
    assert (hits, problems) == (NONE, []) and folder.stat().st_mode & 0o777 == 0o700
    return caches


@pytest.fixture
def folder(filled, tmp_path) -> Path:
    """Copy the filled folder to that of a test."""
    shutil.copytree(filled, tmp_path / "cache")
    (folder,) = (tmp_path / "cache").glob("*/kernels-*")
    return folder


def test_folder_is_private_and_files_are_reused(run, folder):
    assert run() == (ALL, folder, [])


def test_an_empty_variable_is_as_none(monkeypatch, tmp_path):
    """An empty path is the current folder: kernels of the checkout would lie among its files."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    assert cache_folder().is_absolute() and cache_folder().name == f"kernels-{source_hash()}"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert cache_folder() == tmp_path


def trap(file: Path) -> Path:
    """Write an index that runs code when it is loaded."""

    class Trap:
        def __reduce__(self):
            return os.system, (f"touch {file}",)

    for index in file.parent.glob("cache/*/kernels-*/*/*.nbi"):
        index.write_bytes(pickle.dumps(Trap()))
    return file


def test_foreign_files_are_not_loaded(run, folder, tmp_path):
    trapped = trap(tmp_path / "ran")
    folder.chmod(0o777)
    hits, elsewhere, (problem,) = run()
    assert hits == NONE and not trapped.exists() and elsewhere != folder and not elsewhere.exists()
    assert problem.startswith(f"{folder} ") and "compiled at every start" in problem and problem.isprintable()


@pytest.mark.parametrize("change", ["mode of a file", "mode of a subfolder", "owner", "file"])
def test_a_folder_of_foreign_files_is_replaced(folder, change, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    monkeypatch.setattr(kernel_cache, "problems", [])
    assert kernel_cache.usable_folder(folder) == folder and not kernel_cache.problems
    if change.startswith("mode of"):  # as of umask 0
        folder.chmod(0o755)
        next(folder.rglob("*.nbc") if change == "mode of a file" else folder.glob("*/")).chmod(0o777)
    elif os.geteuid():
        pytest.skip("only root can give files away")
    else:
        os.chown(folder if change != "file" else next(folder.rglob("*.nbi")), 12345, -1)
    elsewhere = kernel_cache.usable_folder(folder)
    assert elsewhere != folder and not list(elsewhere.iterdir()) and os.environ["NUMBA_CACHE_DIR"] == str(elsewhere)
    (problem,) = kernel_cache.problems
    assert problem.startswith(f"{folder} ") and "compiled at every start" in problem


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_damaged_files_are_compiled_again(run, folder, kind):
    """Empty, junk or truncated: each kernel's files in another way."""
    for kernel, content in {"triple": b"", "double": b"junk", "same": 100}.items():
        files = list(folder.rglob(f"*{kernel}*.{kind}"))
        assert files
        for file in files:
            file.write_bytes(content if isinstance(content, bytes) else file.read_bytes()[:content])
    hits, _, problems = run()
    assert hits == NONE and problems == []
    assert run() == (ALL, folder, [])


def test_a_full_disk_ends_caching(run):
    """RLIMIT_FSIZE stands for the disk: every write beyond it fails."""
    hits, folder, problems = run("300")
    assert hits == NONE and len(problems) == 1
    assert "cannot be written (File too large)" in problems[0] and "compiled at every start" in problems[0]
    assert not [f for f in folder.rglob("*") if ".tmp." in f.name]
    assert run() == (NONE, folder, []) and run() == (ALL, folder, [])
