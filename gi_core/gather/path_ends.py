"""Where paths end: their rays, the hits of these, and the rule for the end, a record that numba dispatches on by type.

`InKnownLight` lets paths go on until Russian roulette, or known irradiance at a hit, ends them. `OneBounce` ends each
at its first hit, in the irradiance of the static part. `KeptHits` keeps the first hits. All receive the sky, and
emission by the balance heuristic (Veach 1997). Queries that distinguish the types are compiled with `arrive`;
inlined by numba instead of LLVM they take a third more time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import by_type, inlined, kernel
from gi_core.base.vec import barycentric, dot, rotate, row
from gi_core.bsdf import lambertian, surface
from gi_core.lights.next_event import lifted, share_of_bounce
from gi_core.lights.sky import patch
from gi_core.model import Model
from gi_core.rays.accelerator import LIFT, Transforms
from gi_core.rays.all_objects import lift_off, on_plane
from gi_core.scene.pose import to_world_at

# Of the light of the brightest corner or neighbour; above 0, since one photon in a million slips through where edges
# meet. A receiver with less may lie inside another part, see `display/dilation.py`.
BLACK = 0.02


class PathEnds(NamedTuple):
    """Current vertices of n unfinished paths."""

    path: np.ndarray  # (n,) int64, path number
    row: np.ndarray  # (n,) int64, row of its sum
    position: np.ndarray  # (n, 3) float64 [m]
    normal: np.ndarray  # (n, 3) float64, of the side of the vertex
    lift: np.ndarray  # (n,) float64 [m]: rays start so far off the surface
    throughput: np.ndarray  # (n, 3) float64, factor of irradiance at this vertex; of pi L on a glossy face
    face: np.ndarray  # (n,) int32, glossy face of the vertex; -1: start, or a diffuse face
    arrival: np.ndarray  # (n, 3) float64 unit, to the vertex before, of glossy vertices
    tangent: np.ndarray  # (n, 3) float64 unit, there
    density: np.ndarray  # (n,) float64 [1/sr], of the direction sampled at a glossy vertex; < 0: a mirror's


def starts(path, row, position, normal, lift: np.ndarray | None = None) -> PathEnds:
    """Return the starts of n paths that estimate irradiance, with views of the arrays given.

    lift (n,) float64 [m]: rays start so far off the surface; None: as far as coordinates are rounded.
    """
    n = len(path)
    if lift is None:
        lift = LIFT * np.abs(position).max(axis=1, initial=0.0)
    one = np.ones((n, 3)), np.full(n, -1, np.int32), *np.zeros((2, n, 3)), np.zeros(n)
    return PathEnds(path, row, position, normal, lift, *one)


class PathHits(NamedTuple):
    """Rays from the current vertices of n paths, and their hits."""

    ends: PathEnds
    seed: int
    m: int  # log2 of the paths of a set, see stratified()
    vertex: int  # number of these vertices along the paths
    direction: np.ndarray  # (n, 3) float32 unit
    distance: np.ndarray  # (n,) float32 [m]
    face: np.ndarray  # (n,) int32, global; -1: none


class BounceHits(NamedTuple):
    """Bounce rays from n receivers, and their hits: first[i] to first[i + 1] are those of receiver i."""

    paths: int  # P: sums are P times a mean
    first: np.ndarray  # (n + 1,) int64
    normals: np.ndarray  # (n, 3) float64, of the receivers, in the world
    rotation: np.ndarray  # (3, 3) float64, of directions to the world
    direction: np.ndarray  # (k, 3) float32 unit
    distance: np.ndarray  # (k,) float32 [m]
    face: np.ndarray  # (k,) int32, global; -1: none

    def past_panes(self, shares: np.ndarray) -> PassedHits:
        """Return the hits with the shares (k, 4) of panes on the way, see PathRays."""
        return PassedHits(*self, shares)


class PassedHits(NamedTuple):
    """BounceHits in a scene with panes; another type, so that kernels of other scenes read no shares."""

    paths: int
    first: np.ndarray
    normals: np.ndarray
    rotation: np.ndarray
    direction: np.ndarray
    distance: np.ndarray
    face: np.ndarray
    shares: np.ndarray  # (k, 4) float64


class InKnownLight(NamedTuple):
    """Paths end in the irradiance of objects where a hit is farther than `least` [m] of its face.

    Nearer hits lie in shadows that receivers do not resolve, such as that of a foot on the floor; paths go on there
    (Jensen 2001, secondary final gathering). Russian roulette ends the others.
    """

    points: np.ndarray  # (R, 3) float64 of the receivers [m], static ones first
    corner_front: np.ndarray  # (F, 3) int32, receivers at the corners of a face, on its front
    corner_back: np.ndarray  # (F, 3) int32, on its back
    irradiance: np.ndarray  # (R, 3) float64 of these receivers [W/m2], of one lamp
    least: np.ndarray  # (F,) float64 of these faces [m], inf: none end there; empty: none end in known light


WHOLE = InKnownLight(np.zeros((0, 3)), *np.zeros((2, 0, 3), np.int32), np.zeros((0, 3)), np.zeros(0))


def in_known_light(
    model: Model, at: Transforms, irradiance: np.ndarray, disc_area: float, least: np.ndarray | float = 0.0
) -> InKnownLight:
    """Return the light in which paths end: irradiance (R, 3) [W/m2] of the objects in `at`, beyond `least` (F,) [m].

    Paths go on from faces with a black corner, which is inside another object. They also go on from faces larger than
    a disc [m2], whose corners say little about their light.
    """
    s, objects = model.surfaces, len(at.position)
    faces, receivers = slice(0, int(s.first_face[objects])), slice(0, int(s.first_receiver[objects]))
    points, front, back = model.object_receivers.positions[receivers], s.corner_front[faces], s.corner_back[faces]
    of = s.object_of(np.arange(len(points)))
    black = ~(irradiance[receivers] > 0).any(axis=1)
    unresolved = black[front].any(axis=1) | (s.two_sided[faces] & black[back].any(axis=1))
    unresolved |= s.areas[faces] > disc_area
    places = to_world_at(at.rotation[of], at.position[of], points)
    return InKnownLight(places, front, back, irradiance[receivers], np.where(unresolved, np.inf, least))


class Bright(NamedTuple):
    """Static faces that have rays of their own, see `candidates.py`; empty: none."""

    of_face: np.ndarray  # (F,) int32, index of a face among them, -1: none
    density: np.ndarray  # (A,) float64 [1/m2], probability density of a point on the face


class Exchange(NamedTuple):
    """Bounces from mobiles that hit mobiles. Receivers are indices among those of mobiles."""

    row: np.ndarray  # (n,) int64, receiver that the bounce leaves
    path: np.ndarray  # (n,) int64, number of the bounce; -1: the light of single rays is not wanted
    corners: np.ndarray  # (n, 3) int64, receivers at the corners of the hit face
    reflectance: np.ndarray  # (n, 3) float64, times P over the bounces of the receiver
    share: np.ndarray  # (n, 3) float64, weights of the corners, see reached_corners()

    @classmethod
    def of(cls, n: int) -> Exchange:
        """Return room for n bounces."""
        return cls(*np.empty((2, n), np.int64), np.empty((n, 3), np.int64), *np.empty((2, n, 3)))


class OneBounce(NamedTuple):
    """Paths end at the first hit (final gathering, Reichert 1992; Jensen 2001): rho times the mean E of its corners.

    Many hits have the mean of interpolated light, which takes more time: it reads the corners' positions. Glossy
    surfaces reflect here as diffuse ones of the same hemispherical albedo. Hits on bright faces count with the balance
    weight of a bounce.
    """

    corner_front: np.ndarray  # (F, 3) int32, receivers at the corners of a face, on its front
    corner_back: np.ndarray  # (F, 3) int32, on its back
    irradiance: np.ndarray  # (>= receivers of the static part, 3 G) float64 [W/m2], per lamp
    bright: Bright = Bright(np.empty(0, np.int32), np.empty(0))
    # Added to: the light of each of P rays over all lamps, negative light as none; (0, 3, 1): not wanted.
    by_ray: np.ndarray = np.empty((0, 3, 1), np.float32)  # (n, 3, P) float32
    exchange: Exchange = Exchange.of(0)  # room for the hits on mobiles
    first_row: int = 0  # receiver of the first row, among those of mobiles
    first_receiver: int = 0  # the first receiver of a mobile


class KeptHits(NamedTuple):
    """Paths end at the first hit, kept for its light (`radiosity.py`). Light of bright faces counts at once."""

    side: np.ndarray  # (rays,) int32: twice the face, and 1 on its back; stays where there is no hit
    bright: Bright
    of_bright: np.ndarray  # (A, 3 G) float64 [W/m2], light that bright faces reflect


# Queries of rays and rules: numba chooses by the type of the first argument -----------------------------------


def _row_of_receiver(rays, k, before):
    while k >= rays.first[before + 1]:
        before += 1
    return before


def _density_of_path(rays, i, k, d):
    if rays.ends.face[k] >= 0:
        return rays.ends.density[k]
    return lambertian.pdf(max(dot(d, rays.ends.normal[k]), 0.0))


def _density_of_bounce(rays, i, k, d):
    return lambertian.pdf(max(dot(d, rays.normals[i]), 0.0))


def _density_past_panes(rays, i, k, d):
    return -1.0 if rays.shares[k, 3] > 0.0 else lambertian.pdf(max(dot(d, rays.normals[i]), 0.0))


def _record_by_ray(ending, rays, i, k, c, light):
    if len(ending.by_ray) > 0:
        ending.by_ray[i, c, k - rays.first[i]] += light


def _of_rays(path: Callable, bounce: Callable, passed: Callable | None = None) -> Callable:
    """Return a query of rays; passed: past panes, as of bounces by default."""
    return by_type({PathHits: path, BounceHits: bounce, PassedHits: passed or bounce})


# _row(rays, k, before): of the sum that ray k adds to; before: that of the ray before.
_row = _of_rays(lambda rays, k, before: rays.ends.row[k], _row_of_receiver)
# _direction(rays, k): unit, in the world.
_direction = _of_rays(lambda rays, k: row(rays.direction, k), lambda rays, k: rotate(rays.rotation, rays.direction[k]))
# _is_sent(rays, k): whether ray k leaves its surface.
_is_sent = _of_rays(lambda rays, k: rays.ends.face[k] < 0 or rays.ends.density[k] != 0.0, lambda rays, k: True)
# _weight(rays, i, k, c): factor of light that ray k of row i brings in channel c.
_weight = _of_rays(
    lambda rays, i, k, c: rays.ends.throughput[k, c],
    lambda rays, i, k, c: rays.paths / (rays.first[i + 1] - rays.first[i]),
)
# _density(rays, i, k, d) [1/sr]: with which ray k of row i takes its direction d; < 0: a mirror's.
_density = _of_rays(_density_of_path, _density_of_bounce, _density_past_panes)
# _passed(rays, k, c): factor of channel c of panes that ray k has passed, where `_weight` does not have it.
_passed = _of_rays(lambda rays, k, c: 1.0, lambda rays, k, c: 1.0, lambda rays, k, c: rays.shares[k, c])


def _reflect_known_light(ending, world, at, rays, i, k, d, normal, facing, n, total):
    """With pdf cos / pi the mean of pi L is the irradiance, and pi L off a diffuse surface is rho times the irradiance
    there. Throughput is therefore multiplied by rho alone; by f cos / pdf when a glossy vertex scatters.
    """
    f, ends, t = rays.face[k], rays.ends, float(rays.distance[k])
    rho, glossy, x = world.bsdfs.albedo[f], surface.is_glossy(world.bsdfs, f), lifted(ends, k)
    place = x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2]
    if not glossy and f < len(ending.least) and rays.distance[k] > ending.least[f]:
        j = ending.corner_front[f] if facing > 0.0 else ending.corner_back[f]
        u, v, w = barycentric(ending.points[j[0]], ending.points[j[1]], ending.points[j[2]], place)
        for c in range(3):
            E = u * ending.irradiance[j[0], c] + v * ending.irradiance[j[1], c] + w * ending.irradiance[j[2], c]
            total[i, c] += ends.throughput[k, c] * lambertian.weight(rho[c]) * E
        return n
    largest = max(rho[0], max(rho[1], rho[2]))
    # The first two bounces carry most of the light. The bound ends paths in a white room without bias, and variance is
    # finite up to its square root.
    survival = 1.0 if rays.vertex < 2 and largest > 0.0 else min(largest, 0.9999)
    path = ends.path[k]
    # dimension 4, after those of next_event.py
    if survival < 1.0 and not (random_numbers.stratified(rays.seed, path, rays.vertex, 4, rays.m) < survival):
        return n
    s = 1.0 if facing > 0.0 else -1.0
    ends.path[n], ends.row[n] = path, i  # n <= k: overwritten rows have been read
    ends.normal[n, 0], ends.normal[n, 1], ends.normal[n, 2] = s * normal[0], s * normal[1], s * normal[2]
    place = on_plane(world, at, f, place)
    ends.position[n, 0], ends.position[n, 1], ends.position[n, 2] = place
    ends.lift[n], ends.face[n] = lift_off(world, f, place), f if glossy else -1
    if glossy:
        along = surface.tangent_of(world.bsdfs, at.rotation[world.face_object[f]], f)
        ends.tangent[n, 0], ends.tangent[n, 1], ends.tangent[n, 2] = along
    for c in range(3):
        ends.arrival[n, c] = -d[c]
        weight = 1.0 if glossy else lambertian.weight(rho[c])
        ends.throughput[n, c] = ends.throughput[k, c] * (weight / survival)
    return n + 1


@inlined
def _bright_face(bright, f, facing):
    """Return the index of face f among bright ones, whose front is hit if facing > 0; -1: none of them."""
    return bright.of_face[f] if facing > 0.0 and len(bright.density) > 0 else -1


def _reflect_once(ending, world, at, rays, i, k, d, normal, facing, n, total):
    f, E, part = rays.face[k], ending.irradiance, _weight(rays, i, k, 0)
    corners = ending.corner_front[f] if facing > 0.0 else ending.corner_back[f]
    if f >= world.first_face[1]:
        out = ending.exchange
        out.row[n], out.path[n] = ending.first_row + i, k - rays.first[i] if len(ending.by_ray) > 0 else -1
        for c in range(3):
            out.corners[n, c] = corners[c] - ending.first_receiver
            out.reflectance[n, c] = part * world.bsdfs.albedo[f, c] * _passed(rays, k, c)
        return n + 1
    u, v, w, share = corners[0], corners[1], corners[2], 1.0
    e = _bright_face(ending.bright, f, facing)
    if e >= 0:
        share = share_of_bounce(_density(rays, i, k, d), facing, rays.distance[k], ending.bright.density[e])
    for g in range(0, E.shape[1], 3):
        for c in range(3):
            light = world.bsdfs.albedo[f, c] * ((E[u, g + c] + E[v, g + c] + E[w, g + c]) / 3.0) * _passed(rays, k, c)
            total[i, g + c] += part * light * share
            _record(ending, rays, i, k, c, max(light, 0.0))
    return n


def _keep(ending, world, at, rays, i, k, d, normal, facing, n, total):
    ending.side[k] = 2 * rays.face[k] + (0 if facing > 0.0 else 1)
    e = _bright_face(ending.bright, rays.face[k], facing)
    if e >= 0:
        share = share_of_bounce(_density(rays, i, k, d), facing, rays.distance[k], ending.bright.density[e])
        for c in range(total.shape[1]):
            total[i, c] += _weight(rays, i, k, c) * share * ending.of_bright[e, c] * _passed(rays, k, c % 3)
    return n


# _record(ending, rays, i, k, c, light): add it, of channel c, to that of ray k of row i, where that is wanted.
_record = by_type({
    InKnownLight: lambda ending, rays, i, k, c, light: None, OneBounce: _record_by_ray,
    KeptHits: lambda ending, rays, i, k, c, light: None,
})  # fmt: skip
# _meet(ending, world, at, rays, i, k, d, normal, facing, n, total): end the path of ray k, of row i, or let it go on as
# number n; return the number of those that go on. d: direction; normal: of the front of the face that it hits; facing:
# cosine there, > 0 on the front.
_meet = by_type({InKnownLight: _reflect_known_light, OneBounce: _reflect_once, KeptHits: _keep})


# Kernels ------------------------------------------------------------------------------------------------------


@kernel
def arrive(world, at, lights, sky, rays, ending, total):
    """Add the light of hits to total (rows, 3 G) [W/m2]; return the number of paths that go on, or of `exchange`.

    rays: PathHits, whose ends that go on move to the front, with an InKnownLight; else BounceHits.
    lights: AreaLights.
    """
    n, i, static_faces = 0, 0, world.first_face[1]
    for k in range(len(rays.face)):
        i, f = _row(rays, k, i), rays.face[k]
        if not _is_sent(rays, k):
            continue
        d = _direction(rays, k)
        if f < 0:
            z = dot(d, sky.up)
            if z > 0.0:
                high, around = patch(sky, d, z)
                for c in range(3):
                    light = math.pi * sky.radiance[c] * sky.shape[high, around, c] * _passed(rays, k, c)
                    total[i, 3 * sky.lamp + c] += _weight(rays, i, k, c) * light
                    _record(ending, rays, i, k, c, light)
            continue
        R = at.rotation[0] if f < static_faces else at.rotation[world.face_object[f]]
        normal = rotate(R, world.normals[f])
        facing = -dot(d, normal)
        if facing > 0.0:  # emission leaves the front
            e = lights.of_face[f]
            if e >= 0:
                share = share_of_bounce(_density(rays, i, k, d), facing, rays.distance[k], lights.density[e])
                for c in range(3):
                    light = math.pi * lights.radiance[e, c] * share * _passed(rays, k, c)
                    total[i, 3 * lights.lamp[e] + c] += _weight(rays, i, k, c) * light
                    _record(ending, rays, i, k, c, light)
        elif not world.two_sided[f]:
            continue  # the back of a one-sided face is black
        n = _meet(ending, world, at, rays, i, k, d, normal, facing, n, total)
    return n


@kernel
def reached_corners(corners, E, share):
    """Write shares (n, 3) of the corners (n, 3) of faces that bounces hit: equal ones, but 0 for dark corners.

    A corner inside another part has at most BLACK of the light of the brightest one; E (m, 3) of the receivers.
    """
    for k in range(len(corners)):
        brightest, lit = 0.0, 0.0
        for c in corners[k]:
            brightest = max(brightest, E[c, 0] + E[c, 1] + E[c, 2])
        for j, c in enumerate(corners[k]):
            share[k, j] = 1.0 if E[c, 0] + E[c, 1] + E[c, 2] > BLACK * brightest else 0.0
            lit += share[k, j]
        for j in range(3):
            share[k, j] = share[k, j] / lit if lit > 0.0 else 1.0 / 3.0


@inlined
def reflected(exchange, k, E):
    """Return the light (3,) that hit k on a mobile reflects, as a bounce counts it; E (m, 3) of the receivers."""
    (u, v, w), (a, b, c), rho = row(exchange.corners, k), row(exchange.share, k), row(exchange.reflectance, k)
    return (
        rho[0] * (a * E[u, 0] + b * E[v, 0] + c * E[w, 0]),
        rho[1] * (a * E[u, 1] + b * E[v, 1] + c * E[w, 1]),
        rho[2] * (a * E[u, 2] + b * E[v, 2] + c * E[w, 2]),
    )


@kernel
def add_exchanged(exchange, E, bounced):
    """Add the light of mobiles that bounces (m, 3, P) hit; E (m, 3) of their receivers."""
    for k in range(len(exchange.row)):
        path = exchange.path[k]
        if path >= 0:
            light = reflected(exchange, k, E)
            for c in range(3):
                bounced[exchange.row[k], c, path] += light[c]
