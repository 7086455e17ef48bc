"""Sizes of the program that may only fall: `python -m studies.ratchet [--write]`.

`ratchet.toml` beside this file holds a bound per measure. A test fails where a measure exceeds its bound, and where a
commit raises a bound without a line "Ratchet: REASON" in its body. The reason names the mechanism that the new one
replaces, or says why none can be replaced. `--write` lowers bounds to the measures. Exits with 1 if one is exceeded.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
BOUNDS = Path(__file__).with_name("ratchet.toml")
PRODUCT = "app", "gi_core"
VAGUE = frozenset(("given", "some", "found", "known", "others", "there", "then"))
HOPS = "modules from pose to pixel"  # measured by studies.hops, which drives a window
REASON = re.compile(r"^Ratchet: \S", re.MULTILINE)


class Module(NamedTuple):
    """A source file of the product."""

    path: str  # from the root of the repository
    lines: int
    tree: ast.Module


class Finding(NamedTuple):
    """A place in the source, and its value of a measure."""

    value: float
    place: str


def modules(root: Path = ROOT) -> list[Module]:
    """Return the product's files."""
    paths = sorted(path for package in PRODUCT for path in (root / package).rglob("*.py"))
    sources = ((path, path.read_text(encoding="utf-8")) for path in paths)
    return [Module(p.relative_to(root).as_posix(), s.count("\n"), ast.parse(s)) for p, s in sources]


