"""Photon tracing: background paths through the static part (report fig. 2.1), and new suffixes among mobiles.

Each photon is traced to its end before the next one starts, so its state stays in registers and a bounce costs no
Python. Background paths ignore mobiles; new suffixes hit them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.fixed_point import MAX_PATH, attenuate
from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import row as row_of
from gi_core.bsdf import lambertian, surface
from gi_core.geometry.receivers import NONE
from gi_core.lights.emission import Emitters, emit
from gi_core.photons.paths import PathVertices, Segments, empty_segments, grown
from gi_core.rays.accelerator import Accelerator, Transforms, line
from gi_core.rays.all_objects import World, landing, mobile_cut, static_end, turned_normal
from gi_core.rays.panes import chosen, pane_at
from gi_core.rays.structures import new_ray

USUAL = 4  # segments per path in the first allocation


class Fates(NamedTuple):
    """Flux by fate, each (3 G,) int64 in fixed-point units, red, green and blue of each of G lamps.

    emitted = absorbed + escaped + truncated, exactly.
    """

    emitted: np.ndarray
    absorbed: np.ndarray
    escaped: np.ndarray
    truncated: np.ndarray


_ABSORBED, _ESCAPED, _TRUNCATED = range(3)  # rows of the kernels' sums


def add_fates(a: Fates, b: Fates) -> Fates:
    return Fates(*(x + y for x, y in zip(a, b, strict=True)))


def no_flux(lamps: int) -> Fates:
    return Fates(*(np.zeros(3 * lamps, np.int64) for _ in range(4)))


def add_to(fates: Fates, sums: np.ndarray, sign: int = 1) -> None:
    """Add `sign` times a kernel's sums (3, 3 G) int64 of flux absorbed, escaped and truncated to `fates`."""
    for total, part in zip((fates.absorbed, fates.escaped, fates.truncated), sums, strict=True):
        total += sign * part


@inlined
def _fate(side, segments):
    """Return the fate of a photon at the end of its segments, at a side; _ABSORBED: it may also be reflected there."""
    return _ESCAPED if side < 0 else (_TRUNCATED if segments >= MAX_PATH else _ABSORBED)


@kernel
def add_fates_behind(offsets, side, flux, lamp, photons, vertices, fates):
    """Add the fates of flux of paths behind the given vertices (n,) of photons (n,): lost per bounce, and at the end.

    offsets .. lamp: of PathVertices; fates (3, 3 G) int64.
    """
    for j in range(len(photons)):
        end = offsets[photons[j] + 1] - 1
        fate = _fate(side[end], end - offsets[photons[j]])
        for c in range(3):
            fates[_ABSORBED, 3 * lamp[photons[j]] + c] += flux[vertices[j], c] - flux[end - 1, c]
            fates[fate, 3 * lamp[photons[j]] + c] += flux[end - 1, c]


class PhotonRays(NamedTuple):
    """Photons in flight: origin, direction and flux. A path that outgrows its memory waits here for more."""

    photon: np.ndarray  # (n,) int64
    bounce: np.ndarray  # (n,) int32, of the next segment
    origin: np.ndarray  # (n, 3) float32
    direction: np.ndarray  # (n, 3) float32
    side: np.ndarray  # (n,) int32, side that the ray leaves, NONE in free space
    flux: np.ndarray  # (n, 3) int32
    lamp: np.ndarray  # (n,) uint8
    direct: np.ndarray  # (n,) bool, no surface has reflected it


@inlined
def _scatter(seed, world, at, photon, vertex, start, end, side, flux, lamp, fates):
    """Scatter a photon at a side: return whether it survives, its direction, flux (three int32), whether it went on.

    A photon goes straight on through a pane. It arrives along the line from `start` to its static end `end`. `fates`
    (3, 3 G) gets the absorbed rest. The survival probability at a diffuse face is the largest channel of rho, so no
    channel grows.
    """
    goes_on, dx, dy, dz, passes = False, np.float32(0.0), np.float32(0.0), np.float32(0.0), False
    fate, a, b, c = _fate(side, vertex), np.int32(0), np.int32(0), np.int32(0)
    if fate == _ABSORBED and pane_at(world.panes, side >> 1) >= 0:
        goes_on, dx, dy, dz, a, b, c, passes = _meet_pane(seed, world, at, photon, vertex, start, end, side, flux)
    elif fate == _ABSORBED and surface.is_glossy(world.bsdfs, side >> 1):
        goes_on, dx, dy, dz, a, b, c = _scatter_glossy(seed, world, at, photon, vertex, start, end, side, flux)
    elif fate == _ABSORBED:
        f, rho = side >> 1, world.bsdfs.reflectance
        survival = max(rho[f, 0], max(rho[f, 1], rho[f, 2]))
        u, v = random_numbers.bounce_numbers(seed, photon, vertex)
        # The back of a one-sided face absorbs. The comparison is strict: rho = 0 never survives.
        goes_on = u < survival and (side & 1 == 0 or world.two_sided[f])
        if goes_on:
            a = np.int32(attenuate(flux[0], lambertian.weight(rho[f, 0]), survival))
            b = np.int32(attenuate(flux[1], lambertian.weight(rho[f, 1]), survival))
            c = np.int32(attenuate(flux[2], lambertian.weight(rho[f, 2]), survival))
            # The rest of the number, scaled to [0, 1), is uniform again.
            x, y, z = lambertian.sample(u / survival, v)
            nx, ny, nz = turned_normal(world, at, f)
            s = 1.0 if side & 1 == 0 else -1.0
            x, y, z = random_numbers.from_frame(x, y, z, s * nx, s * ny, s * nz)
            dx, dy, dz = np.float32(x), np.float32(y), np.float32(z)
    fates[fate, 3 * lamp] += flux[0] - a
    fates[fate, 3 * lamp + 1] += flux[1] - b
    fates[fate, 3 * lamp + 2] += flux[2] - c
    return goes_on, dx, dy, dz, (a, b, c), passes


