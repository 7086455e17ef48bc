"""Tracing photons: the background through the static scene (report fig. 2.1), and any path onwards.

`advance` is one bounce for many photons at once: nearest static hit, nearest mobile along the line,
scatter. The background calls it without mobiles, branches with them; nothing else bends a photon.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core import sampling
from gi_core.accelerator import FAR, ORIGIN_LIFT, Accelerator, Transforms, line, point_on_line, to_local
from gi_core.bsdf import lambertian
from gi_core.emission import Emitters, emit
from gi_core.fixed_point import MAX_SEGMENTS, attenuate
from gi_core.jit import kernel
from gi_core.paths import NONE, PathVertices
from gi_core.surfaces import Surfaces

CUT_PAD = 1e-5  # of the world's size: bounding spheres grow by it, so that culling never loses a hit


class World(NamedTuple):
    """What every kernel needs to know of the scene, in arrays."""

    normals: np.ndarray  # (F, 3) float64, object space
    reflectance: np.ndarray  # (F, 3) float64
    two_sided: np.ndarray  # (F,) bool
    face_object: np.ndarray  # (F,) int16
    centre: np.ndarray  # (3,) float64, of a sphere round everything [m]
    size: float  # its diameter [m]: what epsilons are scaled by
    sphere_centre: np.ndarray  # (objects, 3) float64, bounding spheres in object space
    sphere_radius: np.ndarray  # (objects,) float64


class Fates(NamedTuple):
    """Where flux went, (3,) int64 fixed-point units; emitted = absorbed + escaped + truncated, exactly."""

    emitted: np.ndarray
    absorbed: np.ndarray
    escaped: np.ndarray
    truncated: np.ndarray


def no_flux() -> Fates:
    return Fates(*(np.zeros(3, np.int64) for _ in range(4)))


class Rays(NamedTuple):
    """Photons on their way: where each leaves from, and what it carries."""

    photon: np.ndarray  # (n,) int64
    bounce: np.ndarray  # (n,) int32, of the segment about to be made
    origin: np.ndarray  # (n, 3) float32
    direction: np.ndarray  # (n, 3) float32
    side: np.ndarray  # (n,) int32, side that it leaves, NONE in free space
    flux: np.ndarray  # (n, 3) int32


class Step(NamedTuple):
    """One segment of each ray, and what became of it."""

    end: np.ndarray  # (n, 3) float32, static end of the line
    end_side: np.ndarray  # (n,) int32
    cut: np.ndarray  # (n,) float32, distance at which a mobile cuts the line, inf for none
    cut_side: np.ndarray  # (n,) int32
    hit: np.ndarray  # (n, 3) float32, where the photon really is now
    rays: Rays  # those that go on, in order
    alive: np.ndarray  # (n,) bool, which ones


@kernel
def _lift(origin, side, normals, rotation, face_object, lift, out):
    """Lift ray origins off the face they leave."""
    for k in range(len(origin)):
        for c in range(3):
            out[k, c] = origin[k, c]
        if side[k] >= 0:
            f = side[k] >> 1
            s = lift if side[k] & 1 == 0 else -lift
            n = normals[f]
            R = rotation[face_object[f]]
            for c in range(3):
                out[k, c] = origin[k, c] + s * (R[c, 0] * n[0] + R[c, 1] * n[1] + R[c, 2] * n[2])


@kernel
def _static_ends(lifted, origin, direction, distance, face, normals, far, end, end_side):
    """Turn static hits into ends of lines; a miss ends far away in free space."""
    for k in range(len(face)):
        o = lifted if face[k] >= 0 else origin
        t = distance[k] if face[k] >= 0 else far
        d = direction[k]
        end[k, 0], end[k, 1], end[k, 2] = point_on_line(o[k, 0], o[k, 1], o[k, 2], d[0], d[1], d[2], t)
        end_side[k] = NONE
        if face[k] >= 0:
            n = normals[face[k]]
            behind = d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0
            end_side[k] = 2 * face[k] + (1 if behind else 0)


@kernel
def _lines_near(origin, end, side, face_object, o, R, p, centre, radius, lift, normals, rows, local_o, local_d, limit):
    """Collect the lines that pass object o's bounding sphere, carried to its space; return how many.

    A line that starts on o itself is lifted off its face.
    """
    n = 0
    for k in range(len(origin)):
        x, y, z = origin[k, 0] - p[0], origin[k, 1] - p[1], origin[k, 2] - p[2]
        ox, oy, oz = to_local(R, x, y, z)
        x, y, z = end[k, 0] - p[0], end[k, 1] - p[1], end[k, 2] - p[2]
        ex, ey, ez = to_local(R, x, y, z)
        if not _passes(ox, oy, oz, ex, ey, ez, centre, radius):
            continue
        fox, foy, foz = np.float32(ox), np.float32(oy), np.float32(oz)
        dx, dy, dz, length = line(fox, foy, foz, np.float32(ex), np.float32(ey), np.float32(ez))
        if side[k] >= 0 and face_object[side[k] >> 1] == o:
            s = lift if side[k] & 1 == 0 else -lift
            m = normals[side[k] >> 1]
            fox, foy, foz = np.float32(ox + s * m[0]), np.float32(oy + s * m[1]), np.float32(oz + s * m[2])
        rows[n] = k
        local_o[n, 0], local_o[n, 1], local_o[n, 2] = fox, foy, foz
        local_d[n, 0], local_d[n, 1], local_d[n, 2] = dx, dy, dz
        limit[n] = length
        n += 1
    return n


@kernel
def _passes(ox, oy, oz, ex, ey, ez, centre, radius):
    """Tell whether the segment o-e comes within radius of a point."""
    dx, dy, dz = ex - ox, ey - oy, ez - oz
    cx, cy, cz = centre[0] - ox, centre[1] - oy, centre[2] - oz
    length2 = dx * dx + dy * dy + dz * dz
    t = (cx * dx + cy * dy + cz * dz) / length2 if length2 > 0.0 else 0.0
    t = min(1.0, max(0.0, t))
    x, y, z = cx - t * dx, cy - t * dy, cz - t * dz
    return x * x + y * y + z * z <= radius * radius


def nearest_mobile(accelerator: Accelerator, world: World, at: Transforms, origin, end, side):
    """Return where mobiles first cut lines: distance (n,) float32 (inf: nowhere) and side (n,) int32.

    Ties go to the static end, then to the mobile that comes first in the scene.
    """
    n = len(origin)
    cut = np.full(n, np.inf, np.float32)
    cut_side = np.full(n, NONE, np.int32)
    if len(at.position) == 1 or n == 0:
        return cut, cut_side
    rows = np.empty(n, np.int64)
    local_o, local_d = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32)
    limit = np.empty(n, np.float32)
    for o in range(1, len(at.position)):
        R, p = at.rotation[o], at.position[o]
        radius = world.sphere_radius[o] + CUT_PAD * world.size
        m = _lines_near(
            origin, end, side, world.face_object, o, R, p, world.sphere_centre[o], radius,
            ORIGIN_LIFT * world.size, world.normals, rows, local_o, local_d, limit,
        )  # fmt: skip
        if m:
            distance, face = accelerator.nearest(o, local_o[:m], local_d[:m], limit[:m])
            _keep_nearer(rows[:m], distance, face, limit, local_d, world.normals, cut, cut_side)
    return cut, cut_side


@kernel
def _keep_nearer(rows, distance, face, limit, local_d, normals, cut, cut_side):
    for j in range(len(rows)):
        k = rows[j]
        if face[j] >= 0 and distance[j] < limit[j] and distance[j] < cut[k]:
            n, d = normals[face[j]], local_d[j]
            cut[k] = distance[j]
            cut_side[k] = 2 * face[j] + (1 if d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0 else 0)


@kernel
def scatter(seed, photon, bounce, side, q, normals, reflectance, two_sided, rotation, face_object, direction, fates):
    """Scatter one photon at the hit that ends segment `bounce`.

    `q` (3,) int32 is attenuated in place, `direction` (3,) float32 written; returns whether the
    photon goes on. Survival probability is the largest channel of rho, so no channel grows.
    """
    if side < 0:
        for c in range(3):
            fates[1, c] += q[c]
        return False
    vertex = bounce + 1
    if vertex >= MAX_SEGMENTS:
        for c in range(3):
            fates[2, c] += q[c]
        return False
    f = side >> 1
    back = side & 1 == 1
    rho = reflectance[f]
    survival = max(rho[0], max(rho[1], rho[2]))
    # The back of a one-sided face absorbs. The comparison is strict: rho = 0 never survives.
    if (back and not two_sided[f]) or not (sampling.uniform(seed, photon, vertex, sampling.SURVIVAL) < survival):
        for c in range(3):
            fates[0, c] += q[c]
        return False
    for c in range(3):
        left = attenuate(q[c], rho[c], survival)
        fates[0, c] += q[c] - left
        q[c] = left
    u = sampling.uniform(seed, photon, vertex, sampling.SCATTER_U)
    v = sampling.uniform(seed, photon, vertex, sampling.SCATTER_V)
    x, y, z = lambertian.sample(u, v)
    n = normals[f]
    R = rotation[face_object[f]]
    s = -1.0 if back else 1.0
    nx = s * (R[0, 0] * n[0] + R[0, 1] * n[1] + R[0, 2] * n[2])
    ny = s * (R[1, 0] * n[0] + R[1, 1] * n[1] + R[1, 2] * n[2])
    nz = s * (R[2, 0] * n[0] + R[2, 1] * n[1] + R[2, 2] * n[2])
    dx, dy, dz = sampling.from_frame(x, y, z, nx, ny, nz)
    direction[0], direction[1], direction[2] = dx, dy, dz
    return True


@kernel
def _scatter_all(
    seed, photon, bounce, origin, end, end_side, cut, cut_side, flux,
    normals, reflectance, two_sided, rotation, face_object, hit, alive, direction, fates,
):  # fmt: skip
    for k in range(len(photon)):
        side = end_side[k]
        if cut_side[k] != NONE:
            side = cut_side[k]
            o, e = origin[k], end[k]
            dx, dy, dz, _ = line(o[0], o[1], o[2], e[0], e[1], e[2])
            hit[k, 0], hit[k, 1], hit[k, 2] = point_on_line(o[0], o[1], o[2], dx, dy, dz, cut[k])
        else:
            for c in range(3):
                hit[k, c] = end[k, c]
        alive[k] = scatter(
            seed, photon[k], bounce[k], side, flux[k], normals, reflectance, two_sided, rotation, face_object,
            direction[k], fates,
        )  # fmt: skip


def scatter_all(world: World, at: Transforms, seed: int, segments, cut: np.ndarray, fates: Fates):
    """Scatter photons at the ends of their segments.

    `segments` needs photon, bounce, origin, end, end_side, cut_side, flux. Returns hit (n, 3)
    float32, alive (n,) bool and the Rays that go on; adds to `fates`.
    """
    n = len(segments.photon)
    hit = np.empty((n, 3), np.float32)
    alive = np.empty(n, bool)
    direction = np.empty((n, 3), np.float32)
    flux = np.array(segments.flux, np.int32)
    sums = np.zeros((3, 3), np.int64)
    _scatter_all(
        seed, segments.photon, segments.bounce, segments.origin, segments.end, segments.end_side, cut,
        segments.cut_side, flux, world.normals, world.reflectance, world.two_sided, at.rotation, world.face_object,
        hit, alive, direction, sums,
    )  # fmt: skip
    for total, part in zip((fates.absorbed, fates.escaped, fates.truncated), sums, strict=True):
        total += part
    side = np.where(segments.cut_side != NONE, segments.cut_side, segments.end_side)
    rays = Rays(
        segments.photon[alive],
        segments.bounce[alive] + np.int32(1),
        hit[alive],
        direction[alive],
        side[alive],
        flux[alive],
    )
    return hit, alive, rays


class _Ended(NamedTuple):
    photon: np.ndarray
    bounce: np.ndarray
    origin: np.ndarray
    end: np.ndarray
    end_side: np.ndarray
    cut_side: np.ndarray
    flux: np.ndarray


def advance(accelerator: Accelerator, world: World, at: Transforms, seed: int, rays: Rays, fates: Fates) -> Step:
    """Trace one segment of each ray against the static part and the mobiles in `at`, and scatter."""
    n = len(rays.photon)
    lifted = np.empty((n, 3), np.float32)
    _lift(rays.origin, rays.side, world.normals, at.rotation, world.face_object, ORIGIN_LIFT * world.size, lifted)
    far = np.float32(FAR * world.size)
    distance, face = accelerator.nearest(0, lifted, rays.direction, np.full(n, far, np.float32))
    end, end_side = np.empty((n, 3), np.float32), np.empty(n, np.int32)
    _static_ends(lifted, rays.origin, rays.direction, distance, face, world.normals, far, end, end_side)
    cut, cut_side = nearest_mobile(accelerator, world, at, rays.origin, end, rays.side)
    ended = _Ended(rays.photon, rays.bounce, rays.origin, end, end_side, cut_side, rays.flux)
    hit, alive, onwards = scatter_all(world, at, seed, ended, cut, fates)
    return Step(end, end_side, cut, cut_side, hit, onwards, alive)


def emitted_rays(emitters: Emitters, seed: int, first: int, count: int, fates: Fates) -> Rays:
    """Return photons first .. first + count - 1 as they leave their lights."""
    origin, direction, flux, side = emit(emitters, seed, first, count)
    for c in range(3):
        fates.emitted[c] += int(flux[:, c].astype(np.int64).sum())
    photon = np.arange(first, first + count, dtype=np.int64)
    return Rays(photon, np.zeros(count, np.int32), origin, direction, side, flux)


def trace_background(
    accelerator: Accelerator, world: World, static: Transforms, emitters: Emitters, seed: int, first: int, count: int
) -> tuple[PathVertices, Fates]:
    """Trace photons first .. first + count - 1 through the static scene alone."""
    fates = no_flux()
    if not len(emitters.kind):
        return PathVertices(
            np.zeros(count + 1, np.int64),
            np.empty((0, 3), np.float32),
            np.empty(0, np.int32),
            np.empty((0, 3), np.int32),
        ), fates
    rays = emitted_rays(emitters, seed, first, count, fates)
    vertices = [(rays.photon, rays.bounce, rays.origin, rays.side, rays.flux)]
    while len(rays.photon):
        step = advance(accelerator, world, static, seed, rays, fates)
        flux = np.zeros((len(rays.photon), 3), np.int32)
        flux[step.alive] = step.rays.flux
        vertices.append((rays.photon, rays.bounce + np.int32(1), step.end, step.end_side, flux))
        rays = step.rays
    return _photon_major(vertices, first, count), fates


def _photon_major(vertices, first: int, count: int) -> PathVertices:
    photon, bounce, position, side, flux = (np.concatenate(a) for a in zip(*vertices, strict=True))
    offsets = np.concatenate([[0], np.cumsum(np.bincount(photon - first, minlength=count))]).astype(np.int64)
    place = offsets[photon - first] + bounce
    out = PathVertices(offsets, np.empty_like(position), np.empty_like(side), np.empty_like(flux))
    out.position[place], out.side[place], out.flux[place] = position, side, flux
    return out


def build_world(surfaces: Surfaces, accelerator: Accelerator, centres, radii, extra_points: np.ndarray) -> World:
    """Flatten what the kernels need; `extra_points` (n, 3) widen the world beyond the static part."""
    points = np.concatenate([surfaces.vertices[0].reshape(-1, 3), extra_points.reshape(-1, 3)])
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3), np.zeros(3))
    diagonal = high - low
    return World(
        surfaces.normals,
        surfaces.reflectance,
        surfaces.two_sided,
        accelerator.face_object,
        (low + high) / 2,
        max(math.sqrt(float((diagonal * diagonal).sum())), 1e-9),
        centres,
        radii,
    )
