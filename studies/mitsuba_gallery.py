"""A gallery with a satin floor and a Ward-lacquered ball to move, beside Mitsuba 3: gloss at vertices, and irradiance.

    python -m studies.mitsuba_gallery --mitsuba PYTHON [--parts]

PYTHON: as for studies.mitsuba_scene. Specular radiance towards three eyes is compared at vertices of the floor (GGX of
alpha 0.3) and of the ball, by photons alone and with gathered light; irradiance on walls, floor and ball. `--parts`
varies photons and radius of gloss discs, compares cells with the rays that fill them, noise, blur and cells apart, and
measures frames in motion.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np

from app.draw.draw_mesh import meshes_of
from app.draw.vertex_colours import gloss_colours
from app.rest.timed_gathering import gather
from app.settings import Settings, make_solver
from gi_core.bsdf.models import lobe
from gi_core.gather.reference import reference_irradiance
from gi_core.gloss import cells, source
from gi_core.gloss.lobe_rays import draw_lobe
from gi_core.gloss.radiance import Directions
from gi_core.scene.types import Gloss, Material, Mobile, Pose, Scene
from gi_core.solver import Solver
from studies.mitsuba_scene import described, traced
from tests.support.scene_builders import box, merge, quad, sphere

LOW, HIGH = np.array((-3.0, 0.0, -2.0)), np.array((3.0, 3.2, 2.0))  # of the room [m]
BALL, SIZE = (0.6, 0.9, 0.2), 0.45
EYES = ((-2.0, 1.6, 1.6), (0.0, 1.7, 1.9), (2.4, 1.2, -1.5))
EDGE = 0.05  # [m], kept free along edges of the room
POINTS = {"walls": 300, "floor": 200, "ball": 100}
PATHS = 4096  # per point
LOBE_RAYS = 1024  # per vertex and eye
AWAY = (-1.2, 1.4, -0.6)  # where the ball comes from in frames of motion
IN_MOTION = (1 << 16, 64), (1 << 16, 32), (1 << 14, 16), (1 << 12, 8), (None, 256)  # photons and paths


def gallery(floor: tuple[int, int] = (32, 48)) -> Scene:
    """Return the scene; floor: faces along its sides."""
    ward = lobe("ward", {"kd": (0.5, 0.05, 0.05), "ks": 0.3, "ax": 0.2, "ay": 0.2, "bounded": 1.0})
    materials = (
        Material("wall", (0.75, 0.75, 0.72)), Material("lamp", (0.0, 0.0, 0.0), (9.0, 8.5, 8.0)),
        Material("floor", (0.35, 0.25, 0.18), gloss=Gloss(alpha=0.3)), Material("blue", (0.1, 0.2, 0.6)),
        Material("orange", (0.8, 0.4, 0.05)), Material("lacquer", brdf=(ward,)),
    )  # fmt: skip
    (x, y, z), (X, Y, Z) = LOW, HIGH
    room = box(LOW, HIGH, 24, 0, inward=True)
    kept = room.vertices[room.faces][:, :, 1].max(axis=1) > 1e-6  # the floor is a part of its own
    walls = room._replace(faces=room.faces[kept], face_material=room.face_material[kept])
    static = merge(
        walls,
        quad((x, y, z), (0, 0, Z - z), (X - x, 0, 0), floor, 2),
        quad((-1.5, Y - 1e-3, -0.6), (3.0, 0, 0), (0, 0, 1.2), (8, 4), 1),
        quad((-2.2, 0.9, z + 1e-3), (1.6, 0, 0), (0, 1.3, 0), (12, 10), 3),
        quad((0.6, 0.9, z + 1e-3), (1.6, 0, 0), (0, 1.3, 0), (12, 10), 4),
    )
    ball = Mobile("ball", sphere((0, 0, 0), SIZE, 4, 5), Pose(BALL))
    return Scene(static, materials, (ball,), (), up=(0, 1, 0), name="gallery beside Mitsuba")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mitsuba", required=True, metavar="PYTHON")
    parser.add_argument("--photons", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="of gathering")
    parser.add_argument("--parts", action="store_true")
    parser.add_argument("--radius", type=float, help="of discs [m]")
    given = parser.parse_args()
    settings = Settings(scene="gallery", photons=given.photons, radius=given.radius, light="photons")
    solver = make_solver(gallery(), settings)
    solver.solve()
    print(f"radius {solver.setting.radius:.3f} m, {len(solver.frame.gloss.rows):,} glossy receivers", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        truth = Truth(solver, given.mitsuba, Path(folder))
    truth.report(f"{solver.photons:,} photons", solver)
    if given.parts:
        parts(solver, truth)
    solver.configure(light="best")
    solver.solve()
    if given.parts:
        in_motion(solver, truth)
    gather(solver, given.seconds, lambda *progress: None)
    truth.report("gathered light", solver)


def parts(solver: Solver, truth: Truth) -> None:
    """Print the errors of gloss with fewer photons in its cells, smaller discs, and from single rays."""
    most, radii = cells.MOST_PHOTONS, source.RADII
    for photons in (1 << 18, 1 << 20):
        for times in (2.0, 1.4, 1.0):
            cells.MOST_PHOTONS, source.RADII = photons, times
            light = source.GlossSource(solver.model)
            b, f = solver.frame.background, solver.frame
            given = b.store, b.store.subset(b.estimate.photons)[0], b.store.weights(solver.levels)
            found = light.light(source.QUADTREE, b.setting.radius, given, f.change, lambda stage: None)
            truth.report(f"cells of {photons:,} photons, {times} radii", solver, found.directions())
    cells.MOST_PHOTONS, source.RADII = most, radii
    solver.configure(gloss=source.LIST)
    solver.solve()
    truth.report("list of rays", solver)
    solver.configure(gloss=source.QUADTREE)


def in_motion(solver: Solver, truth: Truth) -> None:
    """Print the errors of frames in which the ball has just arrived."""
    for photons, paths in IN_MOTION:
        solver.move("ball", Pose(AWAY))
        solver.move_all({"ball": Pose(BALL)}, photons, paths)
        truth.report(f"in motion, {solver.frame.photons:,} photons, {paths} paths", solver)


class Truth:
    """Mitsuba's irradiance at receivers, and gloss of floor and ball towards EYES."""

    def __init__(self, solver: Solver, python: str, folder: Path) -> None:
        s, rng, receivers = solver.surfaces, np.random.default_rng(3), solver.receivers
        meshes = meshes_of(solver.model)
        worn = solver.scene.static.face_material
        p = receivers.positions
        apart = np.minimum(p - LOW, HIGH - p)
        inside = np.sort(apart, axis=1)[:, 1] > EDGE  # of the two nearest walls, the second is further off
        ceiling = apart[:, 1] > 0.02  # none in the lamp
        of = {"walls": s.corner_front[: len(worn)][worn == 0], "floor": s.corner_front[: len(worn)][worn == 2],
              "ball": s.corner_front[len(worn) :]}  # fmt: skip
        self.rows = {}
        for name, corners in of.items():
            some = np.unique(corners)
            some = some[(inside[some] & (ceiling[some] | (name == "floor"))) | (name == "ball")]
            self.rows[name] = rng.choice(some, min(POINTS[name], len(some)), replace=False)
        rows = np.concatenate(list(self.rows.values()))
        self.seen, origins, directions, self.factors = {}, [], [], []
        for name, o in (("floor", 0), ("ball", 1)):
            mesh, at = meshes[o], np.array(BALL if o else (0.0, 0.0, 0.0))
            vertex = np.full(len(p), -1)
            vertex[mesh.front] = np.arange(len(mesh.front))
            which = vertex[self.rows[name]]
            for eye in EYES:
                place, up = mesh.positions[which] + at, mesh.normal[which].astype(np.float64)
                towards = np.array(eye) - place
                towards /= np.linalg.norm(towards, axis=1)[:, None]
                up_there = np.einsum("ij,ij->i", towards, up) > 0.1
                self.seen[name, eye] = mesh, which[up_there], np.array(eye) - at
                across = np.cross(up, np.where(np.abs(up[:, :1]) < 0.7, (1.0, 0, 0), (0, 1.0, 0)))
                across /= np.linalg.norm(across, axis=1)[:, None]
                many = [np.repeat(a[up_there], LOBE_RAYS, axis=0) for a in (mesh.lobe[which], towards, up, across)]
                d, factors, _ = draw_lobe(many[0], s.tables, *many[1:], rng.random((len(many[0]), 3)))
                origins.append(np.repeat((place + 1e-5 * up)[up_there], LOBE_RAYS, axis=0))
                directions.append(d)
                self.factors.append(factors)
        places, normals = p[rows], receivers.normals[rows]
        rays = {"origins": np.concatenate(origins), "directions": np.concatenate(directions), "principled": False}
        found = traced(
            described(solver) | {"paths": PATHS, "points": places, "normals": normals} | rays, python, folder
        )
        self.mean, self.error, along = found["mean"], found["error"], found["along"]
        self.truth, first = {}, 0
        for key, factors in zip(self.seen, self.factors, strict=True):
            L = (factors * along[first : first + len(factors)]).reshape(-1, LOBE_RAYS, 3)
            self.truth[key], first = (L.mean(axis=1), L.std(axis=1) / np.sqrt(LOBE_RAYS)), first + len(factors)
        E, error = reference_irradiance(solver.scene, places, normals, PATHS, 5, model=solver.model)
        first = 0
        for name, some in self.rows.items():
            mine = slice(first, first + len(some))
            first = mine.stop
            off, both = np.abs(E[mine] - self.mean[mine]), np.hypot(error[mine], self.error[mine])
            beyond = (off > 3 * both + 0.01 * self.mean[mine]).any(axis=1).sum()
            total = self.mean[mine].sum()
            ratio, noise = E[mine].sum() / total, 100 * both.sum() / total
            print(f"irradiance of {name}, {len(some)} points: paths / Mitsuba {ratio:.4f}, noise of a difference "
                  f"{noise:.1f} %, {beyond} beyond 3 standard errors + 1 %", flush=True)  # fmt: skip

    def report(self, light: str, solver: Solver, directions: Directions | None = None) -> None:
        """Print the errors of a frame of the solver, or of other directions of its light."""
        first = 0
        for name, some in self.rows.items():
            mean, E = self.mean[first : first + len(some)], solver.irradiance[some]
            first += len(some)
            print(f"{light}, irradiance of {name}: l1 {100 * np.abs(E - mean).sum() / mean.sum():.1f} %, total "
                  f"{E.sum() / mean.sum():.3f}", flush=True)  # fmt: skip
        directions = solver.frame.gloss.directions() if directions is None else directions
        for (name, eye), (mesh, which, local) in self.seen.items():
            truth, error = self.truth[name, eye]
            found = gloss_colours(mesh, directions, solver.irradiance, local, which)[0]
            off, noise = np.abs(found - truth).sum(), math.sqrt(2 / math.pi) * error.sum()
            left, noise = (100 * x / truth.sum() for x in (math.sqrt(max(off**2 - noise**2, 0.0)), noise))
            print(f"{light}, gloss of {name} towards {eye}: l1 {left:.1f} % without Mitsuba's noise of {noise:.1f} %, "
                  f"total {found.sum() / truth.sum():.3f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
