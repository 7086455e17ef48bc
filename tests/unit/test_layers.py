"""The layers: gi_core knows no GL, no window, no GUI and nothing of app; the linter checks the same rule."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FORBIDDEN = ("moderngl", "glcontext", "glfw", "imgui_bundle", "OpenGL", "PIL", "app")


def test_gi_core_imports_nothing_of_the_window():
    """Import every module of gi_core in a fresh process, then list the loaded modules."""
    code = f"""
import importlib, pkgutil, sys, gi_core
count = 0
for module in pkgutil.walk_packages(gi_core.__path__, "gi_core."):
    importlib.import_module(module.name)
    count += 1
found = [name for name in {FORBIDDEN!r} if name in sys.modules]
assert not found, found
assert count > 15, count
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, timeout=120)


def test_only_one_module_knows_embree():
    importers = [p.name for p in (ROOT / "gi_core").rglob("*.py") if "embreex" in p.read_text(encoding="utf-8")]
    assert importers == ["embree.py"]
    assert not [p.name for p in (ROOT / "app").rglob("*.py") if "import embreex" in p.read_text(encoding="utf-8")]


def test_the_linter_bans_the_same_modules(tmp_path):
    banned = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["ruff"]["lint"]["flake8-tidy-imports"][
        "banned-api"
    ]
    assert set(banned) == {"moderngl", "glfw", "imgui_bundle", "app"}
    for module in banned:
        lint = [sys.executable, "-m", "ruff", "check", "--quiet", "--select", "TID251", "--stdin-filename"]
        for path, code in (("gi_core/x.py", 1), ("app/x.py", 0)):
            ran = subprocess.run(
                [*lint, path, "-"], input=f"import {module}\n", cwd=ROOT, text=True, capture_output=True
            )
            assert ran.returncode == code, (module, path, ran.stdout, ran.stderr)


def test_packages_import_only_packages_listed_before_them():
    """The order is written once, in pyproject.toml; no modules import each other in a circle."""
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, text=True, capture_output=True, timeout=120)
    assert ran.returncode == 0, ran.stdout + ran.stderr
