"""A picture of a sphere per reflection model, lit by two lamps in a room.

Run: python -m studies.brdf_spheres OUT.png [--photons N]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from app.draw.png import write_png
from app.draw.shot import Shot
from app.settings import Settings, make_solver
from gi_core.bsdf.models import MODELS, lobe
from gi_core.scene.types import Camera, Material, Mobile, Pose, Scene
from tests.support.scene_builders import box, merge, quad, sphere

COLOUR = (0.5, 0.08, 0.06)  # of diffuse parts
GOLD = (0.9, 0.65, 0.3)
PARAMETERS = {
    "perfect_diffuse": {"kd": COLOUR},
    "perfect_specular": {"ks": 0.9},
    "phong": {"kd": COLOUR, "ks": 0.2, "n": 40.0},
    "blinn": {"kd": COLOUR, "ks": 0.4, "n": 80.0},
    "torrance_sparrow": {"kd": 0.0, "ks": 1.0, "m": 0.3},
    "poulin_fournier": {"kd": COLOUR, "ks": 0.4},
    "ward": {"kd": 0.0, "ks": GOLD, "ax": 0.12, "ay": 0.5},
    "lewis": {"kd": COLOUR, "ks": 0.4, "n": 40.0},
    "oren_nayar": {"rho": COLOUR, "sigma": 0.6},
    "eon": {"rho": COLOUR},
}
COLUMNS, RADIUS, GAP = 5, 0.2, 0.5


def spheres() -> Scene:
    """Return a room with a mobile per model, in rows of COLUMNS."""
    lobes = {}
    for name, model in MODELS.items():
        given = {key: value for key, value in PARAMETERS.get(name, {}).items() if key in model.PARAMETERS}
        lobes[name] = lobe(name, given)
    materials = [Material("wall", (0.6, 0.6, 0.6)), Material("lamp", emission=(18.0, 16.0, 13.0))]
    materials += [Material(name, brdf=(part,), scaled=True) for name, part in lobes.items()]
    static = merge(
        box((-0.5, -2.0, 0.0), (2.5, 0.6, 2.0), 24, 0, inward=True),
        quad((0.2, -1.2, 1.98), (0, 0.5, 0), (0.5, 0, 0), (4, 4), 1),
        quad((1.5, -0.6, 1.98), (0, 0.5, 0), (0.3, 0, 0), (4, 4), 1),
    )
    mobiles = []
    for k, name in enumerate(lobes):
        row, column = divmod(k, COLUMNS)
        mesh = sphere((0, 0, 0), RADIUS, 4, 2 + k)
        mobiles.append(Mobile(name, mesh, Pose((GAP * column, 0.2, 1.35 - GAP * row))))
    camera = Camera((1.0, -1.95, 0.95), (1.0, 0.2, 0.85), 44.0)
    return Scene(static, tuple(materials), tuple(mobiles), camera=camera, up=(0, 0, 1), name="spheres")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--photons", type=int, default=400_000)
    options = parser.parse_args()
    settings = Settings(size=(1000, 640), photons=options.photons, radius=0.06, light="best")
    solver = make_solver(spheres(), settings)
    solver.solve()
    shot = Shot(solver, settings)
    write_png(options.out, shot.take(), {"models": " ".join(MODELS)})


if __name__ == "__main__":
    main()
