"""The report's tables 2.1 to 2.5 beside ours, as Markdown. The report's times are seconds on a computer of 2003."""

from __future__ import annotations

from typing import NamedTuple

from app.measure.bench.tables import table

RAY_CACHE, DISC_INDEX = "ray_cache", "disc_index"

# Table 2.1: simulation, illumination, total [s], error.
ESTIMATORS = {"tangent_plane": (50_000, 0.05, 0.80, 0.85, 16.10), "impact_count": (1_000_000, 1.09, 0.02, 1.11, 139.54)}

# Tables 2.2 to 2.4 a): seconds per frame by radius, of receivers "whole", "tree" or "ground".
TREE_RADII = (0.01, 0.02, 0.03, 0.04)
TREE_10000 = {
    ("whole", RAY_CACHE): (4.45, 5.70, 7.32, 9.24),
    ("whole", DISC_INDEX): (1.46, 3.43, 7.18, 17.79),
    ("tree", RAY_CACHE): (4.03, 5.34, 6.78, 8.38),
    ("tree", DISC_INDEX): (0.89, 2.78, 7.15, 18.37),
    ("ground", RAY_CACHE): (0.39, 0.46, 0.62, 0.74),
    ("ground", DISC_INDEX): (0.21, 0.33, 0.50, 0.68),
}
TREE_20000 = {("whole", RAY_CACHE): (5.50, 8.16, 11.38, 15.89), ("whole", DISC_INDEX): (2.89, 6.82, 14.12, 41.95)}
SECOND_RADII = (0.03, 0.04, 0.05, 0.10)
SECOND_20000 = {("whole", RAY_CACHE): (2.28, 2.86, 3.79, 7.83), ("whole", DISC_INDEX): (1.34, 2.17, 3.22, 10.29)}

# The same tables b): the best number of primitives per voxel. Table 2.4's columns are named as 2.2's are.
VOXELS_10000 = {"whole": (20, 20, 50, 800), "tree": (20, 10, 100, 1600), "ground": (20, 80, 120, 160)}
VOXELS_20000 = {"whole": (20, 20, 200, 1600)}
VOXELS_SECOND = {"whole": (40, 80, 160, 32000)}

# Table 2.5: simulation and illumination [s], at the start and per frame.
PRETESTS = {
    "badouel": (10.34, 679.44, 1.02, 67.90),
    "moeller_trumbore": (10.29, 666.34, 0.98, 67.27),
    "pluecker": (10.40, 716.47, 1.05, 68.66),
    "none": (10.38, 678.75, 1.05, 68.00),
}
NAMES = {RAY_CACHE: "ray cache", DISC_INDEX: "disc indexing"}


class Times(NamedTuple):
    """Cost of one search at one radius."""

    every: float  # s, all segments
    frame: float  # s, the segments that a frame changes
    cells: tuple[float, float] | None  # of a grid: edge [radii], discs per occupied cell


