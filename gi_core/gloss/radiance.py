"""Radiance of gloss towards an eye, from directional light at receivers: the arithmetic of shaders/gloss.glsl.

L = sum over cells of f(w, o) E_cell: a cell's share of the irradiance has its cosine in it already.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import kernel
from gi_core.bsdf import ggx

LEAST_ALPHA = 0.15  # lobes are drawn no sharper: vertices and cells cannot carry more
GRAZING = 0.05  # least cosine of a direction


@kernel
def gloss_radiance(cells, row, irradiance, position, normal, lobe, eye, out):
    """Write the radiance (D, 3) [W/m2/sr] of gloss at D vertices.

    cells (n, CELLS, 6): see `gi_core.gloss.cells.GlossLight`; row (D,): into it, -1: no gloss; irradiance (D, 3)
    [W/m2]; position, normal (D, 3) and eye (3,) in the object's space; lobe (D, 5): F0, F90, alpha.
    """
    for v in range(len(row)):
        out[v, 0] = out[v, 1] = out[v, 2] = 0.0
        if row[v] < 0:
            continue
        n, k = normal[v], row[v]
        x, y, z = eye[0] - position[v, 0], eye[1] - position[v, 1], eye[2] - position[v, 2]
        size = math.sqrt(x * x + y * y + z * z)
        if not size > 0.0:
            continue
        x, y, z = x / size, y / size, z / size
        at_eye = x * n[0] + y * n[1] + z * n[2]
        if at_eye <= 0.0:
            continue
        at_eye = max(at_eye, GRAZING)
        alpha = max(lobe[v, 4], LEAST_ALPHA)
        far = ggx._lambda(alpha, at_eye)
        red = green = blue = 0.0
        for c in range(cells.shape[1]):
            r, g, b = cells[k, c, 0], cells[k, c, 1], cells[k, c, 2]
            if r + g + b <= 0.0:
                continue
            wx, wy, wz = cells[k, c, 3], cells[k, c, 4], cells[k, c, 5]
            at_light = max(wx * n[0] + wy * n[1] + wz * n[2], GRAZING)
            hx, hy, hz = wx + x, wy + y, wz + z
            size = max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
            cos_h = (hx * n[0] + hy * n[1] + hz * n[2]) / size
            cos_d = (wx * hx + wy * hy + wz * hz) / size
            f = ggx.distribution(alpha, cos_h) / (4.0 * at_light * at_eye * (1.0 + far + ggx._lambda(alpha, at_light)))
            s = max(0.0, 1.0 - cos_d) ** 5
            red += f * r * (lobe[v, 0] + (lobe[v, 3] - lobe[v, 0]) * s)
            green += f * g * (lobe[v, 1] + (lobe[v, 3] - lobe[v, 1]) * s)
            blue += f * b * (lobe[v, 2] + (lobe[v, 3] - lobe[v, 2]) * s)
        out[v, 0], out[v, 1], out[v, 2] = red * irradiance[v, 0], green * irradiance[v, 1], blue * irradiance[v, 2]


def room_for(vertices: int) -> np.ndarray:
    """Return an array (vertices, 3) float32 for gloss_radiance()."""
    return np.empty((vertices, 3), np.float32)
