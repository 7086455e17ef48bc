"""Error of the picture after an edit, with the light before it and without.

    python -m studies.edit_light cornell white --gather 30 --noise 1.5

The reflectance of a material changes to 0.3, 0.5, 0.7. CPU seconds stand for the clock, as in `studies.ten_seconds`:
two threads count GAIN times. The first picture of the edited scene is at second 0. Luminance error (l1) at receivers
of the first view, drawn by area, against the unbiased reference of the edited scene, whose noise is subtracted in
squares.
--pictures DIR writes a picture for each time.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.rest.scheduler import NO_ERRORS, RestWork
from app.session.lights import panel_of_faces
from app.settings import Settings, make_solver, open_scene
from gi_core.files.edits import Darken, Edit, Finish, Freeze, Light, Promote, edited
from gi_core.gather.reference_sample import draw_by_area, gather_sample
from gi_core.scene import Scene
from gi_core.solver import Solver
from studies.ten_seconds import GAIN
from tests.support.receiver_samples import in_view

ROWS = ("before, changed by photons", True), ("photons", False)
COLOUR = (0.3, 0.5, 0.7)
TIMES = 0.0, 1.0, 3.0, 6.0, 10.0, 20.0, 30.0  # s after the first picture


def edits_of(scene: Scene, what: str) -> list[Edit]:
    """Return the edits: "freeze" the first mobile, "promote:x,y,z", a lamp, or a material or mobile by name.

    "light:NAME:x,y,z" moves a light, "panel:NAME" puts one in place of the faces of a lamp.
    """
    kind, _, of = what.partition(":")
    if what == "freeze":
        return [Freeze(scene.mobiles[0].name, scene.mobiles[0].pose)]
    if kind == "promote":
        x, y, z = (float(c) for c in of.split(","))
        return [Promote("promoted", (x, y, z))]
    if kind == "light":
        name, _, place = of.partition(":")
        return [Light(name, (("position", tuple(float(c) for c in place.split(","))),))]
    if kind == "panel":
        values = panel_of_faces(scene, of, float(np.ptp(scene.static.vertices, axis=0).max()))
        return [Darken(of), Light(of, values or ())]
    return [Finish(what, (("reflectance", COLOUR),))]


def after(
    solver: Solver, scene: Scene, settings: Settings, with_light: bool
) -> list[tuple[float, np.ndarray, float, Solver]]:
    """Return times [s], irradiance and stated errors of the pictures after an edit."""
    results = solver.keep_results()
    other = make_solver(scene, settings, results if with_light else results.of("photons"))
    begun, found = time.process_time(), []

    def look() -> None:
        seconds, light = (time.process_time() - begun) / GAIN, other.drawn(other.irradiance).irradiance
        found.append((seconds, light, other.frame_light.static.error(other.levels), other))

    for progress in other.solve_steps():
        if progress.picture:
            look()
    work = RestWork(other, time.perf_counter)
    while found[-1][0] - found[0][0] < TIMES[-1] and (task := work.next_task(NO_ERRORS)) is not None:
        task.run()
        look()
    return [(t - found[0][0], *picture) for t, *picture in found]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument(
        "edit", help='a material or a mobile, "freeze", "promote:x,y,z", "light:NAME:x,y,z", "panel:NAME"'
    )
    parser.add_argument("--gather", type=float, default=30.0, help="CPU s before the edit")
    parser.add_argument("--points", type=int, default=400)
    parser.add_argument("--noise", type=float, default=1.5, help="of the truth [%%]")
    parser.add_argument("--photons", type=int)
    parser.add_argument("--pictures", type=Path)
    asked = parser.parse_args()
    settings = Settings(scene=asked.scene, light="best", photons=asked.photons)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GI_VIEWER_REFERENCE_DIR"] = folder  # nothing is known from before
        scene = open_scene(settings)
        solver = make_solver(scene, settings)
        solver.solve()
        work, begun = RestWork(solver, time.perf_counter), time.process_time()
        while time.process_time() - begun < asked.gather and (task := work.next_task(NO_ERRORS)) is not None:
            task.run()
        g = solver.frame_light.static.gathered
        print(f"{asked.scene}, {asked.edit}: gathered to {100 * g.estimate.error:.1f} % before the edit")
        changed = edited(scene, edits_of(scene, asked.edit))
        settings = replace(settings, photons=solver.photons)
        print("| light of the static part | " + " | ".join(f"{t:g} s" for t in TIMES) + " | noise of truth |")
        for name, with_light in ROWS:
            os.environ["GI_VIEWER_REFERENCE_DIR"] = str(Path(folder) / name)
            pictures = after(solver, changed, settings, with_light)
            other = pictures[0][-1]
            rows, weights = draw_by_area(in_view(other), other.model.object_receivers.areas, asked.points, 10)
            *_, sample = gather_sample(other.model, other.poses, rows, weights, 1, 1e-2 * asked.noise)
            at_times = [next(p for p in reversed(pictures) if p[0] <= time_) for time_ in TIMES]
            shown = [picture[1] for picture in at_times]
            errors = " | ".join(f"{100 * sample.error(E):.1f} %" for E in shown)
            print(f"| {name} | {errors} | {100 * sample.noise:.1f} % |", flush=True)
            stated = " | ".join("" if p[2] == float("inf") else f"{100 * p[2]:.1f} %" for p in at_times)
            print(f"| its stated error | {stated} | |", flush=True)
            if asked.pictures is not None:
                save(asked.pictures, other, shown, "with" if with_light else "without")


def save(folder: Path, solver: Solver, shown: list[np.ndarray], name: str) -> None:
    from app.draw.picture_files import write_png
    from app.draw.shot import Shot

    for seconds, E in zip(TIMES, shown, strict=True):
        solver.frame = solver.frame._replace(irradiance=E)
        write_png(folder / f"{name}-{seconds:g}.png", Shot(solver, Settings(size=(480, 300))).take())


if __name__ == "__main__":
    main()
