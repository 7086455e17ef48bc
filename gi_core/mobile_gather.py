"""Light on mobiles without photons: gathered from each of their receivers along paths of a single bounce.

Photons reach a small mobile rarely, so that its light is the noisiest of a frame. But what it sees is known: lamps,
which are joined to each receiver by shadow rays, and the static part, whose irradiance the frame has just found. A
path therefore ends where its first ray does, with rho E of that place (final gathering, Reichert 1992; Jensen 2001).
Where that is a mobile again, E is itself unknown: those few places make a linear system, solved by Jacobi's
method.

All receivers use the same random numbers, so that neighbours are off alike: of the same error, a smooth surface shows
nothing where it would show blotches from vertex to vertex. A function of poses and of the static light alone, to the
last bit: nothing of earlier frames is used.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.accelerator import FAR, ORIGIN_LIFT, Transforms, nearest_in_world
from gi_core.evaluation_points import evaluation_points
from gi_core.jit import kernel
from gi_core.light_sampling import area_lights, room_for_shadows, sky_of, small_lights
from gi_core.model import Model
from gi_core.path_gather import BLOCK, Lights, PathEnds, join_lights, scatter, share_of_bounce, turned
from gi_core.pose import to_world_at
from gi_core.threads import run_ranges

STREAM = 0x3B11  # keeps these random numbers apart from those of photons and reference with the same seed
GRAIN = 1 << 11  # paths a thread
SWEEPS = 32  # of Jacobi's method at most ...
SETTLED = 1e-3  # ... or until a sweep changes the sum of all by less than this share


class Exchange(NamedTuple):
    """Paths from mobiles that end on mobiles. Receivers are numbered among those of mobiles."""

    row: np.ndarray  # (n,) int64, receiver that the path starts from
    corners: np.ndarray  # (n, 3) int64, receivers round its end
    share: np.ndarray  # (n, 3) float64, of each of them in the irradiance there
    reflectance: np.ndarray  # (n, 3) float64


class MobileGather:
    """Irradiance of the receivers of a model's mobiles."""

    def __init__(self, model: Model, seed: int):
        self._model, self._seed = model, (int(seed) ^ (STREAM << 40)) & (2**63 - 1)
        self.first = model.surfaces.receiver_range(0).stop  # the first receiver on a mobile
        self._positions, self._normals = (
            a[self.first :] for a in evaluation_points(model.surfaces, model.object_receivers)
        )
        counts = np.diff(model.surfaces.first_receiver)[1:]
        self._object = np.repeat(np.arange(1, len(counts) + 1), counts)
        self._lights = Lights(area_lights(model.surfaces), small_lights(model.scene), sky_of(model.scene))

    def irradiance(self, at: Transforms, static: np.ndarray, log2_paths: int) -> np.ndarray:
        """Return irradiance (m, 3) float64 [W/m2] of the receivers on mobiles, from `first` on.

        static (>= first, 3) float64: irradiance of the static part's receivers at these poses; 2^log2_paths paths
        a receiver, 0 <= log2_paths <= strata.LARGEST.
        """
        n, m = len(self._positions), log2_paths
        o = self._object
        normals = to_world_at(at.rotation[o], np.zeros((n, 3)), self._normals)
        positions = to_world_at(at.rotation[o], at.position[o], self._positions)
        positions += ORIGIN_LIFT * self._model.world.size * normals
        total, at_once = np.zeros((n, 3)), max(1, BLOCK >> m)

        def work(_, first, last):
            blocks = [slice(a, min(a + at_once, last)) for a in range(first, last, at_once)]
            return [self._block(at, static, m, s, positions[s], normals[s], total[s]) for s in blocks]

        parts = run_ranges(work, n, self._model.threads, max(1, GRAIN >> m))
        exchanges = Exchange(*(np.concatenate(a) for a in zip(*(e for p in parts for e in p), strict=True)))
        return _exchanged(total / (1 << m), exchanges, 1 << m)

    def _block(self, at: Transforms, static, m: int, rows: slice, positions, normals, total) -> Exchange:
        """Gather at a run of receivers: add to `total` what is known, return what depends on mobiles."""
        world, s, lights = self._model.world, self._model.surfaces, self._lights
        n, paths = len(positions), 1 << m
        count = n * paths
        start = np.repeat(positions, paths, axis=0), np.repeat(normals, paths, axis=0)
        number = np.tile(np.arange(paths), n)  # see the module: those of all receivers are the same
        ends = PathEnds(number, np.repeat(np.arange(n), paths), *start, np.ones((count, 3)))
        rays = room_for_shadows(count)
        join_lights(self._model, at, lights, self._seed, m, 0, ends, rays, total)
        scatter(self._seed, m, 0, ends, rays.origin, rays.direction)
        far = np.full(count, FAR * world.size, np.float32)
        distance, face = nearest_in_world(self._model.accelerator, at, rays.origin, rays.direction, far)
        out = Exchange(np.empty(count, np.int64), np.empty((count, 3), np.int64), *np.empty((2, count, 3)))
        met = _meet(
            ends, rays.direction, distance, face, world.normals, world.reflectance, world.two_sided, at.rotation,
            at.position, world.face_object, lights.area.emitted, lights.area.density, lights.sky,
            self._model.object_receivers.positions, s.corner_front, s.corner_back, static, self.first, rows.start,
            total, out,
        )  # fmt: skip
        return Exchange(*(a[:met] for a in out))


