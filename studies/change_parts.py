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

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from app.settings import Settings, open_moving_scene
from gi_core.gather.reference_sample import draw_by_area, gather_sample
from gi_core.geometry.error import relative_error
from gi_core.model import Model
from gi_core.scene import Mesh, Scene
from gi_core.solver import Solver
from studies.mobile_changes import FRAMES, PLACES, places, print_rows, touched, with_change

RADII = (1.0, 2.0, 4.0)  # over the default
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


def truth(scene: Scene, poses: dict, rows: np.ndarray, weights: np.ndarray, seed: int) -> np.ndarray:
    """Return path traced irradiance (n, 3) [W/m2] at static receivers of a scene."""
    *_, sample = gather_sample(Model(scene), poses, rows, weights, seed, NOISE)
    return sample.irradiance


def rows_of(name: str) -> Iterator[str]:
    """Yield the rows of a scene."""
    scene = open_moving_scene(Settings(scene=name))
    dark = black(scene)
    scout = Solver(scene, photons=SCOUT, light="photons")
    scout.solve()
    radius, static = scout.setting.radius, scout.surfaces.receiver_range(0)
    areas, cases = scout.receivers.areas[static], []
    for place, poses in zip(PLACES, places(scout), strict=True):
        scout.move_all(poses)
        changed = touched(scout.irradiance[static], scout.static_irradiance, areas, TOUCHED)
        rows, weights = draw_by_area(np.flatnonzero((areas > 0) & changed), areas, POINTS, place)
        moved = [truth(s, poses, rows, weights, SEED) for s in (scene, dark)]
        rest = [truth(replace(s, mobiles=()), {}, rows, weights, SEED + 1) for s in (scene, dark)]
        cases.append((poses, rows, weights, *moved, *rest))
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
                B, Bd = (s.static_irradiance[rows] for s in pair)
                every = with_change(F, B, G)
                direct, rest = with_change(Fd, Bd, Gd), with_change(F - Fd, B - Bd, G - Gd)
                light = (every, direct + T - Td, Td + rest)
                found += [relative_error(E, T, weights).l1 / len(cases) for E in light]
            cells = " | ".join(f"{100 * e:.1f}" for e in found)
            yield f"{photons:,} | {factor:g} | {cells} | {ms:.1f}"


if __name__ == "__main__":
    print_rows(__doc__, "radius | all | direct | indirect | ms", rows_of)