def _is_literal(value: ast.expr | None) -> bool:
    """Whether an expression is numbers alone, and operators, tuples and lists of them."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float | complex) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return _is_literal(value.operand)
    if isinstance(value, ast.BinOp):
        return _is_literal(value.left) and _is_literal(value.right)
    return isinstance(value, ast.Tuple | ast.List) and bool(value.elts) and all(map(_is_literal, value.elts))


def _constants(module: Module) -> Iterator[tuple[str, str]]:
    """Yield name and value of each name in capitals that the module assigns numbers to."""
    for node in module.tree.body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        for target in targets:
            names, values = [target], [node.value]
            if isinstance(target, ast.Tuple):
                names = target.elts
                values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value] * len(names)
            for name, value in zip(names, values, strict=False):
                if isinstance(name, ast.Name) and name.id.isupper() and len(name.id) > 1 and _is_literal(value):
                    yield name.id, ast.unparse(value)


def constants(source: list[Module]) -> list[Finding]:
    """Return the numeric constants: names in capitals at module level whose value is made of literals."""
    return [Finding(1, f"{m.path}: {name} = {value}") for m in source for name, value in _constants(m)]


def ambiguous_constants(source: list[Module]) -> list[Finding]:
    """Return the names of constants that have several values."""
    values: dict[str, set[str]] = {}
    for m in source:
        for name, value in _constants(m):
            values.setdefault(name, set()).add(value)
    return [Finding(1, f"{name}: {', '.join(sorted(v))}") for name, v in sorted(values.items()) if len(v) > 1]


def kernel_arguments(source: list[Module]) -> list[Finding]:
    """Return the number of arguments of each kernel."""
    out = []
    for m in source:
        for node in ast.walk(m.tree):
            if isinstance(node, ast.FunctionDef):
                decorators = {
                    getattr(d, "id", getattr(getattr(d, "func", None), "id", "")) for d in node.decorator_list
                }
                if decorators & {"kernel", "allocating", "inlined"}:
                    out.append(Finding(len(node.args.args), f"{m.path}: {node.name}"))
    return out


def class_fields(source: list[Module]) -> list[Finding]:
    """Return the number of fields of each public class: those declared, and attributes that its methods assign."""
    out = []
    for m in source:
        for node in ast.walk(m.tree):
            if not isinstance(node, ast.ClassDef) or node.name.startswith("_"):
                continue
            fields = {s.target.id for s in node.body if isinstance(s, ast.AnnAssign) and isinstance(s.target, ast.Name)}
            for part in ast.walk(node):
                if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Store):
                    if isinstance(part.value, ast.Name) and part.value.id == "self":
                        fields.add(part.attr)
            out.append(Finding(len(fields), f"{m.path}: {node.name}"))
    return out


def vague_names(source: list[Module]) -> list[Finding]:
    """Return the values named by a word that says nothing of them, and calls that hide arguments behind such a word."""
    out = []
    for m in source:
        for node in ast.walk(m.tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in VAGUE:
                out.append(Finding(1, f"{m.path}:{node.lineno}: {node.id}"))
            elif isinstance(node, ast.arg) and node.arg in VAGUE:
                out.append(Finding(1, f"{m.path}:{node.lineno}: {node.arg}"))
            elif isinstance(node, ast.Starred) and isinstance(node.ctx, ast.Load):
                if isinstance(node.value, ast.Name) and node.value.id in VAGUE:
                    out.append(Finding(1, f"{m.path}:{node.lineno}: *{node.value.id}"))
    return out


def words(root: Path = ROOT) -> list[Finding]:
    """Return the words of each document."""
    paths = [root / "README.md", root / "CONTRIBUTING.md", *sorted((root / "docs").rglob("*.md"))]
    return [Finding(len(p.read_text(encoding="utf-8").split()), p.relative_to(root).as_posix()) for p in paths]


def lines_of(folder: str, root: Path = ROOT) -> list[Finding]:
    """Return the lines of each Python file of a folder."""
    paths = sorted((root / folder).rglob("*.py"))
    return [Finding(p.read_text(encoding="utf-8").count("\n"), p.relative_to(root).as_posix()) for p in paths]


def findings(root: Path = ROOT) -> dict[str, tuple[float, list[Finding]]]:
    """Return each measure that needs the source alone: its value and the places behind it, largest first."""
    source, documents = modules(root), words(root)
    sums = {
        "lines": [Finding(m.lines, m.path) for m in source],
        "files": [Finding(1, m.path) for m in source],
        "constants": constants(source),
        "ambiguous constants": ambiguous_constants(source),
        "vague names": vague_names(source),
        "lines of tests": lines_of("tests", root),
        "lines of studies": lines_of("studies", root),
        "words of documents": documents,
        "words of README": [w for w in documents if w.place == "README.md"],
        "words of decisions": [w for w in documents if w.place.startswith("docs/decisions/")],
        "pages of decisions": [Finding(1, w.place) for w in documents if w.place.startswith("docs/decisions/")],
    }
    largest = {"kernel arguments": kernel_arguments(source), "class fields": class_fields(source)}
    out = {name: (sum(f.value for f in places), places) for name, places in sums.items()}
    out |= {name: (max(f.value for f in places), places) for name, places in largest.items()}
    return {name: (value, sorted(places, key=lambda f: -f.value)) for name, (value, places) in out.items()}


def bounds(text: str | None = None) -> dict[str, float]:
    """Return the bound per measure, of ratchet.toml or of the text of an earlier one."""
    return tomllib.loads(BOUNDS.read_text(encoding="utf-8") if text is None else text)


def unexplained_rises(root: Path = ROOT) -> list[str]:
    """Return the commits that raised a bound without a reason in their body."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=root, text=True, capture_output=True, check=True).stdout

    path = BOUNDS.relative_to(ROOT).as_posix()
    out, later = [], None
    for commit in git("log", "--format=%H", "--", path).split():
        now = bounds(git("show", f"{commit}:{path}"))
        if later is not None:
            raised = [name for name in now if later[1].get(name, 0) > now[name]]
            if raised and not REASON.search(git("log", "-1", "--format=%b", later[0])):
                out.append(f"{later[0][:9]} raises {', '.join(raised)}: write a line 'Ratchet: REASON' in its body")
        later = commit, now
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="lower the bounds to what is measured")
    parser.add_argument("--places", metavar="MEASURE", help="print the places behind a measure")
    arguments = parser.parse_args()
    measured, limits = findings(), bounds()
    if arguments.places:
        print("\n".join(f"{f.value:6g}  {f.place}" for f in measured[arguments.places][1]))
        return 0
    above = {name for name, (value, _) in measured.items() if value > limits[name]}
    for name, limit in limits.items():
        value = f"{measured[name][0]:g}" if name in measured else "by studies.hops"
        print(f"{name:26} {value:>16}  bound {limit:g}{': EXCEEDED' * (name in above)}")
    if arguments.write:
        lowered = {name: min(limit, measured[name][0]) if name in measured else limit for name, limit in limits.items()}
        BOUNDS.write_text("".join(f'"{name}" = {int(value)}\n' for name, value in lowered.items()), encoding="utf-8")
    return 1 if above else 0


if __name__ == "__main__":
    sys.exit(main())
