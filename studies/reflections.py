"""Sharp gloss: OpenGL against traced rays, and the time of frames.

Run: python -m studies.reflections [SCENE] [--photons N] [--size WxH]
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from app import values
from app.draw import visible
from app.draw.renderer import Renderer
from app.draw.shot import Shot
from app.draw.tonemap import srgb_decode
from app.settings import Settings, make_solver, open_scene
from gi_core.gloss.reflectors import BY_CELLS, ways
from tests.support.gl_drawing import look_of, upload
from tests.support.viewer_support import standalone_context

REPEATS = 5  # of a frame


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="showroom")
    parser.add_argument("--photons", type=int, default=300_000)
    parser.add_argument("--size", type=values.size, default=(720, 450))
    given = parser.parse_args()
    settings = Settings(scene=given.scene, photons=given.photons, size=given.size, tone_map="clip")
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    shot = Shot(solver, settings)
    traced = srgb_decode(shot.take() / 255)
    drawn = srgb_decode(_drawn(shot) / 255)
    face = _faces(shot)
    scene = solver.scene
    worn = np.concatenate([m.face_material for m in (scene.static, *(m.mesh for m in scene.mobiles))])
    noise, way, _ = ways(solver.model)
    for k, m in enumerate(scene.materials):
        for kind in np.unique(way[(worn == k) & ~np.isnan(noise)]):
            seen = (face >= 0) & (worn[face] == k) & (way[face] == kind)
            if seen.sum() > 50 and kind != BY_CELLS:
                apart, level = (drawn - traced)[seen], traced[seen].sum()
                print(f"{m.name:12} {kind:8} {seen.sum():7,} pixels, l1 {100 * np.abs(apart).sum() / level:5.1f} %, "
                      f"bias {100 * apart.sum() / level:+5.1f} %")  # fmt: skip


def _drawn(shot: Shot) -> np.ndarray:
    """Return the OpenGL picture, and print the time of frames."""
    ctx = standalone_context()
    drawing = Renderer(ctx)
    try:
        drawing.set_scene(shot.meshes)
        upload(drawing, shot)
        drawing.resize(*shot.settings.size)
        look = look_of(shot)
        drawing.draw(look)
        picture = drawing.pixels()[..., :3].copy()
        mirrors = drawing._mirrors
        for name, before in (("camera moved", lambda: None), ("light changed", mirrors.forget), ("none", None)):
            if before is None:
                drawing._mirrors = type(mirrors)(ctx, ())
            took = []
            for _ in range(REPEATS):
                if before is not None:
                    before()
                start = time.perf_counter()
                drawing.draw(look)
                ctx.finish()
                took.append(time.perf_counter() - start)
            print(f"frame, reflections: {name:14} {1000 * np.median(took):6.0f} ms ({ctx.info['GL_RENDERER']})")
        drawing._mirrors = mirrors
        return picture
    finally:
        drawing.release()
        ctx.release()


def _faces(shot: Shot) -> np.ndarray:
    """Return the face (h, w) that all rays of a pixel see, -1 along edges."""
    model, (width, height) = shot.solver.model, shot.settings.size
    at = model.transforms(shot.solver.poses)
    world, camera = visible.place(shot.meshes, at), shot.camera.relative_to(model.origins[0])
    strips = visible.strips(model.accelerator, at, world, camera, shot.settings.size)
    rays = np.concatenate([s.face for s in strips]).reshape(height, width, -1)
    return np.where((rays == rays[..., :1]).all(axis=2), rays[..., 0], -1)


if __name__ == "__main__":
    main()
