"""Rays drawn from the gloss of a surface, as photons draw them: for pictures, and to measure a lobe.

Values and densities of a lobe are those of its draws, in the axes of `local_view`.
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis
from gi_core.base.vec import cross, dot, row, weighted
from gi_core.bsdf import ggx, table
from gi_core.bsdf.table import Tables

GRAZING = 1e-3  # least cosine of the view


def draw_lobe(
    lobe: np.ndarray, tables: Tables, to_eye: np.ndarray, normals: np.ndarray, tangents: np.ndarray, numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a direction of incident light per view: return directions, factors and values of f.

    lobe (n, 5): F0, F90, alpha, < 0 for tables; to_eye, normals, tangents (n, 3) unit; numbers (n, 3) in [0, 1).
    Directions (n, 3) float64 are unit; their radiance times factors (n, 3) is the mean radiance of gloss; f (n,) [1/sr]
    is its largest channel, inf for a mirror. Factors are 0 below the surface.
    """
    n = len(to_eye)
    out = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    views = (np.ascontiguousarray(a, np.float64) for a in (lobe, to_eye, normals, tangents, numbers))
    lobe, to_eye, normals, tangents, numbers = views
    _draw(lobe, tables, to_eye, normals, tangents, numbers, *out)
    return out


@kernel
def local_view(lobe, to_eye, normals, tangents, k):
    """Return the axes of view k in the world, and its direction to the eye in these, above the surface."""
    n, d = row(normals, k), row(to_eye, k)
    ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
    a, b = (ax, ay, az), (bx, by, bz)
    if lobe[k, 4] < 0.0:
        a = row(tangents, k)
        b = cross(n, a)
    ix, iy, iz = dot(d, a), dot(d, b), max(dot(d, n), GRAZING)
    size = math.sqrt(ix * ix + iy * iy + iz * iz)
    return (a, b, n), (ix / size, iy / size, iz / size)


@kernel
def local_value(tables, lobe, k, i, o):
    """Return f [1/sr] of lobe k, red, green, blue, for the directions i to the eye and o above; 0 for a mirror."""
    alpha = lobe[k, 4]
    if alpha < 0.0:
        return table.value(tables, -1 - int(alpha), i[0], i[1], i[2], o[0], o[1], o[2])
    if alpha < ggx.SMOOTH:
        return 0.0, 0.0, 0.0
    f, c = ggx.gloss(alpha, i[0], i[1], i[2], o[0], o[1], o[2])
    red, green, blue = ggx.fresnels(lobe[k], c)
    return f * red, f * green, f * blue


@kernel
def local_density(tables, lobe, k, i, o):
    """Return the density [1/sr] with which draw_lobe() takes o; arguments as for local_value()."""
    alpha = lobe[k, 4]
    if alpha < 0.0:
        return table.pdf(tables, -1 - int(alpha), i[0], i[1], i[2], o[0], o[1], o[2])
    if alpha < ggx.SMOOTH:
        return 0.0
    return ggx.gloss(alpha, i[0], i[1], i[2], o[0], o[1], o[2])[0] * o[2] / ggx.masking(alpha, i[2], o[2])


@kernel
def _draw(lobe, tables, to_eye, normals, tangents, numbers, directions, factors, values):
    for k in range(len(lobe)):
        u, v, w = numbers[k, 0], numbers[k, 1], numbers[k, 2]
        (a, b, n), (ix, iy, iz) = local_view(lobe, to_eye, normals, tangents, k)
        f = math.inf
        if lobe[k, 4] < 0.0:
            m = -1 - int(lobe[k, 4])
            x, y, z, red, green, blue = table.sample(tables, m, ix, iy, iz, u, v, w)
            share = table.albedo(tables, m, ix, iy, iz)
            red, green, blue = share * red, share * green, share * blue
            if w < 1.0 - table.mirror_share(tables, m, ix, iy, iz):
                r, g, c = table.value(tables, m, ix, iy, iz, x, y, z)
                f = max(r, max(g, c))
        else:
            alpha = lobe[k, 4]
            hx, hy, hz, g = 0.0, 0.0, 1.0, 1.0
            if alpha >= ggx.SMOOTH:
                hx, hy, hz = ggx.visible_half(alpha, ix, iy, iz, u, v)
            c = ix * hx + iy * hy + iz * hz
            x, y, z = 2.0 * c * hx - ix, 2.0 * c * hy - iy, 2.0 * c * hz - iz
            red, green, blue = ggx.fresnels(lobe[k], c)
            if alpha >= ggx.SMOOTH and z > 0.0:
                g = ggx.masking(alpha, iz, z)
                f = ggx.gloss(alpha, ix, iy, iz, x, y, z)[0] * max(red, max(green, blue))
            red, green, blue = g * red, g * green, g * blue
        if z <= 0.0:
            red, green, blue, f = 0.0, 0.0, 0.0, 0.0
        o = weighted((x, y, z), a, b, n)
        directions[k, 0], directions[k, 1], directions[k, 2] = o[0], o[1], o[2]
        factors[k, 0], factors[k, 1], factors[k, 2] = red, green, blue
        values[k] = f