def _exchanged(direct: np.ndarray, exchange: Exchange, paths: int) -> np.ndarray:
    """Solve E = direct + (what paths bring from mobiles) for E (n, 3)."""
    E = direct
    for _ in range(SWEEPS):
        before, E = E, direct.copy()
        _sweep(exchange, 1.0 / paths, before, E)
        if np.abs(E - before).sum() <= SETTLED * E.sum():
            break
    return E


@kernel
def _sweep(exchange, share, before, E):
    row, corners, shares, rho = exchange
    for k in range(len(row)):
        for c in range(3):
            there = 0.0
            for v in range(3):
                there += shares[k, v] * before[corners[k, v], c]
            E[row[k], c] += share * rho[k, c] * there


@kernel
def _meet(
    ends, direction, distance, face, normals, reflectance, two_sided, rotation, position, face_object, emitted, density,
    sky, points, corner_front, corner_back, static, first, base, total, out,
):  # fmt: skip
    """Add what rays meet on lamps, in the sky and on the static part; write down those that meet mobiles, return how
    many. With pdf cos / pi the mean of pi L is the irradiance, and pi L off a diffuse surface is rho E.
    """
    n = 0
    for k in range(len(face)):
        row, d, f = ends.row[k], direction[k], face[k]
        if f < 0:
            if d[0] * sky.up[0] + d[1] * sky.up[1] + d[2] * sky.up[2] > 0.0:
                for c in range(3):
                    total[row, c] += math.pi * sky.radiance[c]
            continue
        o = face_object[f]
        R, t = rotation[o], distance[k]
        nx, ny, nz = turned(R, normals[f])
        facing = -(d[0] * nx + d[1] * ny + d[2] * nz)
        if facing > 0.0:
            share = share_of_bounce(d, ends.normal[k], facing, t, density[f])
            for c in range(3):
                total[row, c] += math.pi * emitted[f, c] * share
        elif not two_sided[f]:
            continue  # the back of a one-sided face is black
        corners = corner_front[f] if facing > 0.0 else corner_back[f]
        x = ends.position[k, 0] + t * d[0] - position[o, 0]
        y = ends.position[k, 1] + t * d[1] - position[o, 1]
        z = ends.position[k, 2] + t * d[2] - position[o, 2]
        u, v, w = _shares(
            points[corners[0]], points[corners[1]], points[corners[2]],
            R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
            R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
            R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
        )  # fmt: skip
        if o == 0:
            for c in range(3):
                E = u * static[corners[0], c] + v * static[corners[1], c] + w * static[corners[2], c]
                total[row, c] += reflectance[f, c] * E
            continue
        out.row[n] = base + row
        out.share[n, 0], out.share[n, 1], out.share[n, 2] = u, v, w
        for c in range(3):
            out.corners[n, c] = corners[c] - first
            out.reflectance[n, c] = reflectance[f, c]
        n += 1
    return n


@kernel
def _shares(a, b, c, x, y, z):
    """Return the barycentric coordinates of a point in a triangle's plane; rounding may not leave the triangle."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = x - a[0], y - a[1], z - a[2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    area2 = uu * vv - uv * uv
    if area2 <= 0.0:
        return 1.0, 0.0, 0.0
    s = min(max((vv * wu - uv * wv) / area2, 0.0), 1.0)
    t = min(max((uu * wv - uv * wu) / area2, 0.0), 1.0 - s)
    return 1.0 - s - t, s, t
