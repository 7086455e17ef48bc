"""The report's tables 2.1 to 2.5 and ours as Markdown."""

from __future__ import annotations

from typing import NamedTuple

from app.measure import report_facts as report
from app.measure.bench.jobs import section as jobs_section
from app.measure.bench.tables import table
from app.measure.report_facts import DISC_INDEX, RAY_CACHE

NAMES = {RAY_CACHE: "ray cache", DISC_INDEX: "disc indexing"}


class Times(NamedTuple):
    """What one search takes at one radius."""

    every: float  # s, all segments
    frame: float  # s, those that a frame changes
    segments: int
    crossings: int
    cells: tuple[float, float] | None  # edge in radii and discs a full cell, of a grid


def markdown(facts: dict, found: dict, pretests: dict, alone: dict, estimators: dict, jobs: list) -> str:
    """Return the whole text."""
    tree, more = found["tree 10000"], found["tree 20000"]
    second, tree_radii, second_radii = found["second 20000"], report.TREE_RADII, report.SECOND_RADII
    parts = [
        _head(facts),
        _estimators(estimators),
        _section("Table 2.2: tree, 10,000 photons", _searches(tree, report.TREE_10000, tree_radii)),
        _voxels(tree, report.VOXELS_10000, tree_radii),
        _section("Table 2.3: tree, 20,000 photons", _searches(more, report.TREE_20000, tree_radii)),
        _voxels(more, report.VOXELS_20000, tree_radii),
        _section("Table 2.4: second tree, 20,000 photons", _searches(second, report.SECOND_20000, second_radii)),
        _voxels(second, report.VOXELS_SECOND, second_radii),
        _section("Where the two cross", "\n".join(_crossovers(found))),
        _pretests(pretests, alone),
        jobs_section(jobs),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _head(facts: dict) -> str:
    return (
        f"# Tables 2.1 to 2.5 of the report\n\n{facts['machine']}. Our times are milliseconds, the report's (in "
        'brackets) seconds of a computer of 2003. Ours differs: "all" is every segment of so many photons; "frame" '
        "the segments that one move of the mobile takes out and puts in at 20,000 photons. The report's time is a "
        f"frame's, and it does not say of how many rays. Tree scene: {facts['tree']}, as many as the report's; leaves "
        f"are two-sided here. Second tree: {facts['second']} (the report gives no number)."
    )


def _section(title: str, body: str) -> str:
    return f"## {title}\n\n{body}"


def _estimators(measured: dict) -> str:
    lines = []
    for name, (photons, *told) in report.ESTIMATORS.items():
        a, b, error = measured[name]
        lines.append([f"{name}, {photons:,} photons", *(f"{x:.3g} ({y:g})" for x, y in
                      zip((a, b, a + b), told[:3], strict=True)), f"{error:.1f} % ({told[3]:g} %)"])  # fmt: skip
    body = table(["", "simulation", "illumination", "total", "error"], lines)
    note = "Error against tangent_plane with 1,000,000 photons (the report: 100 million), radius 1 %; all threads."
    return _section("Table 2.1: a frame by estimator", f"{body}\n\n{note}")


def _searches(measured: dict, told: dict, radii) -> str:
    lines = []
    for receivers in dict.fromkeys(key[0] for key in told):
        for search in (RAY_CACHE, DISC_INDEX):
            cells = []
            for k, r in enumerate(radii):
                t = measured[receivers, search, r]
                cells.append(f"{1e3 * t.every:.3g}, frame {1e3 * t.frame:.2g} ({told[receivers, search][k]:g})")
            lines.append([f"{NAMES[search]}, {receivers}", *cells])
    return table(["receivers / radius", *(f"{r:g}" for r in radii)], lines)


def _voxels(measured: dict, told: dict, radii) -> str:
    lines = []
    for receivers, numbers in told.items():
        cells = []
        for k, r in enumerate(radii):
            edge, discs = measured[receivers, DISC_INDEX, r].cells
            cells.append(f"{discs:.0f}, {edge:g} radii ({numbers[k]})")
        lines.append([f"discs a voxel, {receivers}", *cells])
    return table(["b) best", *(f"{r:g}" for r in radii)], lines)


def _crossovers(found: dict) -> list[str]:
    out = []
    for key, name in (("tree 10000", "Tree, 10,000 photons, report between 0.03 and 0.04"),
                      ("tree 20000", "Tree, 20,000 photons, report between 0.02 and 0.03"),
                      ("second 20000", "Second tree, 20,000 photons, report between 0.05 and 0.10")):  # fmt: skip
        for which in ("every", "frame"):
            what = "all segments" if which == "every" else "a frame"
            out.append(f"- {name}, {what}: {crossover(found[key], which)}")
    return out


def crossover(measured: dict, which: str) -> str:
    """Say from which radius the ray cache is faster for the whole scene; between two radii in proportion."""
    radii = sorted(r for receivers, search, r in measured if receivers == "whole" and search == RAY_CACHE)
    gain = [getattr(measured["whole", DISC_INDEX, r], which) / getattr(measured["whole", RAY_CACHE, r], which)
            for r in radii]  # fmt: skip
    told = ", ".join(f"{g:.2f} at {r:g}" for g, r in zip(gain, radii, strict=True))
    faster = [g > 1 for g in gain]
    if all(faster) or not any(faster):
        word = "the ray cache is faster" if all(faster) else "disc indexing is faster"
        return f"{word} at every radius (disc indexing took {told} times what the ray cache did)"
    k = faster.index(not faster[0])
    at = radii[k - 1] + (radii[k] - radii[k - 1]) * (1 - gain[k - 1]) / (gain[k] - gain[k - 1])
    return f"they cross at {at:.3f} (disc indexing took {told} times what the ray cache did)"


def _pretests(measured: dict, alone: dict) -> str:
    lines = []
    for name, told in report.PRETESTS.items():
        cells = [f"{1e3 * measured[search, name][k]:.3g} ({told[1 + 2 * k]:g})" for search in NAMES for k in (0, 1)]
        lines.append([name, *cells, f"{alone[name]:.2f}"])
    head = ["pre-test", "ray cache, all", "frame", "disc indexing, all", "frame", "a pair alone, ns"]
    note = (
        "Illumination of the tree scene, radius 1 %, 10,000 photons (the report's number of photons is not told). "
        "A disc test here is done 16 at a time without a branch: a pre-test costs as much as what it saves."
    )
    return _section("Table 2.5: pre-intersection tests", f"{table(head, lines)}\n\n{note}")
