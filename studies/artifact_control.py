"""Numbers and picture of docs/artifact-control.md: small scenes without control, with control, and the reference.

    python -m studies.artifact_control [--times N] [--out FILE.webp]

Prints one line per scene and draws three pictures of each. The scenes are in tests/support.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from app.draw import raycast
from app.draw.draw_mesh import draw_meshes
from app.draw.shot import home_camera
from app.draw.vertex_colours import colours
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.scene.types import Camera
from gi_core.solver import Solver
from tests.support import control_scenes as scenes

SIZE = (300, 190)
PATHS = 64  # of the reference per receiver; its noise is in the means over hundreds
COLUMNS = ("without", "with", "reference")
VIEWS = {  # name: (case, camera's position, target, exposure)
    "corner": (scenes.corner, (0.75, 0.75, 0.55), (0.0, 0.05, 0.1), -1.6),
    "leg, white in a furnace": (lambda: scenes.leg(True), (0.66, 0.36, 0.14), (0.5, 0.5, 0.02), -1.6),
    "leg, black under a lamp": (lambda: scenes.leg(True, True), (0.66, 0.36, 0.14), (0.5, 0.5, 0.02), 1.3),
    "book, white in a furnace": (lambda: scenes.book(), (0.7, 0.22, 0.2), (0.52, 0.47, 0.0), -1.6),
    "book, black under a lamp": (lambda: scenes.book(True), (0.7, 0.22, 0.2), (0.52, 0.47, 0.0), 1.3),
    "thin wall, the dark room": (lambda: scenes.two_rooms(), (0.9, 0.15, 0.85), (0.5, 0.75, 0.2), 0.5),
    "thin wall, a mobile": (lambda: scenes.two_rooms(True), (0.9, 0.15, 0.85), (0.5, 0.75, 0.2), 0.5),
    "inside of a sphere": (lambda: scenes.ball(True), (0.0, -0.3, 0.1), (0.0, 0.5, 0.0), -1.6),
    "outside of a sphere": (lambda: scenes.ball(False), (0.0, -1.2, 0.4), (0.0, 0.0, 0.0), -0.5),
    "bumpy wall": (scenes.bumpy_wall, (0.5, 0.2, 0.3), (0.5, 0.5, 0.0), -0.2),
    "dark dome in light": (scenes.tent, (0.5, 0.38, 0.5), (0.5, 0.7, 0.5), 0.5),
}


def solved(case: scenes.ControlScene, control: bool, times: float) -> Solver:
    solver = Solver(case.scene, photons=int(times * case.photons), radius=case.radius, control=control)
    solver.solve()
    return solver


def measured(E: np.ndarray, T: np.ndarray, rows: np.ndarray) -> tuple[float, float]:
    """Return mean E over mean T, and mean |E - T| over mean T; over 1 W/m2 where all is dark."""
    light = T[rows].mean() or 1.0
    return E[rows].mean() / light, np.abs(E[rows] - T[rows]).mean() / light


def line(name: str, case: scenes.ControlScene, runs: list[Solver], T: np.ndarray) -> str:
    affected, free = scenes.classes(case, runs[0].surfaces, runs[0].receivers)
    texts = [f"{name:<26}{int(affected.sum()):>6}{runs[1].control_facts.stale:>6}"]
    for solver in runs:
        E = solver.irradiance[:, 0]
        mean, error = measured(E, T, affected)
        there = f"{100 * measured(E, T, free)[1]:>7.1f}" if free.any() else "      -"
        texts.append(f"{mean:>9.3f}{100 * error:>8.1f}{there}")
    return "".join(texts)


def picture(solver: Solver, irradiance: np.ndarray, exposure: float) -> np.ndarray:
    meshes = draw_meshes(solver.surfaces)
    shades = [colours(mesh, irradiance, False) for mesh in meshes]
    at = solver.model.transforms(solver.poses)
    camera = home_camera(solver)
    return raycast.picture(
        solver.model.accelerator, at, meshes, shades, camera, SIZE, exposure, "clip", True, lambda f: None, False
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--times", type=float, default=1.0, help="photons, times those of the tests (1)")
    parser.add_argument("--out", type=Path, help="WebP file to draw the pictures into")
    arguments = parser.parse_args()
    sheet = Image.new("RGB", (2 * (3 * SIZE[0] + 20), 24 + -(-len(VIEWS) // 2) * (SIZE[1] + 22)), (20, 20, 22))
    pen = ImageDraw.Draw(sheet)
    print(f"{'':<26}{'points':>6}{'again':>6}" + f"{'E/T':>9}{'error %':>8}{'open %':>7}" * 2)
    for k, (name, (build, position, target, exposure)) in enumerate(VIEWS.items()):
        case = build()
        case = case._replace(scene=replace(case.scene, camera=Camera(position, target, 45.0)))
        runs = [solved(case, control, arguments.times) for control in (False, True)]
        solver = runs[1]
        points = evaluation_points(solver.surfaces, solver.receivers)
        T = reference_irradiance(case.scene, *points, PATHS, 0, model=solver.model)[0]
        print(line(name, case, runs, T[:, 0]), flush=True)
        if arguments.out:
            left, top = (k % 2) * (3 * SIZE[0] + 20), 24 + (k // 2) * (SIZE[1] + 22)
            for j, E in enumerate((runs[0].irradiance, runs[1].irradiance, T)):
                sheet.paste(Image.fromarray(picture(solver, E, exposure)), (left + j * SIZE[0], top + 18))
                pen.text((left + j * SIZE[0] + 4, top + 3), f"{name}: {COLUMNS[j]}", (220, 220, 220))
    if arguments.out:
        sheet.save(arguments.out, quality=80)


if __name__ == "__main__":
    main()