@inlined
def _meet_pane(seed, world, at, photon, vertex, start, end, side, flux):
    """Let a photon pass a pane or mirror it: results as of _scatter(), in a row."""
    f = side >> 1
    n = turned_normal(world, at, f)
    dx, dy, dz, _ = line(start[0], start[1], start[2], end[0], end[1], end[2])  # as in _scatter_glossy()
    towards, kinds = dx * n[0] + dy * n[1] + dz * n[2], world.panes.kinds
    u = random_numbers.independent(seed, photon, vertex, 0)
    passes, factor = chosen(kinds, pane_at(world.panes, f), min(abs(towards), 1.0), u)
    if not passes:
        turn = 2.0 * towards
        dx, dy, dz = np.float32(dx - turn * n[0]), np.float32(dy - turn * n[1]), np.float32(dz - turn * n[2])
    a, b, c = attenuate(flux[0], factor[0], 1.0), attenuate(flux[1], factor[1], 1.0), attenuate(flux[2], factor[2], 1.0)
    return a + b + c > 0, dx, dy, dz, np.int32(a), np.int32(b), np.int32(c), passes


@inlined
def _scatter_glossy(seed, world, at, photon, vertex, start, end, side, flux):
    """Scatter a photon at a glossy side: return whether it survives, its direction (x, y, z) and flux (three int32)."""
    f = side >> 1
    if side & 1 and not world.two_sided[f]:
        return False, np.float32(0.0), np.float32(0.0), np.float32(0.0), np.int32(0), np.int32(0), np.int32(0)
    # The line, not the sampled ray: a path from scratch and a cut one then scatter alike.
    dx, dy, dz, _ = line(start[0], start[1], start[2], end[0], end[1], end[2])
    nx, ny, nz = turned_normal(world, at, f)
    s = 1.0 if side & 1 == 0 else -1.0
    u, v = random_numbers.bounce_numbers(seed, photon, vertex)
    p, q = random_numbers.independent(seed, photon, vertex, 2), random_numbers.independent(seed, photon, vertex, 3)
    i, n = (-float(dx), -float(dy), -float(dz)), (s * nx, s * ny, s * nz)
    t = surface.tangent_of(world.bsdfs, at.rotation[world.face_object[f]], f)
    o, factor = surface.scattered(world.bsdfs, f, i, n, t, u, v, p, q)
    a, b, c = attenuate(flux[0], factor[0], 1.0), attenuate(flux[1], factor[1], 1.0), attenuate(flux[2], factor[2], 1.0)
    x, y, z = np.float32(o[0]), np.float32(o[1]), np.float32(o[2])
    return a + b + c > 0, x, y, z, np.int32(a), np.int32(b), np.int32(c)


@inlined
def _wait(rays, k, bounce, origin, direction, side, flux):
    """Store ray k in its current state."""
    rays.bounce[k], rays.side[k] = bounce, side
    rays.origin[k, 0], rays.origin[k, 1], rays.origin[k, 2] = origin
    rays.direction[k, 0], rays.direction[k, 1], rays.direction[k, 2] = direction
    rays.flux[k, 0], rays.flux[k, 1], rays.flux[k, 2] = flux


# The background ---------------------------------------------------------------------------------------------


