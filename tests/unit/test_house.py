"""The layers: gi_core knows no GL, no window, no GUI and nothing of app; the linter checks the same rule.

Sizes of the program only fall: each measure of studies/ratchet.py is within its bound of studies/ratchet.toml.
"""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from studies import ratchet

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


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a checkout")
def test_no_large_file_is_tracked():
    """54 MB of wheels came along with a commit of all files."""
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, text=True, capture_output=True, check=True).stdout
    sizes = {name: (ROOT / name).stat().st_size for name in files.split("\0") if (ROOT / name).is_file()}
    assert len(sizes) > 500 and not {name for name, size in sizes.items() if size > 2_000_000}


def test_no_measure_exceeds_its_bound():
    measured, bounds = ratchet.findings(), ratchet.bounds()
    assert set(bounds) == {*measured, ratchet.HOPS}
    for name, (value, places) in measured.items():
        largest = "\n".join(f"{f.value:g}  {f.place}" for f in places[:5])
        assert value <= bounds[name], f"python -m studies.ratchet --places '{name}' begins\n{largest}"


def _module(source: str) -> list[ratchet.Module]:
    return [ratchet.Module("x.py", source.count("\n"), ast.parse(source))]


@pytest.mark.parametrize(
    ("line", "count"),
    [("MOST = 4", 1), ("A_B: float = -2 * 10**-3", 1), ("LOW, HIGH = 1, 2.5", 2), ("SIZES = (1, 2)", 1),
     ("MOST = OTHER * 2", 0), ("NAME = 'x'", 0), ("lower = 1", 0), ("LARGE = True", 0)],
)  # fmt: skip
def test_constants_are_names_in_capitals_with_numbers(line, count):
    assert len(ratchet.constants(_module(line))) == count


def test_names_with_two_values_are_ambiguous():
    same = _module("MOST = 1\nLEAST = 2") + _module("MOST = 1\nLEAST = 3")
    assert [f.place for f in ratchet.ambiguous_constants(same)] == ["LEAST: 2, 3"]


def test_kernels_count_their_arguments():
    source = "@kernel\ndef f(a, b, c): pass\n@inlined\ndef g(a): pass\ndef h(a, b, c, d): pass"
    assert sorted(f.value for f in ratchet.kernel_arguments(_module(source))) == [1, 3]


def test_classes_count_declared_and_assigned_fields():
    source = "class A:\n    x: int\n    def f(self, o):\n        self.y = self.x = o.z = 1\nclass _B:\n    x: int"
    assert [(f.value, f.place) for f in ratchet.class_fields(_module(source))] == [(2, "x.py: A")]


def test_vague_names_are_values_arguments_and_hidden_arguments():
    source = "given = 1\ndef f(known): pass\nf(*given)\nnot_given = 2"
    assert len(ratchet.vague_names(_module(source))) == 3


def test_a_bound_rises_with_a_reason_alone(tmp_path):
    def commit(bound: int, body: str) -> None:
        file = tmp_path / ratchet.BOUNDS.relative_to(ratchet.ROOT)
        file.parent.mkdir(exist_ok=True)
        file.write_text(f'"lines" = {bound}\n')
        for arguments in (["add", "."], ["-c", "user.name=t", "-c", "user.email=t@t", "commit", "-qm", body]):
            subprocess.run(["git", *arguments], cwd=tmp_path, check=True)

    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    commit(10, "Begin")
    commit(8, "Fall")
    commit(9, "Rise\n\nRatchet: panes replace nothing, because no other surface passes light")
    assert ratchet.unexplained_rises(tmp_path) == []
    commit(12, "Rise silently")
    assert len(ratchet.unexplained_rises(tmp_path)) == 1


def test_every_rise_of_a_bound_has_its_reason():
    """Over the history that this checkout has."""
    if subprocess.run(["git", "rev-parse"], cwd=ratchet.ROOT, capture_output=True).returncode:
        pytest.skip("not a git checkout")
    assert ratchet.unexplained_rises() == []
