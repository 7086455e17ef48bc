"""Shadow rays chosen among candidates: resampled importance sampling (Talbot, Cline and Egbert 2005).

Points on lamps lie along the lamps in strata of CANDIDATES points, the same for many receivers. A receiver computes the
unoccluded light of each candidate and sends one shadow ray per stratum, to a candidate chosen in proportion to it. A
ray that arrives brings the mean of its stratum. Its expectation is the light of the candidates, so it is unbiased, and
distance and angle add little noise: their means are over all candidates. One shadow ray comes with two bounces.

Bright static faces, such as sunlit floor, are lamps of a mobile. Few of its bounces meet such a place, so these make
most of the noise. Points on bright faces get shadow rays, as points on lamps do, weighted against bounces that hit the
same faces (balance heuristic, Veach 1997). Faces are chosen by their light at rest, and rays bring their light in the
frame, so the mean is that of bounces alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import allocating, inlined, kernel
from gi_core.base.nearest_points import hilbert_order
from gi_core.base.vec import difference, dot, row
from gi_core.geometry.error import REC709
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.area import AreaLights, largest_cosine, point_on_lamp
from gi_core.lights.lamps import Lights
from gi_core.lights.next_event import LIGHT_U, LIGHT_V, Shadows, aim_at_lamp, join_delta, room_for_shadows
from gi_core.lights.photometric import density

CANDIDATES = 8  # per shadow ray
PATHS_PER_SHADOW = 2  # bounces per shadow ray to an area light: docs/decisions/shadow-rays.md
PICK = 3  # dimension, after those of next_event.py
RED, GREEN, BLUE = REC709


class Candidates(NamedTuple):
    """Points on area lights in sets of strata of CANDIDATES, n in all. A receiver takes one set."""

    point: np.ndarray  # (3, n) float64 [m]
    normal: np.ndarray  # (3, n) float64 unit, of the lamp
    density: np.ndarray  # (n,) float64 [1/m2], probability density of the point
    power: np.ndarray  # (n,) float64 [W/m2/sr], luminance of the radiance
    colour: np.ndarray  # (3, n) float64, radiance over its luminance
    face: np.ndarray  # (n,) int64, emissive face
    pick: np.ndarray  # (n / CANDIDATES,) float64 in [0, 1), chooses one point of a stratum
    sets: int

    @property
    def strata(self) -> int:
        """Strata of a set: shadow rays of a receiver."""
        return len(self.pick) // self.sets


def thinned(of: Candidates, step: int) -> Candidates:
    """Return each step-th candidate, in the same strata; step: 1, 2, 4 or CANDIDATES."""
    point, normal, density, power, colour, face = (np.ascontiguousarray(a[..., ::step]) for a in of[:6])
    return Candidates(point, normal, density, power, colour, face, of.pick, of.sets)


def candidates(seed: int, paths: int, lights: AreaLights, sets: int = 1) -> Candidates:
    """Draw candidates for so many paths per receiver, in strata of equal probability; none without area lights."""
    n = max(paths // PATHS_PER_SHADOW, 1) * CANDIDATES * sets if len(lights.cdf) else 0
    point, normal, colour = np.empty((3, 3, n))
    face, pick = np.empty(n, np.int64), np.empty(n // CANDIDATES)
    out = Candidates(point, normal, *np.empty((2, n)), colour, face, pick, sets)
    _draw(seed, lights, *out)
    return out


@kernel
def _draw(seed, lights, point, normal, density, power, colour, face, pick, sets):
    n = len(face) // sets
    for i in range(len(face)):
        # A Hammersley set: its first number ascends, so a stratum is a run of points.
        u = (i % n + random_numbers.independent(seed, i, 0, LIGHT_U)) / n
        v = random_numbers.scrambled(np.uint64(i % n), random_numbers.hashed(seed, i // n, 0, LIGHT_V))
        e, density[i], p = point_on_lamp(lights, min(u, 1.0 - 2.0**-53), v)
        radiance = row(lights.radiance, e)
        face[i], power[i] = e, dot((RED, GREEN, BLUE), radiance)
        scale = 1.0 / power[i] if power[i] > 0.0 else 0.0
        colour[0, i], colour[1, i], colour[2, i] = scale * radiance[0], scale * radiance[1], scale * radiance[2]
        point[0, i], point[1, i], point[2, i] = p
        normal[0, i], normal[1, i], normal[2, i] = row(lights.normal, e)
    for j in range(len(pick)):
        pick[j] = random_numbers.independent(seed, j, 0, PICK)


def join_lamps(bsdfs, candidates: Candidates, picks: np.ndarray, paths: int, ends, lights: Lights, far) -> Shadows:
    """Return shadow rays from n path starts on diffuse surfaces to all lamps.

    Values [W/m2] of a start sum to `paths` times its irradiance. picks: of delta lights, see `next_event.picks`.
    Directional lights are `far` [m] away.
    """
    rays = room_for_shadows(len(ends.row) * (candidates.strata + min(len(lights.delta.kind), paths)))
    sets = sets_by_chance(candidates, ends.path)
    count = join_candidates(candidates, sets, paths, ends, lights.area, rays)
    count = join_delta(bsdfs, picks, paths, ends, lights.delta, far, count, rays, 1)
    return Shadows(*(a[:count] for a in rays))


def rays_to_candidates(candidates: Candidates, sets: np.ndarray, paths: int, ends, lights: AreaLights) -> Shadows:
    """Return the rays of join_candidates()."""
    rays = room_for_shadows(len(ends.row) * candidates.strata)
    count = join_candidates(candidates, sets, paths, ends, lights, rays)
    return Shadows(*(a[:count] for a in rays))


@allocating
def join_candidates(of, sets, paths, ends, lights, out):
    """Write shadow rays from n path starts to area lights, one per stratum of candidates; return their number.

    sets (n,) uint64: of candidates, one per start, see sets_by_chance(). Values are those of join_lamps(), weighted
    against bounces as in `next_event.join_area`.
    """
    n, strata = len(of.face) // of.sets, len(of.pick) // of.sets
    count, light, scale = 0, np.empty(n), paths / max(n, 1)
    for k in range(len(ends.row)):
        position, normal = row(ends.position, k), row(ends.normal, k)
        own = sets[k]
        before = own * np.uint64(n)
        unoccluded(of, before, position, normal, lights, light)
        for j in range(strata):
            first, total = j * CANDIDATES, 0.0
            for c in range(first, first + CANDIDATES):
                total += light[c]
            if total <= 0.0:
                continue
            left, chosen = of.pick[own * np.uint64(strata) + np.uint64(j)] * total, first
            for c in range(first, first + CANDIDATES):
                if light[c] > 0.0:
                    chosen = c  # the last candidate stays if rounding exhausts the sum
                    left -= light[c]
                    if left < 0.0:
                        break
            chosen = before + np.uint64(chosen)
            e, value = of.face[chosen], scale * total
            out.lamp[count] = lights.lamp[e]
            for c in range(3):
                out.value[count, c] = value * of.colour[c, chosen]
            point = of.point[0, chosen], of.point[1, chosen], of.point[2, chosen]
            aim_at_lamp(ends, k, lights.corners[e], point, out, count)
            out.stratum[count] = j
            count += 1
    return count


@allocating
def sets_by_chance(of, path):
    """Return the sets of candidates (n,) uint64 of starts, from the numbers (n,) of their paths."""
    out = np.empty(len(path), np.uint64)
    for k in range(len(path)):
        out[k] = random_numbers.hashed(0, path[k], 0, PICK) % np.uint64(of.sets)
    return out


@inlined
def unoccluded(of, before, position, normal, lights, out):
    """Write the luminance [W/m2] of n candidates, after `before` others, over their density, without shadow."""
    _from_faces(of, before, position, normal, out)
    for c in range(np.uint64(len(out))):
        if lights.table[of.face[before + c]] >= 0:
            out[c] = _from_luminaire(of, before + c, position, normal, lights)


@inlined
def _from_faces(of, before, position, normal, out):
    """Write the same, as if each were on a diffuse lamp. LLVM vectorises no loop of few, known turns: one over all."""
    for k in range(np.uint64(len(out))):
        i = before + k
        x, y, z = of.point[0, i] - position[0], of.point[1, i] - position[1], of.point[2, i] - position[2]
        d2 = x * x + y * y + z * z
        cos_own = max(x * normal[0] + y * normal[1] + z * normal[2], 0.0)
        cos_lamp = max(-(x * of.normal[0, i] + y * of.normal[1, i] + z * of.normal[2, i]), 0.0)
        # Le cos cos' / d^2 / (p_light + cos cos' / d^2 / pi), times d^4 above and below
        out[k] = of.power[i] * cos_own * cos_lamp / max(of.density[i] * d2 * d2 + cos_own * cos_lamp / math.pi, 1e-300)


@kernel
def _from_luminaire(of, i, position, normal, lights):
    """Return the luminance of candidate i, on a luminaire, over its density: no bounce hits one."""
    e, way = of.face[i], difference((of.point[0, i], of.point[1, i], of.point[2, i]), position)
    d2, here, axis = dot(way, way), dot(way, normal), lights.normal[e]
    if not (here > 0.0 and dot(way, axis) < 0.0):
        return 0.0
    d = math.sqrt(d2)
    share = density(lights.tables, lights.table[e], axis, lights.c0[e], -way[0] / d, -way[1] / d, -way[2] / d)
    return of.power[i] * math.pi * share * here / (d * d2 * of.density[i])


BRIGHT = 4.0  # times the mean light of faces that face a mobile
LEAST_BRIGHT = 0.2  # of their light, from bright ones
BOUNCES_PER_BRIGHT = 8  # bounces per ray to a bright face


class BrightFaces(NamedTuple):
    """Bright faces as lamps: each a lamp of its own, of its luminance at rest in all channels."""

    lights: AreaLights
    face: np.ndarray  # (A,) int64


class StaticFaces(NamedTuple):
    """Fronts of the static part's faces, in the order of a Hilbert curve."""

    face: np.ndarray  # (n,) int64
    corners: np.ndarray  # (n, 9) float64 [m]
    middle: np.ndarray  # (n, 3) float64 [m]
    normal: np.ndarray  # (n, 3) float64 unit
    area: np.ndarray  # (n,) float64 [m2]
    receiver: np.ndarray  # (n, 3) int32, at the corners

    @classmethod
    def of(cls, s: Surfaces) -> StaticFaces:
        """Return those of surfaces."""
        corners = s.vertices[0][s.faces[0]]
        middle = corners.mean(axis=1)
        order = hilbert_order(middle)
        ordered = (a[order] for a in (corners.reshape(-1, 9), middle, s.normals, s.areas, s.corner_front))
        return cls(order, *ordered)

    def luminance(self, E: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
        """Return the luminance (n,) [W/m2] that faces reflect; E (receivers, 3) [W/m2], reflectance (F, 3)."""
        out = np.empty(len(self.face))
        _reflect(self.face, self.receiver, E, reflectance, out)
        return out

    def view(self, centre: np.ndarray, radius: float) -> np.ndarray:
        """Return the parts (n,) that faces take of a mobile's view, whether something hides them or not.

        centre (3,) and radius [m]: sphere around the mobile, in the world.
        """
        out = np.empty(len(self.face))
        _look(self.middle, self.normal, self.area, centre, radius, out)
        return out

    def bright(self, luminance: np.ndarray, view: np.ndarray, faces: int) -> BrightFaces:
        """Return the faces that are bright in a view (n,), by their luminance (n,); faces: of all objects."""
        brought = np.empty(len(self.face))
        total, seen = _bring(luminance, view, brought)
        rows = np.flatnonzero((luminance * seen > BRIGHT * total) & (brought > 0.0))
        share = brought[rows]
        if share.sum() < LEAST_BRIGHT * total:
            rows, share = rows[:0], share[:0]
        share /= max(share.sum(), 1e-300)
        cdf = np.cumsum(share)
        cdf[-1:] = 1.0
        n, of_face = len(rows), np.full(faces, -1, np.int32)
        of_face[self.face[rows]] = np.arange(n)
        radiance = np.repeat(luminance[rows, None] / math.pi, 3, axis=1)
        lights = AreaLights(
            self.corners[rows], self.normal[rows], radiance, cdf, share / self.area[rows], of_face, np.arange(n),
            np.full(n, -1), np.zeros((n, 3)), np.zeros(0),
        )  # fmt: skip
        return BrightFaces(lights, self.face[rows])


@kernel
def _reflect(face, receiver, E, reflectance, out):
    for k in range(len(face)):
        rho, (u, v, w) = row(reflectance, face[k]), row(receiver, k)
        red, green, blue = E[u, 0] + E[v, 0] + E[w, 0], E[u, 1] + E[v, 1] + E[w, 1], E[u, 2] + E[v, 2] + E[w, 2]
        out[k] = max((RED * rho[0] * red + GREEN * rho[1] * green + BLUE * rho[2] * blue) / 3.0, 0.0)


@kernel
def _look(middle, normal, area, centre, radius, out):
    for k in range(len(out)):
        way = difference((centre[0], centre[1], centre[2]), row(middle, k))
        d2 = dot(way, way)
        out[k] = area[k] * largest_cosine(dot(way, row(normal, k)), d2, radius) / (d2 + radius * radius + area[k])


@kernel
def _bring(luminance, view, brought):
    """Write the light that faces bring to a mobile; return its sum, and that of the views of lit faces."""
    total = seen = 0.0
    for k in range(len(brought)):
        brought[k] = luminance[k] * view[k]
        total += brought[k]
        seen += view[k] if luminance[k] > 0.0 else 0.0
    return total, seen


@allocating
def relative_light(face, radiance, corner_front, reflectance, E):
    """Return the radiance (A, 3) of bright faces over that at rest, radiance (A, 3); E (receivers, 3) [W/m2]."""
    out = np.empty((len(face), 3))
    for k, f in enumerate(face):
        u, v, w = row(corner_front, f)
        for c in range(3):
            out[k, c] = reflectance[f, c] * (E[u, c] + E[v, c] + E[w, c]) / (3.0 * math.pi * radiance[k, c])
    return out


@kernel
def add_reflected(rays, blocked, relative, total):
    """Add the light that unblocked rays to bright faces bring, times relative (A, 3 G), to total (n, 3 G)."""
    for j in range(len(blocked)):
        if not blocked[j]:
            for c in range(total.shape[1]):
                total[rays.row[j], c] += rays.value[j, c % 3] * relative[rays.lamp[j], c]
