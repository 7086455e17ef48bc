"""`gi-viewer bench --compare A.json B.json`: B / A of every number that both files have."""

from __future__ import annotations

import json
from pathlib import Path

from app.settings import UsageError

KINDS = {"gi-viewer bench": "frame_ms", "gi-viewer sweep": "rows"}  # first words of the format -> a key it has
NOT_COMPARED = ("asked", "seed")  # what was asked for, not measured


def compare(a: Path, b: Path) -> list[str]:
    """Return the lines to print. Raises UsageError for a file that is not ours, or of the other kind."""
    first, second = _read(a), _read(b)
    kinds = [_kind(first), _kind(second)]
    if kinds[0] != kinds[1]:
        raise UsageError(f"{a} and {b} cannot be compared: one is a single run, the other a sweep")
    x, y = numbers(first), numbers(second)
    both = [name for name in x if name in y]
    if not both:
        raise UsageError(f"{a} and {b} have no number in common")
    width = max(len(name) for name in both) + 2
    lines = [f"{'A':<3}{a}, commit {first.get('commit') or 'unknown'}"]
    lines.append(f"{'B':<3}{b}, commit {second.get('commit') or 'unknown'}")
    lines.append(f"{'':<{width}}{'A':>14}{'B':>14}{'B / A':>10}")
    for name in both:
        ratio = f"{y[name] / x[name]:.3f}" if x[name] else "1.000" if y[name] == 0 else ""
        lines.append(f"{name:<{width}}{_short(x[name]):>14}{_short(y[name]):>14}{ratio:>10}")
    return lines


def numbers(value: dict, path: str = "") -> dict[str, float]:
    """Return every number in nested dicts by its dotted path; yes and no are no numbers."""
    out: dict[str, float] = {}
    for name, item in value.items():
        if name in NOT_COMPARED:
            continue
        below = f"{path}.{name}" if path else str(name)
        if isinstance(item, dict):
            out |= numbers(item, below)
        elif isinstance(item, (int, float)) and not isinstance(item, bool):
            out[below] = float(item)
    return out


def _read(file: Path) -> dict:
    """Return what a file of ours holds."""
    try:
        value = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:  # neither JSON nor text
        value = None
    if not isinstance(value, dict) or _kind(value) is None:
        raise UsageError(f"{file} was not written by `gi-viewer bench --json` or `bench --sweep`")
    return value


def _kind(value: dict) -> str | None:
    for kind, key in KINDS.items():
        if str(value.get("format", "")).startswith(kind) and isinstance(value.get(key), dict):
            return kind
    return None


def _short(x: float) -> str:
    return f"{x:,.0f}" if abs(x) >= 1e4 or x == int(x) else f"{x:.4g}"