def markdown(facts: dict, found: dict, pretests: dict, estimators: dict) -> str:
    """Return the whole text; found: `Times` by scene and photons, then by (receivers, search, radius)."""
    tree, more, second = found["tree 10000"], found["tree 20000"], found["second 20000"]
    parts = [
        _head(facts),
        _estimators(estimators),
        _section("Table 2.2: tree, 10,000 photons", _searches(tree, TREE_10000, TREE_RADII)),
        _voxels(tree, VOXELS_10000, TREE_RADII),
        _section("Table 2.3: tree, 20,000 photons", _searches(more, TREE_20000, TREE_RADII)),
        _voxels(more, VOXELS_20000, TREE_RADII),
        _section("Table 2.4: second tree, 20,000 photons", _searches(second, SECOND_20000, SECOND_RADII)),
        _voxels(second, VOXELS_SECOND, SECOND_RADII),
        _section("Where the two cross", "\n".join(_crossovers(found))),
        _pretests(pretests),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _head(facts: dict) -> str:
    return (
        f"# Tables 2.1 to 2.5 of the report\n\n{facts['machine']}. Our times are milliseconds, the report's (in "
        'brackets) seconds of a computer of 2003. Our times are for all segments of the photons, and after "frame" '
        "for the segments that one move of the mobile removes and adds at 20,000 photons. The report times a frame "
        f"and gives no number of rays. Tree scene: {facts['tree']}, as many as the report's; leaves are two-sided "
        f"here. Second tree: {facts['second']} (the report gives no number)."
    )


def _section(title: str, body: str) -> str:
    return f"## {title}\n\n{body}"


def _estimators(measured: dict) -> str:
    lines = []
    for name, (photons, *theirs) in ESTIMATORS.items():
        a, b, error = measured[name]
        lines.append([f"{name}, {photons:,} photons", *(f"{x:.3g} ({y:g})" for x, y in
                      zip((a, b, a + b), theirs[:3], strict=True)), f"{error:.1f} % ({theirs[3]:g} %)"])  # fmt: skip
    body = table(["", "simulation", "illumination", "total", "error"], lines)
    note = "Error against tangent_plane with 1,000,000 photons (the report: 100 million), radius 1 %; all threads."
    return _section("Table 2.1: frames by estimator", f"{body}\n\n{note}")


def _searches(measured: dict, theirs: dict, radii) -> str:
    lines = []
    for receivers in dict.fromkeys(key[0] for key in theirs):
        for search in (RAY_CACHE, DISC_INDEX):
            cells = []
            for k, r in enumerate(radii):
                t = measured[receivers, search, r]
                cells.append(f"{1e3 * t.every:.3g}, frame {1e3 * t.frame:.2g} ({theirs[receivers, search][k]:g})")
            lines.append([f"{NAMES[search]}, {receivers}", *cells])
    return table(["receivers / radius", *(f"{r:g}" for r in radii)], lines)


def _voxels(measured: dict, theirs: dict, radii) -> str:
    lines = []
    for receivers, numbers in theirs.items():
        cells = []
        for k, r in enumerate(radii):
            edge, discs = measured[receivers, DISC_INDEX, r].cells
            cells.append(f"{discs:.0f}, {edge:g} radii ({numbers[k]})")
        lines.append([f"discs per voxel, {receivers}", *cells])
    return table(["b) best", *(f"{r:g}" for r in radii)], lines)


def _crossovers(found: dict) -> list[str]:
    out = []
    for key, name in (("tree 10000", "Tree, 10,000 photons, report between 0.03 and 0.04"),
                      ("tree 20000", "Tree, 20,000 photons, report between 0.02 and 0.03"),
                      ("second 20000", "Second tree, 20,000 photons, report between 0.05 and 0.10")):  # fmt: skip
        for which in ("every", "frame"):
            scope = "all segments" if which == "every" else "a frame"
            out.append(f"- {name}, {scope}: {crossover(found[key], which)}")
    return out


def crossover(measured: dict, which: str) -> str:
    """Return the radius from which the ray cache is faster for all receivers, interpolated, in words."""
    radii = sorted(r for receivers, search, r in measured if receivers == "whole" and search == RAY_CACHE)
    gain = [getattr(measured["whole", DISC_INDEX, r], which) / getattr(measured["whole", RAY_CACHE, r], which)
            for r in radii]  # fmt: skip
    ratios = ", ".join(f"{g:.2f} at {r:g}" for g, r in zip(gain, radii, strict=True))
    faster = [g > 1 for g in gain]
    if all(faster) or not any(faster):
        word = "the ray cache is faster" if all(faster) else "disc indexing is faster"
        return f"{word} at every radius (disc indexing time / ray cache time: {ratios})"
    k = faster.index(not faster[0])
    at = radii[k - 1] + (radii[k] - radii[k - 1]) * (1 - gain[k - 1]) / (gain[k] - gain[k - 1])
    return f"they cross at {at:.3f} (disc indexing time / ray cache time: {ratios})"


def _pretests(measured: dict) -> str:
    lines = []
    for name, seconds in PRETESTS.items():
        cells = [f"{1e3 * measured[search, name][k]:.3g} ({seconds[1 + 2 * k]:g})" for search in NAMES for k in (0, 1)]
        lines.append([name, *cells])
    head = ["pre-test", "ray cache, all", "frame", "disc indexing, all", "frame"]
    note = (
        "Illumination of the tree scene, radius 1 %, 10,000 photons; the report gives no number of photons. "
        "Sixteen disc tests run at once without a branch here: a pre-test costs as much as it saves."
    )
    return _section("Table 2.5: pre-intersection tests", f"{table(head, lines)}\n\n{note}")
