"""Sizes of the program only fall: each measure of studies/ratchet.py is within its bound of studies/ratchet.toml."""

from __future__ import annotations

import ast
import subprocess

import pytest

from studies import ratchet

MEASURED = ratchet.findings()


@pytest.mark.parametrize("name", sorted(MEASURED))
def test_no_measure_exceeds_its_bound(name):
    value, places = MEASURED[name]
    largest = "\n".join(f"{f.value:g}  {f.place}" for f in places[:5])
    assert value <= ratchet.bounds()[name], f"python -m studies.ratchet --places '{name}' begins\n{largest}"


def test_every_bound_has_a_measure():
    assert set(ratchet.bounds()) == {*MEASURED, ratchet.HOPS}


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
