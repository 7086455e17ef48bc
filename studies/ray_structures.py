"""Structures of rays: their table over scenes, their growth with triangles, and their agreement over many rays.

    python -m studies.ray_structures cornell tree room.glb --out out/rays    # rays.md and rays.svg
    python -m studies.ray_structures --growth 20000 1000000 --out out/rays   # growth.md and growth.svg: a terrain
    python -m studies.ray_structures --growth 20 2000 --out out/few          # where each becomes faster than `none`
    python -m studies.ray_structures --threads 2 tree room.glb               # bvh and Embree, wall time
    python -m studies.ray_structures --agreement 1000000                     # exit code 1 if a bit differs
    python -m studies.ray_structures --agreement 200000 tree room.glb        # the same over scenes

`--agreement` compares each structure with all triangles on every case of `tests/support/ray_cases.py`, and with Embree
on random rays, where 1e-5 of the rays may be strays. It then moves objects with each structure and compares the light
with a solution from scratch. Over scenes it compares them with `bvh`, on primary, random and shadow rays.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

import numpy as np

from app.cli.progress import Bar
from app.cli.writable import write_whole
from app.measure.bench.report import measured_structures, partitionings, scene_camera
from app.measure.chart.figure import need_matplotlib
from app.measure.tables import markdown_table
from app.settings import Settings, open_scene
from gi_core.geometry.surfaces import Surfaces, flatten
from gi_core.instruments.timing import REPEATS, Rays, built, costs, rays_of
from gi_core.model import Model
from gi_core.rays.accelerator import Accelerator
from gi_core.rays.structures import STRUCTURES
from gi_core.scene.types import Material, Mesh, Pose, Scene
from gi_core.solver import Solver
from tests.support.ray_cases import CASES, directions, strays
from tests.support.scene_builders import box_mobile, coloured_room

STRAYS = 1e-5  # share of rays whose face and distance may differ from Embree's
MEDIUM = 20_000  # rays per kind
THREADED = 200_000  # rays per kind, divided among threads
FEW = 5_000  # triangles up to which `none` is measured beside the others


def terrain(triangles: int, seed: int = 0) -> Mesh:
    """Return a rough height field over the unit square, of about that number of triangles."""
    n = max(1, math.isqrt(triangles // 2))
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    rng, z = np.random.default_rng(seed), np.zeros_like(x)
    for octave in range(1, 8):
        a, b, c = rng.normal(size=(3, 2))
        z += 0.15 / octave**1.5 * np.sin(2**octave * (a[0] * x + b[0] * y) + c[0]) * np.cos(2**octave * b[1] * y + c[1])
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1)
    faces = np.concatenate([np.stack([k, k + 1, k + n + 2], 1), np.stack([k, k + n + 2, k + n + 1], 1)])
    return Mesh(np.stack([x, y, z], -1).reshape(-1, 3), faces.astype(np.int32), np.zeros(len(faces), np.int32))


def rays_over(mesh: Mesh, n: int) -> Rays:
    """Return rays from points up to 0.3 above the terrain, in all directions."""
    rng = np.random.default_rng(1)
    origin = mesh.vertices[rng.integers(0, len(mesh.vertices), n)] + [0, 0, 1] * rng.uniform(1e-3, 0.3, (n, 1))
    return Rays(origin.astype(np.float32), directions(rng, n), np.full(n, 10, np.float32), False)


def growth(low: int, high: int, out: Path) -> str:
    """Measure each structure from `low` to `high` triangles; write growth.md and growth.svg, return the table."""
    counts = [round(x) for x in np.geomspace(low, high, 5)]
    found: dict[str, list] = {name: [] for name in STRUCTURES}
    with Bar() as bar:
        for k, count in enumerate(counts):
            mesh = terrain(count)
            names = [name for name in STRUCTURES if name != "none" or count <= max(low, FEW)]
            bar(f"{len(mesh.faces):,} triangles", k / len(counts))
            made = [built(name, [(mesh.vertices, mesh.faces)]) for name in names]
            for s, cost in zip(made, costs(made, {"random": rays_over(mesh, MEDIUM)}), strict=True):
                found[s.name].append((len(mesh.faces), s, cost["random"]))
    lines = [
        [name, *(f"{1e6 * c.seconds:.3g}, {c.cells:.3g}, {1e3 * s.build_seconds:.0f}" for _, s, c in rows)]
        for name, rows in found.items()
    ]
    head = ["us per ray, cells per ray, build ms", *(f"{2 * math.isqrt(c // 2) ** 2:,}" for c in counts)]
    lines = [line + [""] * (len(head) - len(line)) for line in lines]
    _draw(found, out / "growth.svg")
    write_whole(out / "growth.md", text := markdown_table(head, lines) + "\n")
    return text


def _draw(found: dict[str, list], out: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for name, rows in found.items():
        if len(rows) > 1:
            left.plot([n for n, *_ in rows], [1e6 * c.seconds for *_, c in rows], "o-", label=name)
            right.plot([n for n, *_ in rows], [c.cells or np.nan for *_, c in rows], "o-", label=name)
    left.set(xscale="log", yscale="log", xlabel="triangles", ylabel="us per ray", title="Time")
    right.set(xscale="log", yscale="log", xlabel="triangles", ylabel="cells per ray", title="Cells entered")
    for axis in (left, right):
        axis.grid(linewidth=0.4, which="both")
    left.legend(fontsize=8)
    figure.savefig(out, metadata={"Date": None})
    pyplot.close(figure)


def draw_partitionings(costs_of: dict[str, list], out: Path) -> None:
    """Draw time per random ray over the leaf size, one panel per scene, into rays.svg. Raises OSError."""
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


def on_threads(scene: str, threads: int) -> str:
    """Return wall times of bvh and Embree per ray on several threads, the least of REPEATS in turn."""
    model = Model(open_scene(Settings(scene=scene)))
    asked = rays_of(model, scene_camera(model), THREADED)
    tracers = {name: Accelerator(model.surfaces, threads, name) for name in ("embree", "bvh")}
    least: dict[tuple[str, str], float] = {}
    for _ in range(1 + REPEATS):  # the first one compiles
        for kind, r in asked.items():
            for name, tracer in tracers.items():
                query, before = tracer.occluded if r.any_hit else tracer.nearest, time.perf_counter()
                query(0, *r[:3])
                spent = 1e6 * (time.perf_counter() - before) / len(r.origin)
                least[kind, name] = min(spent, least.get((kind, name), math.inf))
    pairs = {kind: (least[kind, "embree"], least[kind, "bvh"]) for kind in asked}
    lines = [f"{kind} {embree:.3f}, {bvh:.3f}, {bvh / embree:.2f}" for kind, (embree, bvh) in pairs.items()]
    return f"{Path(scene).stem}, us per ray on {threads} threads of embree, bvh, ratio: {'; '.join(lines)}"


def agreement(rays: int) -> bool:
    """Print one line per case and structure; return whether all of them hold."""
    holds = True
    for case, make in CASES.items():
        mesh, (o, d) = make(rays)
        surfaces = flatten(Scene(mesh, (Material("grey"),)), with_receivers=False)[0]
        asked = Rays(o, d, np.full(len(o), 1e4, np.float32), False)
        awkward = case not in ("random", "room", "sheets", "scale 1e-3", "scale 1e3")
        holds &= _agree(case, surfaces, asked, "none", awkward)
    for name in STRUCTURES:
        solver = Solver(coloured_room((box_mobile(size=0.1),)), photons=5000, radius=0.1, rays=name)
        solver.solve()
        rng, same = np.random.default_rng(0), True
        for _ in range(10):
            solver.move("box", Pose(tuple(rng.uniform(0.1, 0.8, 3))))
            same &= np.array_equal(solver.irradiance, solver.from_scratch())
        holds &= same
        print(f"{name}: ten moves {'equal' if same else 'DIFFER FROM'} solutions from scratch", flush=True)
    return holds


def agreement_over(scene: str, rays: int) -> bool:
    """Print one line per kind of ray and structure over a scene; return whether all of them hold."""
    model = Model(open_scene(Settings(scene=scene)))
    asked = rays_of(model, scene_camera(model), rays)
    return all([_agree(f"{Path(scene).stem}, {kind}", model.surfaces, r, "bvh") for kind, r in asked.items()])


def _agree(title: str, surfaces: Surfaces, rays: Rays, basis: str, awkward: bool = False) -> bool:
    """Print how many rays differ from those of the structure `basis`; return whether as few as may.

    awkward: Embree may differ in any of them.
    """
    o, d, far = rays[:3]
    holds, answers = True, {}
    for name in [basis, *(n for n in STRUCTURES if n not in (basis, "none"))]:
        tracer = Accelerator(surfaces, 2, name)
        answers[name] = *tracer.nearest(0, o, d, far), tracer.occluded(0, o, d, far)
        truth = answers[basis]
        differ = max(int((a != b).sum()) for a, b in zip(truth, answers[name], strict=True))
        more, good = "", differ == 0
        if name == "embree":
            faces, stray = int((truth[1] != answers[name][1]).sum()), strays(truth, answers[name])
            stray = max(stray, int((truth[2] != answers[name][2]).sum()))
            more, differ, good = f" in face, {stray:,} in distance too", faces, awkward or stray <= STRAYS * len(o)
        holds &= good
        print(f"{title}: {name}: {differ:,} of {len(o):,} rays differ{more}{'' if good else ': TOO MANY'}", flush=True)
    return holds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--growth", nargs=2, type=int, metavar=("LOW", "HIGH"))
    parser.add_argument("--threads", type=int, metavar="N")
    parser.add_argument("--agreement", type=int, metavar="RAYS")
    parser.add_argument("--out", type=Path, default=Path("out/rays"), metavar="DIR")
    asked = parser.parse_args()
    if asked.agreement:
        over = [agreement_over(scene, asked.agreement) for scene in asked.scenes]
        return 0 if all(over or [agreement(asked.agreement)]) else 1
    if asked.threads:
        for scene in asked.scenes:
            print(on_threads(scene, asked.threads), flush=True)
        return 0
    need_matplotlib()
    asked.out.mkdir(parents=True, exist_ok=True)
    if asked.growth:
        print(growth(*asked.growth, asked.out))
    found: dict[str, list] = {}
    for scene in asked.scenes:
        with Bar() as bar:
            found[Path(scene).stem] = measured_structures(Model(open_scene(Settings(scene=scene))), bar, MEDIUM)
        write_whole(asked.out / "rays.md", partitionings(found) + "\n")
        draw_partitionings(found, asked.out / "rays.svg")
        print(partitionings({Path(scene).stem: found[Path(scene).stem]}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
