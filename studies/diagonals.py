"""Error between vertices, with shared diagonals and with those along the light: `python -m studies.diagonals SCENE`.

Light at vertices is gathered for SECONDS of CPU time, without mobiles. A border of light is a quadrilateral of the
static part in whose middle the diagonals differ by CLEAR of the mean light. Truth is path traced at POINTS random
points of borders with NOISE, which is subtracted in squares. Columns: quadrilaterals, and their share of the area;
borders, and their share; relative l1 errors of luminance there with both diagonals; CPU ms for finding the
quadrilaterals once, and for choosing diagonals per frame.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from app.draw.diagonals import other_diagonals, with_diagonals
from app.draw.draw_mesh import DrawMesh, draw_meshes
from app.draw.quads import quads_of
from app.draw.raycast import both_sides, seen_radiance
from app.draw.vertex_colours import colours, weights
from app.draw.visible import barycentrics, place
from app.settings import Settings, make_solver, open_scene
from gi_core.gather.reference import ReferenceRounds
from gi_core.geometry.error import bias_left, luminance, noise_of_truth, relative_error
from gi_core.model import Model

SECONDS, POINTS, NOISE, SEED = 60.0, 1500, 0.01, 5
CLEAR = 0.05
ABOVE = 1e-3  # of the scene size: start of the rays that look at the points


def truth(model: Model, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return irradiance (n, 3) [W/m2] at points and its standard error."""
    even = np.ones(len(points))
    rounds = ReferenceRounds(model.scene, points, normals, SEED, even, model=model)
    while rounds.state.noise(even) > NOISE:
        rounds.step()
    return rounds.state.mean, rounds.state.standard_error


def row(name: str) -> str:
    """Return the row of a scene."""
    settings = Settings(scene=name, light="best")
    scene = replace(open_scene(settings), mobiles=())
    solver = make_solver(scene, settings)
    solver.solve()
    started = time.process_time()
    for _ in solver.gather_steps():
        if time.process_time() - started > SECONDS:
            break
    solver.move_all({})
    model, drawn, mesh = solver.model, solver.drawn(solver.irradiance), draw_meshes(solver.surfaces)[0]
    started = time.process_time()
    quads_of(mesh.positions, mesh.triangles, mesh.uv)
    finding = 1e3 * (time.process_time() - started)
    sides, w = colours(mesh, drawn.irradiance, with_reflectance=False), weights(mesh, drawn.weights)
    started = time.process_time()
    for _ in range(20):
        along = with_diagonals(mesh, other_diagonals(mesh, *sides, w))
    choosing = 1e3 * (time.process_time() - started) / 20

    random, static = np.random.default_rng(SEED), place([mesh], model.static)
    area = np.sqrt((static.normals.astype(float) ** 2).sum(axis=1)) / 2
    reached = np.ones(len(area), bool) if w is None else (w[mesh.triangles, 0] == 1).all(axis=1)
    light = luminance(sides[0])
    a, b, d, c = light[mesh.quads.corners]
    clear = np.abs(a + d - b - c) / 2 > CLEAR * np.average(light[mesh.triangles].mean(axis=1), weights=area)
    inside = np.isin(np.arange(len(area)), mesh.quads.faces[clear]) & reached
    face = random.choice(len(area), POINTS, p=area * inside / (area * inside).sum())
    s, t = np.sort(random.random((2, POINTS)), axis=0)
    share = np.stack([s, t - s, 1 - t], axis=1)
    points = (static.corners[face] * share[:, :, None]).sum(axis=1).astype(float)
    normals = static.normals[face] / (2 * area[face, None])

    def seen(drawn_mesh: DrawMesh) -> np.ndarray:
        world = place([drawn_mesh], model.static)
        eyes, d = points + ABOVE * solver.scene_size * normals, -normals
        met = world.met(face, eyes, d)
        u, v = barycentrics(world.corners[met], eyes, d)
        return np.pi * seen_radiance(world, *both_sides([sides], [w]), met, u, v, d, None, eyes)[0]

    E, standard_error = truth(model, points + model.origins[0], normals)
    even = np.ones(POINTS)
    noise = noise_of_truth(standard_error, E, even)
    errors = (100 * bias_left(relative_error(seen(m), E, even).l1, noise) for m in (mesh, along))
    every = area[mesh.quads.faces.reshape(-1)].sum()
    parts = (
        f"{n:,}, {100 * part / area.sum():.1f} %" for n, part in ((len(a), every), (clear.sum(), area[inside].sum()))
    )
    return " | ".join([*parts, *(f"{e:.2f}" for e in errors), f"{finding:.0f}", f"{choosing:.2f}"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    print("| scene | quadrilaterals | borders | shared (%) | along (%) | finding (ms) | choosing (ms) |")
    print("|---|---|---|---|---|---|---|")
    for name in parser.parse_args().scenes:
        print(f"| {name} | {row(name)} |", flush=True)


if __name__ == "__main__":
    main()
