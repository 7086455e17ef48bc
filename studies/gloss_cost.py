"""Frame time of 20,000 glossy receivers against the same scene without gloss, in alternation.

    python -m studies.gloss_cost [--photons N] [--frames N] [--light photons|best]

The gallery of studies.mitsuba_gallery with a finer floor: floor and ball are glossy, or diffuse with the same
hemispherical albedo, so that both reflect as much light. Both move the ball along the same path, frame by frame in
turn.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace

import numpy as np

from gi_core.geometry.surfaces import glossy_receivers
from gi_core.model import Model
from gi_core.scene.pose import three
from gi_core.scene.types import Pose, Scene
from gi_core.solver import Solver
from studies.mitsuba_gallery import BALL, gallery

FLOOR = (100, 172)  # faces along its sides
RADIUS = 0.11  # of discs [m], which studies.mitsuba_gallery has


def diffuse(scene: Scene) -> Scene:
    """Return the scene without gloss, its materials with the same hemispherical albedo."""
    model = Model(scene)
    albedo, of = model.world.bsdfs.albedo, [o.face_material for o in (scene.static, *(m.mesh for m in scene.mobiles))]
    material = np.concatenate(of)
    faces = [np.flatnonzero(material == k)[:1] for k in range(len(scene.materials))]
    parts = zip(scene.materials, faces, strict=True)
    kept = (m._replace(gloss=None, brdf=(), reflectance=three(albedo[f[0]])) if len(f) else m for m, f in parts)
    return replace(scene, materials=tuple(kept))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photons", type=int, default=50_000)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--light", default="photons")
    given = parser.parse_args()
    scene = gallery(FLOOR)
    solvers = [Solver(of, photons=given.photons, radius=RADIUS, light=given.light) for of in (diffuse(scene), scene)]
    for solver in solvers:
        solver.solve()
    count = len(glossy_receivers(solvers[1].surfaces)), len(solvers[1].receivers.areas)
    print(f"{count[0]:,} glossy receivers of {count[1]:,}, {given.photons:,} photons")
    wall, cpu, stages = [[], []], [[], []], [{}, {}]
    for frame in range(given.frames):
        turn = 2 * math.pi * frame / given.frames
        pose = Pose((BALL[0] + math.cos(turn), BALL[1], BALL[2] + 0.5 * math.sin(turn)))
        for k, solver in enumerate(solvers):
            started, used = time.perf_counter(), time.process_time()
            solver.move("ball", pose)
            if frame:
                wall[k].append(1000 * (time.perf_counter() - started))
                cpu[k].append(1000 * (time.process_time() - used))
                for stage, seconds in solver.frame.timings.items():
                    stages[k].setdefault(stage, []).append(1000 * seconds)
    for name, k in (("diffuse", 0), ("glossy", 1)):
        parts = ", ".join(f"{stage} {np.median(times):.1f}" for stage, times in stages[k].items())
        print(f"{name}: frame {np.median(wall[k]):.1f} ms, CPU {np.median(cpu[k]):.1f} ms ({parts})")
    more = (100 * (np.median(both[1]) / np.median(both[0]) - 1) for both in (wall, cpu))
    print("more: {:+.0f} %, CPU {:+.0f} %".format(*more))


if __name__ == "__main__":
    main()
