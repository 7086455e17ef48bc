"""Squares that face the eye, and readings of their picture."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from app.draw.bare_lights import bare_lights, light_faces
from app.draw.camera import Bounds, from_camera
from app.draw.draw_mesh import DrawMesh
from gi_core.scene import Camera
from tests.support import viewer_support as support
from tests.support.scene_builders import quad

SIZE = (120, 80)
EYE = from_camera(Camera((0, 0, 2), (0, 0, 0), 40.0), (0, 1, 0), Bounds((-1, -1, -1), (1, 1, 1)))
IDENTITY = np.eye(4)


def square(front, back=None, half=0.4, z=0.0):
    """Return a square that faces the eye, with one radiance per side; no back: one-sided."""
    v, f, *_ = quad((-half, -half, z), (2 * half, 0, 0), (0, 2 * half, 0))
    n = len(v)
    sided = np.full(n, -1 if back is None else 1, np.int32)
    mesh = DrawMesh(v.astype(np.float32), f, np.zeros(n, np.int32), sided, np.zeros((n, 3)), np.zeros((n, 3)))
    return mesh, np.tile(np.float32(front), (n, 1)), np.tile(np.float32(back or (0, 0, 0)), (n, 1))


def middle(picture):
    return picture[SIZE[1] // 2, SIZE[0] // 2].astype(int)


def background():
    from app.draw.tonemap import BACKGROUND

    return np.round(255 * np.array(BACKGROUND)).astype(int)


HALF_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])


@contextmanager
def drawn(shot, ctx=None):
    """Yield a new renderer that has drawn a shot, in a context of its own unless one is given."""
    from app.draw.renderer import Renderer

    own = support.standalone_context() if ctx is None else None
    drawing = Renderer(ctx or own)
    try:
        drawing.set_scene(shot.lit.meshes)
        upload(drawing, shot)
        drawing.resize(*shot.settings.size)
        drawing.draw(look_of(shot))
        yield drawing
    finally:
        if own is not None:
            own.release()


def gl_picture(shot, ctx=None) -> np.ndarray:
    """Return the picture of a shot by a new renderer."""
    with drawn(shot, ctx) as drawing:
        return drawing.pixels()[..., :3].copy()


def upload(drawing, shot) -> None:
    """Upload the light of a shot."""
    lit = shot.lit
    for o, (colours, weights) in enumerate(zip(lit.sides, lit.weights, strict=True)):
        drawing.set_colours(o, *colours, weights=weights)
        drawing.set_irradiance(o, lit.drawn.irradiance)
    drawing.set_gloss(lit.gloss)
    drawing.set_light_faces(light_faces(lit.model, lit.levels))
    drawing.set_lights(bare_lights(lit))


def look_of(shot):
    """Return the Look of a shot."""
    from app.draw.renderer import Look
    from gi_core.scene.pose import rotation

    models = [np.eye(4)]
    for pose in shot.solver.poses.values():
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = rotation(pose), pose.position
        models.append(M)
    s = shot.settings
    width, height = s.size
    view_projection = shot.camera.projection(width / height) @ shot.camera.view()
    look = Look(view_projection, tuple(models), shot.exposure, s.tone_map, s.cull, textured=s.shows_radiance)
    return replace(look, scale=shot.scale, gains=shot.gains, eye=shot.camera.eye())
