"""A metal-rough grid beside Mitsuba 3: irradiance of the walls, and gloss of a satin floor.

    python -m studies.mitsuba_scene --mitsuba PYTHON --out FILE.png

PYTHON: of an environment with Mitsuba 3.9.1 and numpy. It needs LLVM 17 or newer; DRJIT_LIBLLVM_PATH names another
library than the system's. Nine balls of a glTF file, metallic 0, 0.5, 1 from left to right, roughness 0.2, 0.4, 0.6
from below, over a floor of roughness 0.49, in a room with a lamp. Mitsuba traces the same triangles with the same
formulas, written again (studies/mitsuba_paths.py), and with its own model `principled`. FILE.png is our picture;
`studies.mitsuba_grid` makes that of docs/brdfs.md.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from app.draw.camera import from_camera
from app.draw.draw_mesh import meshes_of
from app.draw.png import write_png
from app.draw.shot import Shot
from app.draw.vertex_colours import gloss_colours
from app.rest.timed_gathering import gather
from app.settings import Settings, make_solver, open_scene
from gi_core.bsdf import ggx
from gi_core.files.formats.metallic_roughness import as_metal_rough
from gi_core.gather.reference import reference_irradiance
from gi_core.gloss.lobe_rays import draw_lobe
from gi_core.scene.types import Camera, Mesh
from gi_core.solver import Solver
from scenes.glb import Part, glb_bytes, material
from tests.support.scene_builders import box, quad, sphere

METALLIC, ROUGHNESS = (0.0, 0.5, 1.0), (0.2, 0.4, 0.6)
LOW, HIGH = (-1.2, 0.0, -0.7), (1.2, 1.5, 0.7)  # of the room [m]
POINTS = 300  # on the walls
EDGE = 0.03  # [m], kept free along edges: there, half of a hemisphere lies in another wall
PATHS = 1024  # per point, of Mitsuba and of the program
FLOOR_POINTS, LOBE_RAYS = 150, 256
EYES = ((0.0, 0.9, 2.4), (1.0, 0.5, 0.6), (-0.8, 1.3, -0.5))
BASE = (0.8, 0.45, 0.2)


def grid() -> bytes:
    """Return the glTF file."""
    glossy = {f"{m:g} {r:g}": (m, r, BASE) for m in METALLIC for r in ROUGHNESS} | {
        "floor": (0.0, 0.49, (0.4, 0.4, 0.4))
    }
    materials = [material("wall", (0.7, 0.7, 0.7)), material("lamp", (0, 0, 0), (6.0, 6.0, 6.0))]
    for name, (metallic, roughness, base) in glossy.items():
        described = material(name, base)
        described["pbrMetallicRoughness"] |= {"metallicFactor": metallic, "roughnessFactor": roughness}
        materials.append(described)
    room = box(LOW, HIGH, 10, 0, inward=True)
    above = room.vertices[room.faces][:, :, 1].max(axis=1) > 1e-6  # the floor is a part of its own
    (x, y, z), (X, Y, Z) = LOW, HIGH
    floor = quad((x, y, z), (0, 0, Z - z), (X - x, 0, 0), (14, 24))
    lamp = quad((-0.6, Y - 1e-3, -0.4), (1.2, 0, 0), (0, 0, 0.8), (4, 4))
    parts = [Part("wall", room.vertices, room.faces[above]), _part("floor", floor), _part("lamp", lamp)]
    for i, m in enumerate(METALLIC):
        for j, r in enumerate(ROUGHNESS):
            parts.append(_part(f"{m:g} {r:g}", sphere((0.6 * (i - 1), 0.25 + 0.42 * j, -0.2), 0.16, 3)))
    return glb_bytes(parts, materials)


def _part(name: str, mesh: Mesh) -> Part:
    return Part(name, mesh.vertices, mesh.faces)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mitsuba", required=True, metavar="PYTHON")
    parser.add_argument("--photons", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="of gathering")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.png")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.glb"
        file.write_bytes(grid())
        settings = Settings(scene=str(file), photons=given.photons, light="photons", size=(1000, 640))
        solver = make_solver(open_scene(settings), settings)
        solver.solve()
        truth = Truth(solver, given.mitsuba, Path(folder))
        truth.report("photons", solver)
        solver.configure(light="best")
        gather(solver, given.seconds, lambda *progress: None)
        truth.report("gathered light", solver)
        shot = Shot(solver, settings)
        shot.camera = from_camera(Camera((0, 0.9, 4.6), (0, 0.72, 0), 24.0), solver.scene.up, shot.camera.bounds)
        write_png(given.out, shot.take(), {})


def described(solver: Solver) -> dict[str, np.ndarray]:
    """Return the triangles of all objects at their poses, and the materials that they have, for mitsuba_paths.py."""
    s, at, worn = solver.surfaces, solver.model.transforms(solver.poses), solver.scene.materials
    material = np.concatenate([m.face_material for m in (solver.scene.static, *(o.mesh for o in solver.scene.mobiles))])
    of_faces = np.c_[s.lobe, s.reflectance, s.emission]
    _, first, kind = np.unique(of_faces, axis=0, return_index=True, return_inverse=True)
    lobe, table, cosines = s.lobe[first], ggx.albedos(), (*np.linspace(0, 1, ggx.NODES), -1.0)
    through = np.array([[ggx.passed(table, np.nan_to_num(row), cos) for cos in cosines] for row in lobe])
    metal_rough, ward = np.zeros((len(first), 5)), np.zeros((len(first), 8))
    for k, m in enumerate(material[first]):
        if worn[m].gloss is not None:
            found = as_metal_rough(np.array(worn[m].reflectance), worn[m].gloss)
            metal_rough[k] = *found.base, found.metallic, found.roughness
        if worn[m].brdf:
            values = worn[m].brdf[0].values()
            ward[k] = (
                *np.broadcast_to(values["kd"], 3),
                *np.broadcast_to(values["ks"], 3),
                values["ax"],
                values["bounded"],
            )
    corners = [s.vertices[o][s.faces[o]] @ at.rotation[o].T + at.position[o] for o in range(s.objects)]
    return {
        "corners": np.concatenate(corners), "material": kind.reshape(-1), "ward": ward,
        "rho": s.reflectance[first], "emission": s.emission[first], "f0": lobe[:, :3], "f90": lobe[:, 3],
        "alpha": lobe[:, 4], "through": through[:, :-1], "mean": through[:, -1], "metal_rough": metal_rough,
    }  # fmt: skip


def traced(scene: dict, python: str, folder: Path) -> dict[str, np.ndarray]:
    """Return Mitsuba's irradiance at points, its standard errors, the radiance along rays, and the version."""
    np.savez(folder / "scene.npz", **scene)
    script = Path(__file__).with_name("mitsuba_paths.py")
    subprocess.run([python, script, folder / "scene.npz", folder / "found.npz"], check=True)
    with np.load(folder / "found.npz") as found:
        return dict(found)


