"""Squares that face the eye, and readings of their picture."""

from __future__ import annotations

import numpy as np

from app.draw.camera import Bounds, from_camera
from app.draw.vertex_colours import DrawMesh
from gi_core.scene import Camera
from tests.support import viewer_support as support

SIZE = (120, 80)
EYE = from_camera(Camera((0, 0, 2), (0, 0, 0), 40.0), (0, 1, 0), Bounds((-1, -1, -1), (1, 1, 1)))
IDENTITY = np.eye(4)


def square(front, back=None, half=0.4, z=0.0):
    """Return a square that faces the eye, with one radiance per side; no back: one-sided."""
    v, f = support.quad((-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z))
    n = len(v)
    sided = np.full(n, -1 if back is None else 1, np.int32)
    mesh = DrawMesh(v.astype(np.float32), f, np.zeros(n, np.int32), sided, np.zeros((n, 3)), np.zeros((n, 3)))
    return mesh, np.tile(np.float32(front), (n, 1)), np.tile(np.float32(back or (0, 0, 0)), (n, 1))


def middle(picture):
    return picture[SIZE[1] // 2, SIZE[0] // 2].astype(int)


def background():
    from app.draw.renderer import BACKGROUND

    return np.round(255 * np.array(BACKGROUND)).astype(int)


HALF_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])
