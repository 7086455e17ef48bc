"""Tracing photons: the background through the static scene (report fig. 2.1), and any path onwards.

`advance` is one bounce for many photons at once: two-level nearest hit, scatter.
The background calls it without mobiles, branches with them; nothing else bends a photon.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core import sampling
from gi_core.accelerator import Accelerator, Transforms, line, point_on_line
from gi_core.bsdf import lambertian
from gi_core.emission import Emitters, emit
from gi_core.fixed_point import MAX_SEGMENTS, attenuate
from gi_core.jit import kernel
from gi_core.paths import NONE, PathVertices
from gi_core.two_level import World, nearest_mobile, nearest_static

GATHER = 256  # photons whose faces are looked up at a time


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
    left: np.ndarray  # (n, 3) int32, flux that goes on from there, 0 where the path ends
    rays: Rays  # those that go on, in order


@kernel
def _gather(first, last, end_side, cut_side, normals, reflectance, two_sided, rotation, face_object, faces):
    """Write what the faces are that photons first .. last - 1 end on: side, normal in the world, colour, and whether
    that side absorbs all. A loop of its own: it does not wait, so its accesses to memory overlap.
    """
    ends, normal, rho, black = faces
    for k in range(first, last):
        j = k - first
        side = cut_side[k] if cut_side[k] != NONE else end_side[k]
        ends[j] = side
        if side >= 0:
            f = side >> 1
            o = face_object[f]
            s = 1.0 if side & 1 == 0 else -1.0
            x, y, z = normals[f, 0], normals[f, 1], normals[f, 2]
            for c in range(3):
                normal[j, c] = s * (rotation[o, c, 0] * x + rotation[o, c, 1] * y + rotation[o, c, 2] * z)
                rho[j, c] = reflectance[f, c]
            black[j] = side & 1 == 1 and not two_sided[f]


@kernel
def _scatter_all(
    seed, photon, bounce, origin, end, end_side, cut, cut_side, flux, normals, reflectance, two_sided, rotation,
    face_object, hit, left, on_photon, on_bounce, on_origin, on_direction, on_side, on_flux, fates,
):  # fmt: skip
    """Scatter photons and write those that go on behind one another; returns how many.

    Survival probability is the largest channel of rho, so no channel grows.
    """
    n = 0
    ends, black = np.empty(GATHER, np.int32), np.empty(GATHER, np.bool_)
    normal, rho = np.empty((GATHER, 3)), np.empty((GATHER, 3))
    for k in range(len(photon)):
        j = k % GATHER
        if j == 0:
            last, faces = min(k + GATHER, len(photon)), (ends, normal, rho, black)
            _gather(k, last, end_side, cut_side, normals, reflectance, two_sided, rotation, face_object, faces)
        side, vertex = ends[j], bounce[k] + 1
        x, y, z = end[k, 0], end[k, 1], end[k, 2]
        if cut_side[k] != NONE:
            ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
            dx, dy, dz, _ = line(ox, oy, oz, x, y, z)
            x, y, z = point_on_line(ox, oy, oz, dx, dy, dz, cut[k])
        hit[k, 0], hit[k, 1], hit[k, 2] = x, y, z
        left[k, 0], left[k, 1], left[k, 2] = 0, 0, 0
        if side < 0 or vertex >= MAX_SEGMENTS:
            fate = 1 if side < 0 else 2
            for c in range(3):
                fates[fate, c] += flux[k, c]
            continue
        survival = max(rho[j, 0], max(rho[j, 1], rho[j, 2]))
        # The back of a one-sided face absorbs. The comparison is strict: rho = 0 never survives.
        if black[j] or not (sampling.uniform(seed, photon[k], vertex, sampling.SURVIVAL) < survival):
            for c in range(3):
                fates[0, c] += flux[k, c]
            continue
        for c in range(3):
            q = attenuate(flux[k, c], rho[j, c], survival)
            fates[0, c] += flux[k, c] - q
            left[k, c] = on_flux[n, c] = q
        u = sampling.uniform(seed, photon[k], vertex, sampling.SCATTER_U)
        v = sampling.uniform(seed, photon[k], vertex, sampling.SCATTER_V)
        dx, dy, dz = sampling.from_frame(*lambertian.sample(u, v), normal[j, 0], normal[j, 1], normal[j, 2])
        on_direction[n, 0], on_direction[n, 1], on_direction[n, 2] = dx, dy, dz
        on_origin[n, 0], on_origin[n, 1], on_origin[n, 2] = x, y, z
        on_photon[n], on_bounce[n], on_side[n] = photon[k], vertex, side
        n += 1
    return n


def scatter_all(world: World, at: Transforms, seed: int, segments, cut: np.ndarray, fates: Fates):
    """Scatter photons at the ends of their segments.

    `segments` needs photon, bounce, origin, end, end_side, cut_side, flux. Returns hit (n, 3) float32,
    the flux left (n, 3) int32 (0 where the path ends) and the Rays that go on, in order; adds to `fates`.
    """
    n = len(segments.photon)
    hit, left = np.empty((n, 3), np.float32), np.empty((n, 3), np.int32)
    on = _room_for_rays(n)
    sums = np.zeros((3, 3), np.int64)
    count = _scatter_all(
        seed, segments.photon, segments.bounce, segments.origin, segments.end, segments.end_side, cut,
        segments.cut_side, segments.flux, world.normals, world.reflectance, world.two_sided, at.rotation,
        world.face_object, hit, left, on.photon, on.bounce, on.origin, on.direction, on.side, on.flux, sums,
    )  # fmt: skip
    for total, part in zip((fates.absorbed, fates.escaped, fates.truncated), sums, strict=True):
        total += part
    return hit, left, Rays(*(a[:count] for a in on))


def _room_for_rays(n: int) -> Rays:
    return Rays(
        np.empty(n, np.int64),
        np.empty(n, np.int32),
        np.empty((n, 3), np.float32),
        np.empty((n, 3), np.float32),
        np.empty(n, np.int32),
        np.empty((n, 3), np.int32),
    )


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
    end, end_side = nearest_static(accelerator, world, at, rays.origin, rays.direction, rays.side)
    cut, cut_side = nearest_mobile(accelerator, world, at, rays.origin, end, rays.side)
    ended = _Ended(rays.photon, rays.bounce, rays.origin, end, end_side, cut_side, rays.flux)
    hit, left, onwards = scatter_all(world, at, seed, ended, cut, fates)
    return Step(end, end_side, cut, cut_side, hit, left, onwards)


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
    parts = [(rays.photon, rays.bounce, rays.origin, rays.side, rays.flux)]
    while len(rays.photon):
        step = advance(accelerator, world, static, seed, rays, fates)
        parts.append((rays.photon, rays.bounce + np.int32(1), step.end, step.end_side, step.left))
        rays = step.rays
    return _photon_major(parts, first, count), fates


def _photon_major(parts, first: int, count: int) -> PathVertices:
    """Order path vertices by photon; `parts`: one bounce each of photon, bounce, position, side, flux."""
    offsets = np.zeros(count + 1, np.int64)
    for photon, *_ in parts:
        _count(photon, first, offsets)
    np.cumsum(offsets, out=offsets)
    n = int(offsets[-1])
    out = PathVertices(offsets, np.empty((n, 3), np.float32), np.empty(n, np.int32), np.empty((n, 3), np.int32))
    for part in parts:
        _place(*part, first, *out)
    return out


@kernel
def _count(photon, first, offsets):
    for k in range(len(photon)):
        offsets[photon[k] - first + 1] += 1


@kernel
def _place(photon, bounce, position, side, flux, first, offsets, position_out, side_out, flux_out):
    for k in range(len(photon)):
        row = offsets[photon[k] - first] + bounce[k]
        side_out[row] = side[k]
        for c in range(3):
            position_out[row, c] = position[k, c]
            flux_out[row, c] = flux[k, c]
