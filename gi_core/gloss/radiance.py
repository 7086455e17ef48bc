"""Radiance of gloss towards an eye, from directional light at receivers: the arithmetic of shaders/gloss.glsl.

L = sum over cells of f(w, o) E_cell: a cell's share of the irradiance has its cosine in it already.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vec import cross, dot
from gi_core.bsdf import ggx, table

LEAST_ALPHA = 0.15  # lobes are drawn no sharper: vertices and cells cannot carry more
GRAZING = 0.05  # least cosine of a direction


@kernel
def gloss_radiance(cells, row, irradiance, position, normal, lobe, tangent, tables, eye, out):
    """Write the radiance (D, 3) [W/m2/sr] of gloss at D vertices.

    cells (n, CELLS, 6): see `gi_core.gloss.cells.GlossLight`; row (D,): into it, -1: no gloss; irradiance (D, 3)
    [W/m2]; position, normal, tangent (D, 3) and eye (3,) in the object's space; lobe (D, 5): F0, F90, alpha; alpha
    -1 - k: table k of `tables`.
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
        if lobe[v, 4] < 0.0:
            r, g, b = _from_table(tables, -1 - int(lobe[v, 4]), cells[k], n, tangent[v], (x, y, z))
            out[v, 0], out[v, 1], out[v, 2] = r * irradiance[v, 0], g * irradiance[v, 1], b * irradiance[v, 2]
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


@kernel
def _from_table(tables, m, cells, n, t, o):
    """Return the radiance of a table towards o under irradiance 1. A mirror is shown as a lobe of LEAST_ALPHA."""
    s = cross(n, t)
    ox, oy, oz = dot(o, t), dot(o, s), max(dot(o, n), GRAZING)
    far, glass = ggx._lambda(LEAST_ALPHA, oz), table.mirror_share(tables, m, ox, oy, oz)
    glass *= table.albedo(tables, m, ox, oy, oz)
    red = green = blue = 0.0
    for c in range(len(cells)):
        r, g, b = cells[c, 0], cells[c, 1], cells[c, 2]
        if r + g + b <= 0.0:
            continue
        w = cells[c, 3], cells[c, 4], cells[c, 5]
        wx, wy, wz = dot(w, t), dot(w, s), max(dot(w, n), GRAZING)
        f, h, p = table.value(tables, m, wx, wy, wz, ox, oy, oz)
        if glass > 0.0:
            hx, hy, hz = wx + ox, wy + oy, wz + oz
            cos_h = hz / max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
            more = 1.0 + far + ggx._lambda(LEAST_ALPHA, wz)
            mirror = glass * ggx.distribution(LEAST_ALPHA, cos_h) / (4.0 * wz * oz * more)
            f, h, p = f + mirror, h + mirror, p + mirror
        red, green, blue = red + f * r, green + h * g, blue + p * b
    return red, green, blue


def room_for(vertices: int) -> np.ndarray:
    """Return an array (vertices, 3) float32 for gloss_radiance()."""
    return np.empty((vertices, 3), np.float32)