def emitted_rays(
    emitters: Emitters, seed: int, first: int, count: int, fates: Fates, rows: np.ndarray | None = None
) -> PhotonRays:
    """Return the emitted rays of photons first .. first + count - 1, or of some rows of these; adds to `fates`."""
    origin, direction, flux, side, lamp = emitted = emit(emitters, seed, first, count)
    photon = np.arange(first, first + count, dtype=np.int64)
    if rows is not None:
        photon = photon[rows]
        origin, direction, flux, side, lamp = (a[rows] for a in emitted)
    for g in range(emitters.lamps.count):
        fates.emitted[3 * g : 3 * g + 3] += flux[lamp == g].sum(axis=0, dtype=np.int64)
    straight = np.ones(len(photon), bool)
    return PhotonRays(photon, np.zeros(len(photon), np.int32), origin, direction, side, flux, lamp, straight)


def trace_background(
    accelerator: Accelerator, world: World, static: Transforms, emitters: Emitters, seed: int, first: int, count: int,
    rows: np.ndarray | None = None,
) -> tuple[PathVertices, Fates]:  # fmt: skip
    """Trace photons first .. first + count - 1, or some rows of these, through the static part, in this thread."""
    among, count = count, count if rows is None else len(rows)
    fates, offsets = no_flux(emitters.lamps.count), np.zeros(count + 1, np.int64)
    room = USUAL * count
    vertices = np.empty((room, 3), np.float32), np.empty(room, np.int32), np.empty((room, 3), np.int32)
    if not len(emitters.kind):
        return PathVertices(offsets, *(a[:0] for a in vertices), *np.zeros((2, count), np.uint8)), fates
    rays, done, row = emitted_rays(emitters, seed, first, among, fates, rows), 0, 0
    own = rays.lamp, np.ones(count, np.uint8)
    out = PathVertices(offsets, *vertices, *own)
    ray, sums = new_ray(), np.zeros((3, len(fates.emitted)), np.int64)
    while done < count:
        done, row = _trace_paths(accelerator.scenes, ray, world, static, seed, rays, done, out, row, sums)
        if done < count:
            out = PathVertices(offsets, *(grown(a, 2 * len(a)) for a in out[1:4]), *own)
    add_to(fates, sums)
    return PathVertices(offsets, *(a[: offsets[count]] for a in out[1:4]), *own), fates


@kernel
def _trace_paths(scenes, ray, world, at, seed, rays, done, out, row, fates):
    """Trace rays from `done` on through the static part, photon-major, to vertices from `row` on, while they fit.

    Returns the number of rays done, and of rows.
    """
    for k in range(done, len(rays.photon)):
        photon, vertex, own = rays.photon[k], np.int64(rays.bounce[k]), rays.side[k]
        x, y, z = rays.origin[k, 0], rays.origin[k, 1], rays.origin[k, 2]
        dx, dy, dz = rays.direction[k, 0], rays.direction[k, 1], rays.direction[k, 2]
        q = rays.flux[k, 0], rays.flux[k, 1], rays.flux[k, 2]
        goes_on = True
        while True:
            if row + goes_on >= len(out.side):  # the last vertex of a path always fits
                _wait(rays, k, vertex, (x, y, z), (dx, dy, dz), own, q)
                return k, row
            out.position[row, 0], out.position[row, 1], out.position[row, 2] = x, y, z
            out.side[row] = own
            out.flux[row, 0], out.flux[row, 1], out.flux[row, 2] = q[0], q[1], q[2]
            row += 1
            if not goes_on:
                break
            start = x, y, z
            x, y, z, own = static_end(scenes, ray, world, at, x, y, z, dx, dy, dz, own)
            vertex += 1
            goes_on, dx, dy, dz, q, passes = _scatter(
                seed, world, at, photon, vertex, start, (x, y, z), own, q, rays.lamp[k], fates
            )
            if passes and goes_on and vertex == out.direct[k]:
                out.direct[k] += 1
        out.offsets[k + 1] = row
    return len(rays.photon), row


# Among mobiles ----------------------------------------------------------------------------------------------


def reflected(
    world: World, at: Transforms, seed: int, kept_prefixes: Segments, cut: np.ndarray, fates: Fates
) -> tuple[np.ndarray, PhotonRays]:
    """Scatter photons at the cuts of their segments, at distances cut (n,) float32 [m]; adds to `fates`.

    Returns the positions (n, 3) float32 of the cuts and the rays of the surviving photons, in order.
    """
    n, sums = kept_prefixes.size, np.zeros((3, len(fates.emitted)), np.int64)
    hit = np.empty((n, 3), np.float32)
    on = PhotonRays(
        np.empty(n, np.int64), np.empty(n, np.int32), *np.empty((2, n, 3), np.float32), np.empty(n, np.int32),
        np.empty((n, 3), np.int32), np.empty(n, np.uint8), np.empty(n, bool),
    )  # fmt: skip
    count = _reflect(world, at, seed, kept_prefixes, cut, hit, on, sums)
    add_to(fates, sums)
    return hit, PhotonRays(*(a[:count] for a in on))