class Truth:
    """Mitsuba's irradiance at points of the walls, and gloss of the floor towards EYES."""

    def __init__(self, solver: Solver, python: str, folder: Path) -> None:
        s, rng, names = solver.surfaces, np.random.default_rng(3), [m.name for m in solver.scene.materials]
        receivers, worn = solver.receivers, solver.scene.static.face_material
        walls = np.unique(s.corner_front[worn == names.index("wall")])
        p = receivers.positions[walls]
        at_planes = (np.minimum(p - LOW, np.array(HIGH) - p) < EDGE).sum(axis=1)
        behind_lamp = (p[:, 1] > HIGH[1] - EDGE) & (np.abs(p[:, [0, 2]]) < np.array((0.6, 0.4)) + EDGE).all(axis=1)
        self.rows = rng.choice(walls[(at_planes == 1) & ~behind_lamp], POINTS, replace=False)
        at, normals = receivers.positions[self.rows], receivers.normals[self.rows]
        self.mesh = meshes_of(solver.model)[0]
        floor = np.flatnonzero(worn == names.index("floor"))
        self.vertices = rng.choice(np.unique(self.mesh.triangles[floor]), FLOOR_POINTS, replace=False)
        lobe = s.lobe[floor[0]]
        place, up = (a[self.vertices].astype(np.float64) for a in (self.mesh.positions, self.mesh.normal))
        origins, directions, self.factors = [], [], []
        for eye in EYES:
            o = np.array(eye) - place
            o /= np.linalg.norm(o, axis=1)[:, None]
            many = (np.repeat(a, LOBE_RAYS, axis=0) for a in (np.tile(lobe, (len(o), 1)), o, up, up))
            lobes, views, axes, tangents = many
            d, factors, _ = draw_lobe(lobes, s.tables, views, axes, tangents, rng.random((len(lobes), 3)))
            origins.append(np.repeat(place + 1e-5 * up, LOBE_RAYS, axis=0))
            directions.append(d)
            self.factors.append(factors)
        rays = {"origins": np.concatenate(origins), "directions": np.concatenate(directions)}
        scene = described(solver) | {"paths": PATHS, "points": at, "normals": normals} | rays
        ours = reference_irradiance(solver.scene, at, normals, PATHS, 5, model=solver.model)
        self.mean, along = self._compared(scene | {"principled": False}, ours, python, folder)
        self._compared(scene | {"principled": True}, ours, python, folder)
        seen = np.concatenate(self.factors) * along
        self.gloss = seen.reshape(len(EYES), FLOOR_POINTS, LOBE_RAYS, 3).mean(axis=2)
        spread = seen.reshape(len(EYES), FLOOR_POINTS, LOBE_RAYS, 3).std(axis=2) / np.sqrt(LOBE_RAYS)
        print(f"gloss of the floor: Mitsuba's noise {100 * spread.sum() / self.gloss.sum():.1f} %")

    def _compared(self, scene: dict, ours: tuple[np.ndarray, np.ndarray], python: str, folder: Path):
        """Run Mitsuba, compare irradiance with paths of the program; return it and the radiance along rays."""
        found = traced(scene, python, folder)
        mean, error, along, version = (found[k] for k in ("mean", "error", "along", "version"))
        apart, both = np.abs(ours[0] - mean), np.sqrt(error**2 + ours[1] ** 2)
        beyond = (apart > 3 * both + 0.01 * mean).any(axis=1).sum()
        model = "principled" if scene["principled"] else "the same formulas"
        total, ratio = mean.sum(), ours[0].sum() / mean.sum()
        print(f"Mitsuba {version}, {model}: irradiance of {POINTS} points, paths / Mitsuba {ratio:.4f}, mean noise "
              f"{100 * both.sum() / total:.2f} %, l1 {100 * apart.sum() / total:.2f} %, {beyond} points beyond 3 "
              "standard errors + 1 %", flush=True)  # fmt: skip
        return mean, along

    def report(self, name: str, solver: Solver) -> None:
        """Print the error of a solver's frame."""
        E = solver.irradiance[self.rows]
        seen = []
        for eye in EYES:
            front, _ = gloss_colours(self.mesh, solver.frame.gloss.directions(), solver.irradiance, np.array(eye))
            seen.append(front[self.vertices])
        l1 = [np.abs(a - b).sum() / b.sum() for a, b in zip(seen, self.gloss, strict=True)]
        total = np.sum(seen) / self.gloss.sum()
        apart = np.abs(E - self.mean).sum() / self.mean.sum()
        print(f"{name} ({solver.frame.photons:,}): irradiance l1 {100 * apart:.1f} %, total "
              f"{E.sum() / self.mean.sum():.4f}; gloss of the floor l1 {', '.join(f'{100 * x:.1f}' for x in l1)} %, "
              f"total {total:.3f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
