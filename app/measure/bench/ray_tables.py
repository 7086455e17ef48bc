"""The report's space partitionings (section 3.4.1) beside bvh and Embree: a table per scene, and a plot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.progress import Bar
from app.draw.camera import from_camera, scene_bounds
from app.measure.chart.figure import need_matplotlib
from app.measure.tables import markdown_table

if TYPE_CHECKING:
    from gi_core.instruments.timing import Cost, Structure
    from gi_core.model import Model
    from gi_core.scene.types import Camera

SCENES = ("cornell", "living_room", "tree")
RAYS_PER_KIND = 20_000  # of each kind
HEAD = ["structure", "leaf", "build ms", "MB", "primary", "random", "shadow", "over Embree", "cells", "triangles"]
NOTE = (
    "Times per ray are us of one thread, the least of 5 runs in turn. Primary rays go through pixels of the scene's "
    "camera, random ones on from hits of photons, shadow rays from there to points on lamps. Cells and triangles are "
    "those of a random ray. Ratios to Embree have the order of the times. Each structure has its best leaf size for "
    "random rays; that of `grid3d` is per cell."
)


def measured(model: Model, bar: Bar, rays: int = RAYS_PER_KIND) -> list[tuple[Structure, dict[str, Cost]]]:
    """Return every structure at every leaf size over a model's static part, with its costs by kind of ray."""
    from gi_core.instruments.timing import LEAVES, STRUCTURES, built, costs, rays_of

    casts = rays_of(model, scene_camera(model), rays)
    meshes = [(model.surfaces.vertices[0], model.surfaces.faces[0])]
    tried: list[Structure] = []
    for name in STRUCTURES:
        for leaf in LEAVES.get(name, (None,)):
            bar(f"{model.scene.name}: {name}", len(tried) / 30)
            tried.append(built(name, meshes, leaf))
    return list(zip(tried, costs(tried, casts), strict=True))


def scene_camera(model: Model) -> Camera:
    """Return the camera of a picture of the model's scene."""
    return from_camera(model.scene.camera, model.scene.up, scene_bounds(model, model.start_poses())).as_camera()


def best(costs_of: list[tuple[Structure, dict[str, Cost]]]) -> list[tuple[Structure, dict[str, Cost]]]:
    """Return each structure at the leaf size of the fastest random rays."""
    names = dict.fromkeys(s.name for s, _ in costs_of)
    return [min((f for f in costs_of if f[0].name == n), key=lambda f: f[1]["random"].seconds) for n in names]


def section(costs_of: dict[str, list[tuple[Structure, dict[str, Cost]]]]) -> str:
    """Return the Markdown section; costs_of: measurements by the title of a scene."""
    parts = ["## Space partitionings (3.4.1)", NOTE]
    for title, rows in costs_of.items():
        chosen = best(rows)
        embree = next((c for s, c in chosen if s.name == "embree"), None)
        lines = [_line(s, c, embree) for s, c in chosen]
        parts += [f"### {title}", markdown_table(HEAD, lines), _over_leaves(rows)]
    return "\n\n".join(p for p in parts if p)


def _line(s: Structure, cost: dict[str, Cost], embree: dict[str, Cost] | None) -> list[str]:
    random = cost["random"]
    return [
        s.name, f"{s.leaf:g}" if s.bytes and s.name != "none" else "", f"{1e3 * s.build_seconds:.3g}",
        f"{s.bytes / 1e6:.3g}" if s.bytes else "", *(f"{1e6 * cost[k].seconds:.3g}" for k in cost),
        ", ".join(f"{cost[k].seconds / embree[k].seconds:.2g}" for k in cost) if embree else "",
        f"{random.cells:.1f}" if random.cells else "", f"{random.tests:.1f}" if random.tests else "",
    ]  # fmt: skip


def _over_leaves(rows) -> str:
    lines = []
    for name in dict.fromkeys(s.name for s, _ in rows):
        own = [(s, c) for s, c in rows if s.name == name]
        if len(own) > 1:
            lines.append(f"- {name}, us per random ray over leaf sizes: " + ", ".join(
                f"{1e6 * c['random'].seconds:.3g} at {s.leaf:g}" for s, c in own
            ))  # fmt: skip
    return "\n".join(lines)


def draw(costs_of: dict[str, list[tuple[Structure, dict[str, Cost]]]], out: Path) -> None:
    """Draw time per random ray over the leaf size, one panel per scene, into rays.svg. Raises UsageError, OSError."""
    need_matplotlib()
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(
        1, len(costs_of), figsize=(4 * len(costs_of) + 2, 4), sharey=True, layout="constrained"
    )
    for axis, (title, rows) in zip([axes] if len(costs_of) == 1 else axes, costs_of.items(), strict=True):
        for k, name in enumerate(dict.fromkeys(s.name for s, _ in rows)):
            own = [(s.leaf, 1e6 * c["random"].seconds) for s, c in rows if s.name == name]
            if len(own) > 1:
                axis.plot(*zip(*own, strict=True), "o-", color=f"C{k}", label=name)
            elif name != "none":
                axis.axhline(own[0][1], color=f"C{k}", linestyle="--", label=name)
        axis.set(xscale="log", yscale="log", title=title, xlabel="triangles per leaf or cell")
        axis.grid(linewidth=0.4, which="both")
    figure.axes[0].set_ylabel("us per random ray")
    figure.axes[-1].legend(fontsize=8)
    figure.savefig(out, metadata={"Date": None})
    pyplot.close(figure)
