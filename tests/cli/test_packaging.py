"""The wheel is complete: it renders in an empty folder; the README's commands are those of CI."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from gi_core.base.jit import cache_folder

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
DATA = {"scenes": (".toml", ".glb", ".ies", ".ldt"), "shaders": (".vert", ".frag", ".glsl")}
MOST_MB = 6  # of generated meshes


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    """Build the wheel from a copy (a build leaves folders behind) and unpack it."""
    source = tmp_path_factory.mktemp("source")
    out = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("app", "gi_core", "scenes", "shaders"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(out), str(source)]
    if int(metadata.version("setuptools").split(".")[0]) >= 77:
        command.insert(4, "--no-build-isolation")  # nothing to fetch
    built = subprocess.run(command, text=True, capture_output=True, timeout=600)
    assert built.returncode == 0, built.stdout + built.stderr
    (wheel,) = out.glob("gi_viewer-*.whl")
    site = tmp_path_factory.mktemp("site")
    zipfile.ZipFile(wheel).extractall(site)
    return site


def test_every_module_scene_and_shader_is_in_the_wheel(unpacked):
    def shipped(root: Path) -> dict[str, bytes]:
        found = {}
        for package in ("app", "gi_core", "scenes", "shaders"):
            for path in (root / package).rglob("*"):
                if path.suffix in (".py", *DATA.get(package, ())):
                    found[path.relative_to(root).as_posix()] = path.read_bytes()
        return found

    assert shipped(unpacked) == shipped(ROOT)
    assert {"scenes/cornell.toml", "shaders/surface.frag"} <= shipped(unpacked).keys()


def test_the_wheel_installs_the_command_and_the_licence(unpacked):
    (info,) = unpacked.glob("*.dist-info")
    assert "gi-viewer = app.__main__:main" in (info / "entry_points.txt").read_text()
    text = (info / "METADATA").read_text(encoding="utf-8")
    assert "Requires-Python: >=3.11" in text and "License-Expression: MIT" in text
    assert "The gi-viewer authors" in next(info.rglob("LICENSE")).read_text()


# numba indexes kernels by the path of their source. The wheel's sources equal those of this checkout, so its kernels
# are read from there: compiling them again would take 100 s of CPU time.
RENDER = """
import sys
from numba.core import caching
Locator = getattr(caching, "UserProvidedCacheLocator", None) or caching._UserProvidedCacheLocator
from_wheel, (site, root) = Locator.__init__, sys.argv[1:]
Locator.__init__ = lambda self, function, file: from_wheel(self, function, file.replace(site, root))
import app, gi_core, scenes, shaders
from app.__main__ import main
for package in app, gi_core, scenes, shaders:
    assert list(package.__path__)[0].startswith(site), package
sys.exit(main("render cornell --photons 2000 --size 64x48 --seconds 0 --out a.png".split()))
"""


def test_cornell_renders_from_the_wheel_in_an_empty_folder(unpacked, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(unpacked), "NUMBA_CACHE_DIR": str(cache_folder())}
    command = [sys.executable, "-c", RENDER, str(unpacked), str(ROOT)]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, text=True, capture_output=True, timeout=600)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip() == str((tmp_path / "a.png").resolve()) and (tmp_path / "a.png").stat().st_size > 500


def test_generated_meshes_stay_small():
    assert sum(p.stat().st_size for p in (ROOT / "scenes").glob("*.glb")) < MOST_MB * 1e6


def test_no_posix_only_module_is_imported_at_the_top():
    """`resource` and its like exist on one platform: import them inside a function, behind a fallback."""
    pattern = re.compile(r"^(?:import|from) (resource|fcntl|termios|pwd|grp|pty|winreg|msvcrt)\b", re.MULTILINE)
    for package in ("app", "gi_core", "scenes"):
        for path in (ROOT / package).rglob("*.py"):
            assert not pattern.search(path.read_text(encoding="utf-8")), path


def test_the_readme_has_two_set_up_commands_and_ci_runs_the_second():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^python3 -m venv .*$", readme, re.MULTILINE)
    assert commands == [
        "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/gi-viewer",
        'python3 -m venv .venv && .venv/bin/pip install ".[test]" && .venv/bin/python -m pytest',
    ]
    assert "python3 -m venv .venv && .*pytest" in (ROOT / ".ci" / "run").read_text()
    for package in ("libgl1", "libegl1", "libx11-6", "python3-venv"):
        assert package in readme


def test_nothing_of_this_machine_is_written_down():
    for pattern in ("*.py", "*.toml", "*.md"):
        for path in (p for folder in ("app", "gi_core", "scenes", "docs") for p in (ROOT / folder).rglob(pattern)):
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"/(?:work|opt|home|root)/", text), path
    assert PROJECT["project"]["requires-python"] == ">=3.11"


def test_embreex_is_required_only_where_it_has_wheels():
    """Wheels of embreex 4.4: x86-64 of all three systems, and Apple silicon."""
    from packaging.requirements import Requirement

    (marker,) = [r.marker for r in map(Requirement, PROJECT["project"]["dependencies"]) if r.name == "embreex"]
    platforms = {
        ("linux", "x86_64"): True, ("win32", "AMD64"): True, ("darwin", "arm64"): True, ("darwin", "x86_64"): True,
        ("linux", "aarch64"): False, ("win32", "ARM64"): False,
    }  # fmt: skip
    for (system, machine), there in platforms.items():
        assert marker.evaluate({"sys_platform": system, "platform_machine": machine}) == there
