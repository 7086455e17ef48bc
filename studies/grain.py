"""Grain of sharp gloss in rendered pictures: error per material against a picture of very many rays, and time.

Run: python -m studies.grain [SCENE] [--photons N] [--size WxH]. SCENE may be `spheres`, as docs/spheres.png.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from app import values
from app.draw import reflected, visible
from app.draw.layers import layers
from app.draw.shot import Shot
from app.draw.tonemap import to_display
from app.settings import Settings, make_solver, open_scene
from gi_core.geometry.error import luminance
from gi_core.gloss.reflectors import BY_CELLS, ways
from studies.brdf_spheres import spheres

MANY = 1024, 512  # rays of the truth, from lobes and to lamps
# Rays of a lobe and to lamps at most, and the noise of 255 above which pixels have more than one of each; 0: all have.
WAYS = {
    "as needed": (reflected.RAYS, reflected.LAMP_RAYS, reflected.NOISE),
    "all": (reflected.RAYS, reflected.LAMP_RAYS, 0.0),
    "lobes alone": (reflected.RAYS, 0, 0.0),
    "one": (1, 1, 0.0),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="spheres")
    parser.add_argument("--photons", type=int, default=300_000)
    parser.add_argument("--size", type=values.size, default=(300, 192))
    given = parser.parse_args()
    settings = Settings(scene=given.scene, size=given.size, photons=given.photons)
    solver = make_solver(spheres() if given.scene == "spheres" else open_scene(settings), settings)
    solver.solve()
    shot = Shot(solver, settings)
    shot.expose()
    sharp, names = _sharp_material(shot), [m.name for m in solver.scene.materials]
    kinds = {"all": sharp >= 0} | {name: sharp == k for k, name in enumerate(names)}
    truth, _ = _picture(shot, *MANY)
    for name, rays in WAYS.items():
        picture, took = _picture(shot, *rays)
        print(f"{name}: {took:.1f} s")
        for kind, seen in kinds.items():
            if seen.sum() > 50:
                print(f"  {kind:18} {seen.sum():6,} pixels, {_errors(shot, picture[seen], truth[seen])}")


def _sharp_material(shot: Shot) -> np.ndarray:
    """Return the material (h, w) whose sharp gloss all rays of a pixel see, -1 elsewhere."""
    model, (width, height), scene = shot.solver.model, shot.settings.size, shot.solver.scene
    at = model.transforms(shot.solver.poses)
    world, camera = visible.place(shot.meshes, at), shot.camera.relative_to(model.origins[0])
    strips = visible.strips(model.accelerator, at, world, camera, (width, height))
    face = np.concatenate([s.face for s in strips]).reshape(height, width, -1)
    worn = np.concatenate([m.face_material for m in (scene.static, *(m.mesh for m in scene.mobiles))])
    seen = np.where((face < 0) | (ways(shot.solver.model).way[face] == BY_CELLS), -1, worn[face])
    return np.where((seen == seen[..., :1]).all(axis=2), seen[..., 0], -1)


def _picture(shot: Shot, rays: int, lamp_rays: int, noise: float = 0.0) -> tuple[np.ndarray, float]:
    """Return the radiance (h, w, 3) [W/m2/sr] of a picture, and the time [s] of its rays."""
    reflected.RAYS, reflected.LAMP_RAYS, reflected.NOISE = rays, lamp_rays, noise
    start = time.perf_counter()
    return layers(shot).colour, time.perf_counter() - start


def _errors(shot: Shot, picture: np.ndarray, truth: np.ndarray) -> str:
    light, true = luminance(picture), luminance(truth)
    shown, meant = (luminance(to_display(c, shot.exposure, "aces", shot.gains).astype(float)) for c in (picture, truth))
    l1, rms = np.abs(light - true).sum() / true.sum(), math.sqrt(((light - true) ** 2).mean()) / true.mean()
    return (
        f"l1 {100 * l1:5.2f} %, RMSE {100 * rms:5.1f} %, {math.sqrt(((shown - meant) ** 2).mean()):5.2f} of 255 shown"
    )


if __name__ == "__main__":
    main()