@kernel
def _reflect(world, at, seed, kept_prefixes, cut, hit, on, fates):
    n = 0
    for k in range(len(cut)):
        start, end = row_of(kept_prefixes.origin, k), row_of(kept_prefixes.end, k)
        x, y, z = start
        dx, dy, dz, _ = line(x, y, z, end[0], end[1], end[2])
        side = kept_prefixes.cut_side[k]
        x, y, z = landing(world, at, side >> 1, (x, y, z), (dx, dy, dz), cut[k])
        hit[k, 0], hit[k, 1], hit[k, 2] = x, y, z
        q = kept_prefixes.flux[k, 0], kept_prefixes.flux[k, 1], kept_prefixes.flux[k, 2]
        vertex, lamp = np.int64(kept_prefixes.bounce[k] + 1), kept_prefixes.lamp[k]
        photon = kept_prefixes.photon[k]
        goes_on, dx, dy, dz, q, passes = _scatter(seed, world, at, photon, vertex, start, end, side, q, lamp, fates)
        if goes_on:
            on.lamp[n], on.direct[n] = lamp, kept_prefixes.direct[k] and passes
            on.photon[n], on.bounce[n], on.side[n] = kept_prefixes.photon[k], vertex, side
            on.origin[n, 0], on.origin[n, 1], on.origin[n, 2] = x, y, z
            on.direction[n, 0], on.direction[n, 1], on.direction[n, 2] = dx, dy, dz
            on.flux[n, 0], on.flux[n, 1], on.flux[n, 2] = q[0], q[1], q[2]
            n += 1
    return n


def follow(
    accelerator: Accelerator, world: World, at: Transforms, seed: int, rays: PhotonRays, fates: Fates
) -> Segments:
    """Trace rays among static part and mobiles until all paths have ended, in this thread; adds to `fates`.

    Returns their segments, photon-major.
    """
    ray, sums = new_ray(), np.zeros((3, len(fates.emitted)), np.int64)
    out = empty_segments(USUAL * len(rays.photon))
    done = row = 0
    while done < len(rays.photon):
        done, row = _follow(accelerator.scenes, ray, world, at, seed, rays, done, out, row, sums)
        if done < len(rays.photon):
            out = Segments(*(grown(a, 2 * len(a)) for a in out))
    add_to(fates, sums)
    return Segments(*(a[:row] for a in out))


@kernel
def _follow(scenes, ray, world, at, seed, rays, done, out, row, fates):
    """Trace rays from `done` on to segments from `row` on, while they fit; return both counters."""
    for k in range(done, len(rays.photon)):
        photon, vertex, side = rays.photon[k], np.int64(rays.bounce[k]), rays.side[k]
        ox, oy, oz = rays.origin[k, 0], rays.origin[k, 1], rays.origin[k, 2]
        dx, dy, dz = rays.direction[k, 0], rays.direction[k, 1], rays.direction[k, 2]
        q = rays.flux[k, 0], rays.flux[k, 1], rays.flux[k, 2]
        goes_on, direct = True, rays.direct[k]
        while goes_on:
            if row == len(out.low):
                _wait(rays, k, vertex, (ox, oy, oz), (dx, dy, dz), side, q)
                rays.direct[k] = direct
                return k, row
            x, y, z, end_side = static_end(scenes, ray, world, at, ox, oy, oz, dx, dy, dz, side)
            cut, cut_side = mobile_cut(scenes, ray, world, at, ox, oy, oz, x, y, z, side)
            out.photon[row], out.bounce[row], out.lamp[row] = photon, vertex, rays.lamp[k]
            out.direct[row] = direct
            out.origin[row, 0], out.origin[row, 1], out.origin[row, 2] = ox, oy, oz
            out.end[row, 0], out.end[row, 1], out.end[row, 2] = x, y, z
            out.flux[row, 0], out.flux[row, 1], out.flux[row, 2] = q[0], q[1], q[2]
            out.start_side[row], out.end_side[row], out.cut_side[row] = side, end_side, cut_side
            start, end = (ox, oy, oz), (x, y, z)
            dx, dy, dz, length = line(ox, oy, oz, x, y, z)
            side, high = end_side, length
            if cut_side != NONE:
                x, y, z = landing(world, at, cut_side >> 1, (ox, oy, oz), (dx, dy, dz), cut)
                side, high = cut_side, cut
            out.low[row], out.high[row] = -1.0, high
            out.hit[row, 0], out.hit[row, 1], out.hit[row, 2] = x, y, z
            row += 1
            vertex += 1
            ox, oy, oz = x, y, z
            goes_on, dx, dy, dz, q, passes = _scatter(
                seed, world, at, photon, vertex, start, end, side, q, rays.lamp[k], fates
            )
            direct = direct and passes
    return len(rays.photon), row
