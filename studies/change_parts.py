"""Errors of direct and of indirect changes, in frames of few photons: `python -m studies.change_parts SCENE ...`.

The question is whether exact direct light, with photons of a wider radius for the rest, would be better than photons
alone. Direct light of the same photons comes from a black twin of the scene: photon i leaves its lamp alike there.
Poses: three places of the mobiles' path. Luminance error (l1, gi_core.geometry.error) at static receivers that mobiles
change by more than TOUCHED of the mean. Truth and light at rest are path traced, with NOISE each. Changes are neither
smoothed nor shrunk.

Columns: photons; radius over the default; error of the whole change; errors of its direct and of its indirect part
alone, over all light; time of a frame of all light.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from app.draw import motion
from app.settings import STEP, Settings, open_moving_scene
from gi_core.gather.reference_sample import draw_by_area, gather_sample
from gi_core.geometry.error import luminance, relative_error
from gi_core.model import Model
from gi_core.scene import Mesh, Scene
from gi_core.solver import Solver

FRAMES = (1 << 14, 1 << 16)  # photons
RADII = (1.0, 2.0, 4.0)  # over the default
STEPS, PLACES = 40, (6, 20, 33)  # of the path, and those measured
TOUCHED = 0.01
POINTS, NOISE, SEED = 300, 0.01, 77
SCOUT = 1 << 21  # photons that find changed receivers


def black(scene: Scene) -> Scene:
    """Return the scene with surfaces that only emit."""

    def dark(mesh: Mesh) -> Mesh:
        return mesh._replace(face_reflectance=np.zeros((len(mesh.faces), 3)), paint=None)

    materials = tuple(m._replace(reflectance=(0.0, 0.0, 0.0), gloss=None, brdf=()) for m in scene.materials)
    mobiles = tuple(m._replace(mesh=dark(m.mesh)) for m in scene.mobiles)
    return replace(scene, static=dark(scene.static), materials=materials, mobiles=mobiles)


def with_change(frame: np.ndarray, rest: np.ndarray, better: np.ndarray) -> np.ndarray:
    """Return better light at rest with the change of a frame, as gi_core.frames.control_variate measures it."""
    share = np.divide(frame, rest, out=np.ones_like(frame), where=rest > 0)
    return np.where(frame < rest, better * share, better + frame - rest)


def truth(scene: Scene, poses: dict, rows: np.ndarray, weights: np.ndarray, seed: int) -> np.ndarray:
    """Return path traced irradiance (n, 3) [W/m2] at static receivers of a scene."""
    *_, sample = gather_sample(Model(scene), poses, rows, weights, seed, NOISE)
    return sample.irradiance


def report(name: str) -> None:
    """Print the rows of a scene."""
    scene = open_moving_scene(Settings(scene=name))
    dark = black(scene)
    scout = Solver(scene, photons=SCOUT, light="photons")
    scout.solve()
    radius, static = scout.setting.radius, scout.surfaces.receiver_range(0)
    areas, still = scout.receivers.areas[static], luminance(scout.resting_irradiance)
    lap = motion.walk(motion.paths_of(scout), STEP * scout.scene_size, STEPS)
    cases = []
    for place in PLACES:
        scout.move_all(lap[place])
        change = np.abs(luminance(scout.irradiance[static]) - still)
        changed = np.flatnonzero((areas > 0) & (change > TOUCHED * np.average(still, weights=areas)))
        rows, weights = draw_by_area(changed, areas, POINTS, place)
        moved = [truth(s, lap[place], rows, weights, SEED) for s in (scene, dark)]
        rest = [truth(replace(s, mobiles=()), {}, rows, weights, SEED + 1) for s in (scene, dark)]
        cases.append((lap[place], rows, weights, *moved, *rest))
    del scout
    for photons in FRAMES:
        for factor in RADII:
            pair = [Solver(s, photons=photons, radius=factor * radius, light="photons") for s in (scene, dark)]
            for solver in pair:
                solver.solve()
            found, ms = np.zeros(3), 0.0
            for poses, rows, weights, T, Td, G, Gd in cases:
                for solver in pair:
                    solver.move_all(poses)
                ms += 1e3 * sum(pair[0].frame.timings.values()) / len(cases)
                F, Fd = (s.irradiance[rows] for s in pair)
                B, Bd = (s.resting_irradiance[rows] for s in pair)
                every = with_change(F, B, G)
                direct, rest = with_change(Fd, Bd, Gd), with_change(F - Fd, B - Bd, G - Gd)
                light = (every, direct + T - Td, Td + rest)
                found += [relative_error(E, T, weights).l1 / len(cases) for E in light]
            cells = " | ".join(f"{100 * e:.1f}" for e in found)
            print(f"| {name} | {photons:,} | {factor:g} | {cells} | {ms:.1f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    print("| scene | photons | radius | all | direct | indirect | ms |\n|---|---|---|---|---|---|---|")
    for name in parser.parse_args().scenes:
        report(name)


if __name__ == "__main__":
    main()
