"""Structures of rays: their growth with triangles, and their agreement over many rays.

    python -m studies.ray_structures --growth 20000 1000000 --out out/rays   # growth.md and growth.svg: a terrain
    python -m studies.ray_structures --growth 20 2000 --out out/few          # where each becomes faster than `none`
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
from pathlib import Path

import numpy as np

from app.cli.progress import Bar
from app.cli.version import need
from app.cli.writable import write_whole
from app.draw.camera import from_camera, scene_bounds
from app.measure.tables import markdown_table
from app.settings import Settings, open_scene
from gi_core.files.completion.camera_view import picture_rays, unit
from gi_core.geometry.surfaces import Surfaces, flatten
from gi_core.instruments.timing import Cost, Rays, Structure, built, run_of
from gi_core.lights.emission import emit
from gi_core.model import Model
from gi_core.rays.accelerator import Accelerator
from gi_core.rays.structures import STRUCTURES
from gi_core.scene.types import Material, Mesh, Pose, Scene
from gi_core.solver import Solver
from tests.support.ray_cases import CASES, directions, strays
from tests.support.scene_builders import box_mobile, coloured_room

STRAYS = 1e-5  # share of rays whose face and distance may differ from Embree's
MEDIUM = 20_000  # rays per kind
REPEATS = 5  # of a measurement; the least time counts
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


def rays_of(model: Model, n: int) -> dict[str, Rays]:
    """Return rays by kind: through the pixels of a picture, on from the hits of photons, from there to points on lamps.

    Photons find the lit side of walls, where the camera may stand outside.
    """
    bounds, timing_seed = scene_bounds(model, model.start_poses()), 0  # of the rays
    camera = from_camera(model.scene.camera, model.scene.up, bounds).as_camera()
    rng, far = np.random.default_rng(timing_seed), np.float32(4 * model.world.size)
    columns = math.isqrt(n)
    d = picture_rays([camera], model.scene.up, columns, columns)[0].astype(np.float32)
    o = np.broadcast_to(np.asarray(camera.position, np.float64) - model.origins[0], d.shape).astype(np.float32)
    limits = np.full(n, far)
    primary = Rays(o, d, limits[: len(d)], False)
    o, d = emit(model.emitters, timing_seed, 0, n)[:2]
    distance, face = model.accelerator.nearest(0, o + 1e-5 * far * d, d, limits)
    hit = face >= 0
    normal = model.surfaces.normals[face[hit]]
    toward = np.sign((normal * d[hit]).sum(axis=1))[:, None]
    start = (o[hit] + distance[hit, None] * d[hit] - 1e-5 * model.world.size * toward * normal).astype(np.float32)
    on = unit(rng.normal(size=start.shape))
    on *= -np.sign((on * toward * normal).sum(axis=1))[:, None]
    lamp = emit(model.emitters, timing_seed, n, len(start))[0].astype(np.float64) - start
    length = np.sqrt((lamp * lamp).sum(axis=1))
    return {
        "primary": primary,
        "random": Rays(start, on.astype(np.float32), limits[: len(start)], False),
        "shadow": Rays(start, unit(lamp).astype(np.float32), (length * (1 - 1e-4)).astype(np.float32), True),
    }


def costs(structures: list[Structure], rays: dict[str, Rays], repeats: int = REPEATS) -> list[dict[str, Cost]]:
    """Return the cost by kind of ray of each structure: the least of `repeats`, taken in turn."""
    runs = [{kind: run_of(s, r) for kind, r in rays.items()} for s in structures]
    out = [{kind: run() for kind, run in own.items()} for own in runs]  # compiles
    for turn in range(repeats):
        for k, own in enumerate(runs):
            for kind, run in own.items():
                cost = run()
                out[k][kind] = cost if turn == 0 else min(out[k][kind], cost)
    return out


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
    asked = rays_of(model, rays)
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
    parser.add_argument("--growth", nargs=2, type=int, default=(20_000, 1_000_000), metavar=("LOW", "HIGH"))
    parser.add_argument("--agreement", type=int, metavar="RAYS")
    parser.add_argument("--out", type=Path, default=Path("out/rays"), metavar="DIR")
    asked = parser.parse_args()
    if asked.agreement:
        over = [agreement_over(scene, asked.agreement) for scene in asked.scenes]
        return 0 if all(over or [agreement(asked.agreement)]) else 1
    need("matplotlib", "draws the chart")
    asked.out.mkdir(parents=True, exist_ok=True)
    print(growth(*asked.growth, asked.out))
    return 0


if __name__ == "__main__":
    sys.exit(main())
