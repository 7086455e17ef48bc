"""Directional light of a frame at glossy receivers, and the radiance that gloss sends to an eye.

L = sum over cells, or rays, of f(w, o) E_cell: a cell's share of the irradiance has its cosine in it already. The
arithmetic is that of shaders/surface.vert.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis
from gi_core.base.vec import cross, dot
from gi_core.bsdf import ggx, table
from gi_core.gloss.hemisphere import GRAZING
from gi_core.gloss.rays import RayTree

FIELDS = 6  # of a cell, see GlossLight
LEAST_ALPHA = 0.15  # lobes are drawn no sharper: vertices and cells cannot carry more
SPREAD = 0.5  # of alpha^2 per missing length of a mean direction: 64 cells differ from the list by a fifth less
LOBE_POINTS = 3  # of a table's lobe around a mean direction, as far off as the missing length says: gloss-cells.md
ONE = 1e-3  # missing length of a single ray, as float32 and half floats have it

# Writes the cells (k, CELLS, 6) of receivers (k,), ascending, given their places (k,) in the resting light.
CellWriter = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]


class Directions(NamedTuple):
    """Light at n glossy receivers by direction: cells, and their rays where these are kept."""

    cells: np.ndarray  # (m, CELLS, 6) float32: see GlossLight
    offsets: np.ndarray  # (n CELLS + 1,) int64 into `rays`, see `gi_core.gloss.rays`; (1,): cells alone
    rays: np.ndarray  # (m, 6) float32, as cells
    opened: float = 0.0  # share of the light of all cells towards the eye, above which a cell's rays are read; < 0: all
    place: np.ndarray = np.zeros(0, np.int32)  # (n,) int32 into `cells`; empty: each receiver has its own


class GlossLight(NamedTuple):
    """Directional light of a frame at n glossy receivers, held by m of them. The arrays are never written to again.

    A cell holds (red, green, blue, x, y, z): the share of irradiance that arrives through it, per channel, and the mean
    direction towards that light in the object's space. The mean is shorter than 1 where directions spread. Rays weigh
    flux / sqrt(cos), between irradiance and radiance.
    """

    rows: np.ndarray  # (n,) int64, receivers, ascending
    owners: np.ndarray  # (m,) int64, receivers whose cells these are, ascending
    place: np.ndarray  # (n,) int32 into owners
    resting: np.ndarray  # (m, CELLS, 6) float32, without mobiles; no light on mobiles, even light where probes show it
    changed: np.ndarray  # (k,) int64 into owners, ascending
    cells: np.ndarray  # (k, CELLS, 6) float32, in place of `resting`
    tree: RayTree | None = None  # the rays one by one, see `gi_core.gloss.rays`; None: cells alone
    opened: float = 0.0  # see Directions

    def directions(self, only: np.ndarray | None = None) -> Directions:
        """Return the light of all receivers, or `only` of some (k,), rows of `rows`: the rows of others are not to be
        read.
        """
        owners = slice(None) if only is None else np.unique(self.place[only])
        cells, place, tree = self.resting[owners], self.place, self.tree
        if only is None:
            cells = cells.copy()
            cells[self.changed] = self.cells
        else:
            _, changed, now = np.intersect1d(owners, self.changed, assume_unique=True, return_indices=True)
            cells[changed] = self.cells[now]
            place = np.zeros_like(place)
            place[only] = np.searchsorted(owners, self.place[only])
        if tree is None:
            return Directions(cells, np.zeros(1, np.int64), np.empty((0, FIELDS), np.float32), 0.0, place)
        return Directions(cells, tree.offsets, tree.rays, self.opened, place)


def settled(light: GlossLight, place: np.ndarray, cells: np.ndarray) -> GlossLight:
    """Return the light with other cells (n, CELLS, 6) of owners place (n,), ascending."""
    other = np.flatnonzero(~np.isin(light.changed, place))
    changed = np.concatenate([light.changed[other], place])
    order = np.argsort(changed)
    return light._replace(changed=changed[order], cells=np.concatenate([light.cells[other], cells])[order])


@kernel
def gloss_radiance(directions, row, irradiance, position, normal, lobe, tangent, tables, eye, out):
    """Write the radiance (D, 3) [W/m2/sr] of gloss at D vertices.

    directions: a Directions; row (D,): receiver in it, -1: no gloss; irradiance (D, 3) [W/m2]; position, normal,
    tangent (D, 3) and eye (3,) in the object's space; lobe (D, 5): F0, F90, alpha; alpha -1 - k: table k of `tables`.
    """
    cells, offsets, rays, opened, place = directions
    count, has_rays = cells.shape[1], len(offsets) > 1
    for v in range(len(row)):
        out[v, 0] = out[v, 1] = out[v, 2] = 0.0
        n, k = normal[v], row[v]
        x, y, z = eye[0] - position[v, 0], eye[1] - position[v, 1], eye[2] - position[v, 2]
        size = math.sqrt(x * x + y * y + z * z)
        # Normals of vertices turn some 10 degrees further than visible faces.
        if k < 0 or not size > 0.0 or x * n[0] + y * n[1] + z * n[2] <= -0.2 * size:
            continue
        of = cells[place[k] if len(place) else k]
        view = _view(tables, lobe[v], n, tangent[v], (x / size, y / size, z / size))
        red = green = blue = 0.0
        if opened >= 0.0:
            for c in range(count):
                r, g, b = _sent(tables, lobe[v], n, view, of, c)
                red, green, blue = red + r, green + g, blue + b
        if has_rays:
            limit = opened * (red + green + blue)
            red = green = blue = 0.0
            for c in range(count):
                r = g = b = math.inf
                if opened >= 0.0:
                    r, g, b = _sent(tables, lobe[v], n, view, of, c)
                if r + g + b > limit:
                    r = g = b = 0.0
                    for j in range(offsets[k * count + c], offsets[k * count + c + 1]):
                        one, two, three = _sent(tables, lobe[v], n, view, rays, j)
                        r, g, b = r + one, g + two, b + three
                red, green, blue = red + r, green + g, blue + b
        out[v, 0], out[v, 1], out[v, 2] = red * irradiance[v, 0], green * irradiance[v, 1], blue * irradiance[v, 2]


@kernel
def _view(tables, lobe, n, t, o):
    """Return the numbers of a view: tangent, bitangent, eye, its cosine, alpha, Smith's lambda, mirror share.

    A mirror in a table is shown as a lobe of LEAST_ALPHA. The eye of a table is in the frame of its tangent.
    """
    if lobe[4] >= 0.0:
        alpha, at_eye = max(lobe[4], LEAST_ALPHA), max(dot(o, n), GRAZING)
        return o, o, o, at_eye, alpha, ggx._lambda(alpha, at_eye), 0.0
    # The tangent is that of a face: beside the vertex normal it would shift the lobe, on a ball by a quarter of it.
    across = dot(t, n)
    t = t[0] - across * n[0], t[1] - across * n[1], t[2] - across * n[2]
    size = max(math.sqrt(dot(t, t)), 1e-6)
    t = t[0] / size, t[1] / size, t[2] / size
    s = cross(n, t)
    m = -1 - int(lobe[4])
    ox, oy, oz = dot(o, t), dot(o, s), max(dot(o, n), GRAZING)
    glass = table.mirror_share(tables, m, ox, oy, oz) * table.albedo(tables, m, ox, oy, oz)
    return t, s, (ox, oy, oz), oz, LEAST_ALPHA, ggx._lambda(LEAST_ALPHA, oz), glass


@kernel
def _by_table(tables, m, n, view, w):
    """Return f of table m for the eye and light from w, of any length."""
    t, s, o, at_eye, alpha, far, glass = view
    size = math.sqrt(dot(w, w))
    wx, wy, wz = dot(w, t) / size, dot(w, s) / size, max(dot(w, n) / size, GRAZING)
    red, green, blue = table.value(tables, m, wx, wy, wz, o[0], o[1], o[2])
    if glass > 0.0:
        hx, hy, hz = wx + o[0], wy + o[1], wz + o[2]
        cos_h = hz / max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
        more = 1.0 + far + ggx._lambda(alpha, wz)
        mirror = glass * ggx.distribution(alpha, cos_h) / (4.0 * wz * at_eye * more)
        red, green, blue = red + mirror, green + mirror, blue + mirror
    return red, green, blue


@kernel
def _sent(tables, lobe, n, view, rays, j):
    """Return the radiance towards the eye from row j of `rays` (m, 6), under irradiance 1."""
    r, g, b = rays[j, 0], rays[j, 1], rays[j, 2]
    if r + g + b <= 0.0:
        return 0.0, 0.0, 0.0
    _, _, o, at_eye, alpha, far, _ = view
    x, y, z = rays[j, 3], rays[j, 4], rays[j, 5]
    length = max(math.sqrt(x * x + y * y + z * z), 1e-6)
    w = x / length, y / length, z / length
    at_light = max(dot(w, n), GRAZING)
    if lobe[4] < 0.0:
        red = green = blue = 0.0
        spread = math.sqrt(2.0 * SPREAD * max(1.0 - length, 0.0))
        points = LOBE_POINTS if 1.0 - length > ONE else 1
        ax, ay, az, bx, by, bz = basis(w[0], w[1], w[2])
        for k in range(points):
            turn = 2.0 * math.pi * (k + 0.25) / LOBE_POINTS
            p, q = (spread * math.cos(turn), spread * math.sin(turn)) if points > 1 else (0.0, 0.0)
            v = w[0] + p * ax + q * bx, w[1] + p * ay + q * by, w[2] + p * az + q * bz
            one, two, three = _by_table(tables, -1 - int(lobe[4]), n, view, v)
            red, green, blue = red + one, green + two, blue + three
        return red / points * r, green / points * g, blue / points * b
    hx, hy, hz = w[0] + o[0], w[1] + o[1], w[2] + o[2]
    size = max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
    cos_h = (hx * n[0] + hy * n[1] + hz * n[2]) / size
    cos_d = (w[0] * hx + w[1] * hy + w[2] * hz) / size
    wide = math.sqrt(alpha * alpha + SPREAD * max(1.0 - length, 0.0))
    f = ggx.distribution(wide, cos_h) / (4.0 * at_light * at_eye * (1.0 + far + ggx._lambda(alpha, at_light)))
    f90 = max(0.0, 1.0 - cos_d) ** 5
    red = f * r * (lobe[0] + (lobe[3] - lobe[0]) * f90)
    green = f * g * (lobe[1] + (lobe[3] - lobe[1]) * f90)
    return red, green, f * b * (lobe[2] + (lobe[3] - lobe[2]) * f90)


def room_for(vertices: int) -> np.ndarray:
    """Return an array (vertices, 3) float32 for gloss_radiance()."""
    return np.empty((vertices, 3), np.float32)
