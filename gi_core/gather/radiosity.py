"""Radiosity of the static part by bounces that are kept: early light that needs no photons.

A receiver's light is direct light plus the mean, over its bounces, of the light reflected by the faces that they hit.
Hits are traced once and kept. Light at them is that of the receivers themselves, iterated until it stands (Jacobi;
Cohen and Wallace 1993). So an iteration takes no rays, and hundreds of receivers around each hit average the noise.
Direct light comes by shadow rays to points chosen among candidates (`gather/candidates.py`), and by bounces that hit
lamps or sky. Shadows of delta lights are sharp, so a face may have other light than its corners: shadow rays light
points on each face. Bright faces, such as a small patch of sun, also get rays from receivers (`candidates.py`),
because few bounces meet them.

Paths come in pairs of sets; each pair has twice as many paths as the last, because large sets are better stratified.
The differences within pairs give the noise.
"""

from __future__ import annotations

import copy
import math
import time
from typing import NamedTuple, cast

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.pause import STEP, Pace, pause
from gi_core.base.random_numbers import Stream, seed_of
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.base.vec import dot, row
from gi_core.gather.candidates import (
    BOUNCES_PER_BRIGHT,
    PATHS_PER_SHADOW,
    BrightFaces,
    Candidates,
    StaticFaces,
    add_reflected,
    candidates,
    join_lamps,
    rays_to_candidates,
    sets_by_chance,
)
from gi_core.gather.direct_light import DirectLight, Places
from gi_core.gather.path_ends import BLACK, BounceHits, Bright, KeptHits, arrive, starts
from gi_core.gather.path_tracer import BLOCK, add_unblocked, scatter
from gi_core.geometry.error import REC709, luminance, relative_noise, small_sample_bias
from gi_core.lights.emission import Emitters
from gi_core.lights.lamps import sum_of_lamps
from gi_core.lights.next_event import DELTA, picks
from gi_core.model import Model
from gi_core.rays.accelerator import FAR
from gi_core.rays.all_objects import PASSAGE, nearest_in_world, nearest_past_panes, occluded_in_world


class FaceLight(NamedTuple):
    """Direct light [W/m2] by delta lights at n static receivers and F static faces, per lamp; (0, 3 G): none."""

    receivers: np.ndarray  # (n, 3 G) float64, of receivers
    reflected: np.ndarray  # (2 F, 3 G) float32, reflected by fronts and backs of faces; bright fronts: 0
    bright: BrightFaces
    of_bright: np.ndarray  # (A, 3 G) float64, reflected by the fronts of bright faces


class Bounces(NamedTuple):
    """Bounces that are kept, and direct light, to light the same geometry again after an edit of lights or colours."""

    hits: list[np.ndarray]  # as of Radiosity
    direct: np.ndarray  # (n, 3 G) float64 [W/m2]; of lamps that are no delta lights, without light of bright faces
    deviation: np.ndarray  # (n, 3 G) float64 [W/m2], its standard error
    emitters: Emitters  # of these lamps
    rays_key: str  # Model.static_rays_key

    @property
    def paths(self) -> int:
        """Paths per receiver."""
        return sum(2 * hits.shape[2] for hits in self.hits)


def face_light(model: Model, seed: int, weights: np.ndarray, by_delta: np.ndarray | None = None) -> FaceLight:
    """Return the light of a model's static faces, with a pause every 10 ms; weights (n,): of static receivers.

    by_delta (n, 3 G) [W/m2]: light of delta lights at receivers, where no face gets rays of its own as bright; None: it
    is measured.
    """
    s, lights, world = model.surfaces, model.lights, model.world
    of = s.face_range(0)
    count = of.stop
    faces = StaticFaces.of(s)
    at_receivers = by_delta
    if at_receivers is None:
        delta = DirectLight(model, seed, (DELTA,))
        if count and len(lights.delta.kind):
            delta = delta.measured_at(Places.of_receivers(model))
        at_receivers = delta.per_lamp
    on_faces = DirectLight(model, seed, (DELTA,), sun_points=1)
    none, dark = np.zeros((0, lights.channels)), np.zeros(count)
    no_face = faces.bright(dark, dark, len(world.face_object))
    if not at_receivers.any():
        return FaceLight(none, none.astype(np.float32), no_face, none)
    points = min(max((1 << 19) // (count * len(lights.delta.kind)), 1), 4)  # at most 0.3 s of rays
    albedo = np.tile(world.bsdfs.albedo[of], lights.channels // 3)
    both = np.zeros((count, 2, lights.channels), np.float32)
    for side, rows in enumerate((np.arange(count), np.flatnonzero(s.two_sided[of]))):
        light = on_faces.measured_at(_on_faces(model, rows, 1 - 2 * side, points)).per_lamp
        both[rows, side] = albedo[rows] * light.reshape(len(rows), points, lights.channels).mean(axis=1)
        pause()
    if by_delta is not None:
        return FaceLight(by_delta, both.reshape(2 * count, -1), no_face, none)
    reflected = luminance(sum_of_lamps(both[faces.face, 0]))
    view = _looked_at(model, seed, weights)[faces.face]
    # Above 0: the mean is that of all faces that receivers see.
    chosen = faces.bright(np.maximum(reflected, 1e-12 * reflected.max()), view, len(world.face_object))
    of_bright = both[chosen.face, 0].astype(np.float64)
    both[chosen.face, 0] = 0.0
    return FaceLight(at_receivers, both.reshape(2 * count, -1), chosen, of_bright)


def relit(
    model: Model, seed: int, weights: np.ndarray, bounces: Bounces, columns: np.ndarray, direct: np.ndarray,
    deviation: np.ndarray, by_delta: np.ndarray,
) -> Radiosity:  # fmt: skip
    """Return the light of kept bounces in columns (k,) of light per lamp, from direct light there.

    direct, deviation: that light and its standard error (n, k) [W/m2]; by_delta (n, 3 G): light of delta lights. It
    traces rays from faces to these alone. weights (n,): of static receivers.
    """
    points, normals = (a[model.surfaces.receiver_range(0)] for a in model.evaluation_points)
    r = Radiosity(model, seed, points, normals, weights)
    of = face_light(model, r._seed, weights, by_delta)
    # take(): kernels are compiled for rows that lie one after another
    receivers, reflected, of_bright = (a.take(columns, 1) for a in (of.receivers, of.reflected, of.of_bright))
    r._on_faces, r.per_lamp = FaceLight(receivers, reflected, of.bright, of_bright), np.zeros_like(direct)
    r._light(bounces.hits, direct, deviation**2)
    return r


def _on_faces(model: Model, rows: np.ndarray, side: int, points: int) -> Places:
    """Return so many points on each of the static faces rows (f,), on a side 1 or -1 of them, face by face."""
    s = model.surfaces
    n = np.arange(1, len(rows) * points + 1)
    # A sequence of low discrepancy in the unit square (Roberts 2018).
    u, v = (n * step % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
    root = np.sqrt(u)
    weights = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
    rows = np.repeat(rows, points)
    positions = (weights[:, :, None] * s.vertices[0][s.faces[0][rows]]).sum(axis=1)
    lifts = model.lifts[s.corner_front[rows]].max(axis=1)
    return Places(positions, side * s.normals[rows], lifts)


def _looked_at(model: Model, seed: int, weights: np.ndarray) -> np.ndarray:
    """Return how often bounces hit the front of each static face, (F,) float64; they start by weights (n,)."""
    pilot_bounces = 1 << 15  # that look for bright faces: 20 ms
    at, (positions, normals, lifts) = model.static, Places.of_receivers(model)
    shares = np.cumsum(np.where(normals.any(axis=1), weights, 0.0))
    rows = np.searchsorted(shares, shares[-1] * (np.arange(pilot_bounces) + 0.5) / pilot_bounces)
    path = np.arange(pilot_bounces)
    ends = starts(path, path, positions[rows], normals[rows], lifts[rows])
    origin, direction = np.empty((2, pilot_bounces, 3), np.float32)
    scatter(model.world.bsdfs, seed, pilot_bounces.bit_length() - 1, 0, ends, origin, direction)
    limits = np.full(pilot_bounces, FAR * model.world.size, np.float32)
    _, face = nearest_in_world(model.accelerator, at, origin, direction, limits)
    in_front = (model.surfaces.normals[face] * direction).sum(axis=1) < 0.0
    return np.bincount(face[(face >= 0) & in_front], minlength=model.surfaces.face_range(0).stop).astype(np.float64)


SMALLEST, PAIRS = 3, 6  # log2 of the paths of the first sets; 1,008 paths in all: then error is bias
MOST_HITS = 1 << 26  # 256 MB: scenes of more than 280,000 receivers have fewer paths


class Radiosity:
    """Irradiance at n receivers of the static part without mobiles.

    positions (n, 3) [m]; normals (n, 3), 0: black; weights (n,) of their noise.
    """

    def __init__(self, model: Model, seed: int, positions: np.ndarray, normals: np.ndarray, weights: np.ndarray):
        self._model, self._seed = model, seed_of(Stream.RADIOSITY, seed)
        self._starts = positions, normals, model.lifts
        self.weights, self._lit = weights, np.flatnonzero((normals * normals).sum(axis=1) > 0)
        self._lights, self._open_sides = model.lights, model.open_sides
        self._on_faces: FaceLight | None = None
        shape = len(positions), self._lights.channels
        self._direct = self._direct_variance = np.zeros(shape)
        self._variance, self._lamp_variance = np.zeros(positions.shape), np.zeros(shape)
        self._pace = Pace(1e-5, 1 << 8, 1 << 16)
        pairs = MOST_HITS // max(len(self._lit), 1) // (2 << SMALLEST) + 1
        self._most_pairs = max(min(pairs.bit_length() - 1, PAIRS), 1)
        self._hits: list[np.ndarray] = []  # of pairs: (2, k, 2^m) int32 of k lit receivers, as KeptHits
        self.is_complete = False  # no pair follows
        self.paths = 0  # per receiver in `mean`; 0: no result yet
        self.per_lamp = np.zeros(shape)  # (n, 3 G) float64 [W/m2]
        self.mean = np.zeros(positions.shape)  # (n, 3) float64 [W/m2], of all lamps

    def copied(self, model: Model | None) -> Radiosity:
        """Return a copy that goes on from here, of a model with the same `static_key`, None: to be kept without one."""
        other = copy.copy(self)
        other._model = cast(Model, model)
        return other

    @property
    def standard_error(self) -> np.ndarray:
        """Standard error of the mean, (n, 3) [W/m2]; rough per receiver, as it comes from few differences."""
        return np.sqrt(self._variance)

    @property
    def lamp_error(self) -> np.ndarray:
        """Standard error of the light of each lamp, (n, 3 G) [W/m2]."""
        return np.sqrt(self._lamp_variance)

    @property
    def noise(self) -> float:
        """Relative l1 noise of the mean, inf before the first result."""
        if not self.paths:
            return float("inf")
        return relative_noise(luminance(self.standard_error) / small_sample_bias(2), self.mean, self.weights)

    def add_pair(self) -> None:
        """Gather the next pair, with a pause every 10 ms. One that is broken off is gathered again."""
        if self._on_faces is None:
            self._on_faces = face_light(self._model, self._seed, self.weights)
        number = len(self._hits)
        m = SMALLEST + number
        halves, hits = np.zeros((2, *self.per_lamp.shape)), np.empty((2, len(self._lit), 1 << m), np.int32)
        for half in range(2):
            self._trace(2 * number + half, m, halves[half], hits[half])
        self._take_in(halves, [*self._hits, hits])

    def _trace(self, number: int, m: int, direct: np.ndarray, hits: np.ndarray) -> None:
        """Trace set `number` of 2^m paths; write its hits (k, 2^m) and the direct light (n, 3 G) [W/m2]."""
        seed, bright, first = self._seed ^ (number << 20), self._on_faces.bright.lights, 0
        to_bright = PATHS_PER_SHADOW * max((1 << m) // BOUNCES_PER_BRIGHT, 1)
        of_sets = (1 << m, self._lights.area), (to_bright, bright)
        # Each receiver has one of 32 sets of points on lamps: neighbours should not share their errors.
        on_lamps = tuple(candidates(seed, *of_set, 32) for of_set in of_sets)
        while first < len(self._lit):
            began, end = time.perf_counter(), min(first + max(1, self._pace.fit(STEP) >> m), len(self._lit))
            self._gather(first, end, number, m, on_lamps, direct, hits)
            self._pace.took((end - first) << m, time.perf_counter() - began)
            first = end
            pause()

    def _take_in(self, halves: np.ndarray, pairs: list[np.ndarray]) -> None:
        """Take in the last of pairs of hits; all results change after the last pause."""
        paths = np.array([2 * hits.shape[2] for hits in pairs])
        shares = paths / paths.sum()
        a, b = 1 - shares[-1], shares[-1]
        direct = a * self._direct + b * 0.5 * (halves[0] + halves[1])
        pause()
        direct_variance = a * a * self._direct_variance + b * b * 0.25 * (halves[0] - halves[1]) ** 2
        pause()
        self._light(pairs, direct, direct_variance)
        if len(pairs) == self._most_pairs:
            self.end()

    def _light(self, pairs: list[np.ndarray], direct: np.ndarray, direct_variance: np.ndarray) -> None:
        """Light the hits of pairs from direct light and its variance (n, 3 G)."""
        paths = np.array([2 * hits.shape[2] for hits in pairs])
        shares = paths / paths.sum()
        E, sets = self._iterated(pairs, shares, direct)
        lamp_variance, variance = direct_variance, sum_of_lamps(direct_variance)
        for share, (one, other) in zip(shares, sets, strict=True):
            apart = np.zeros_like(E)
            apart[self._lit] = 0.5 * share * (one - other)
            lamp_variance = lamp_variance + apart**2
            variance += sum_of_lamps(apart) ** 2
            pause()
        self._direct, self._direct_variance = direct, direct_variance
        self._variance, self._lamp_variance = variance, lamp_variance
        self.per_lamp, self.mean, self.paths = E, sum_of_lamps(E), int(paths.sum())
        self._hits = pairs

    @property
    def by_delta(self) -> np.ndarray | None:
        """Light (n, 3 G) [W/m2] that comes straight from delta lights, without noise; None without any."""
        light = self._on_faces.receivers
        return light if len(light) else None

    def end(self) -> None:
        """Forget most hits: no pair follows."""
        self._hits, self.is_complete = self._hits[:3], True  # those of `bounces`

    @property
    def bounces(self) -> Bounces:
        """The first 112 bounces and direct light, to begin an edited scene with; none before the first pair."""
        m, deviation = self._model, np.sqrt(self._direct_variance)
        return Bounces(self._hits[:3], self._direct, deviation, m.emitters, m.static_rays_key)  # 20 MB in the classroom

    def _iterated(
        self, pairs: list[np.ndarray], shares: np.ndarray, direct: np.ndarray
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Iterate light at hits; return light (n, 3 G), and the bounced light (2, k, 3 G) of the sets of each pair."""
        E = np.where((self.per_lamp > 0).any(axis=1)[:, None], self.per_lamp, direct)
        for _ in range(40):  # albedos of 0.9 need 40
            reflected = self._reflected(E)
            pause()
            sets = [np.stack([self._mean_of(half, reflected) for half in hits]) for hits in pairs]
            before, E = E, direct.copy()
            for share, (one, other) in zip(shares, sets, strict=True):
                E[self._lit] += 0.5 * share * (one + other)
                pause()
            if self.weights @ np.abs(E - before).sum(axis=1) <= 0.002 * (self.weights @ E.sum(axis=1)):
                break
        return E, sets

    def _reflected(self, E: np.ndarray) -> np.ndarray:
        """Return the light (2 F, 3 G) float32 [W/m2] that the fronts and backs of F static faces reflect."""
        s, world = self._model.surfaces, self._model.world
        faces, by_delta = int(world.first_face[1]), self._on_faces
        out = np.empty((faces, 2, E.shape[1]), np.float32)

        def work(_, first, last):
            _reflect(world, s.corner_front, s.corner_back, E, by_delta.receivers, by_delta.reflected, first, last, out)

        run_ranges(work, faces, self._model.threads, COSTLY)
        return out.reshape(2 * faces, -1)

    def _mean_of(self, hits: np.ndarray, reflected: np.ndarray) -> np.ndarray:
        """Return the mean light (k, 3 G) of hits (k, P)."""
        out = np.empty((len(hits), reflected.shape[1]))
        at_once = max((1 << 21) // (hits.shape[1] * reflected.shape[1]), 1)  # 10 ms
        for k in range(0, len(hits), at_once):
            part, to = hits[k : k + at_once], out[k : k + at_once]

            def work(_, first, last, part=part, to=to):
                _mean(part, reflected, first, last, to)

            run_ranges(work, len(part), self._model.threads, max(at_once >> 3, 1))
            pause()
        return out

    def _gather(
        self,
        start: int,
        end: int,
        number: int,
        m: int,
        on_lamps: tuple[Candidates, Candidates],
        direct: np.ndarray,
        hits: np.ndarray,
    ) -> None:
        """Write direct light and hits of set `number` of 2^m paths at lit receivers start .. end - 1."""

        def work(_, first, last):
            at_once = max(1, BLOCK >> m)
            for a in range(start + first, start + last, at_once):
                b = min(a + at_once, start + last)
                rows = self._lit[a:b]
                direct[rows] = self._block(rows, number, m, on_lamps, hits[a:b].reshape(-1)) / (1 << m)

        run_ranges(work, end - start, self._model.threads, max(1, BLOCK >> (m + 2)))

    def _block(
        self, rows: np.ndarray, number: int, m: int, on_lamps: tuple[Candidates, Candidates], hits: np.ndarray
    ) -> np.ndarray:
        model, lights, world = self._model, self._lights, self._model.world
        n, count, at, far = len(rows), len(rows) << m, model.static, float(np.float32(FAR * world.size))
        start, total = [a[rows] for a in self._starts], np.zeros((n, lights.channels))
        path = (number * (1 << 40) + rows[:, None] << m) + np.arange(1 << m)  # 2^40: above any number of receivers
        by_delta = self._on_faces.receivers
        if len(by_delta):
            total += by_delta[rows] * (1 << m)
            lights = lights._replace(delta=lights.delta.none())
        pick = picks(self._seed, m, 0, path, lights.delta)
        ends = starts(rows, np.arange(n), *start)
        rays = join_lamps(world.bsdfs, on_lamps[0], pick, 1 << m, ends, lights, far)
        add_unblocked(model, at, rays, len(rays.row), total)
        bright, of_bright = self._on_faces.bright, self._on_faces.of_bright
        if len(bright.face):
            rays = rays_to_candidates(on_lamps[1], sets_by_chance(on_lamps[1], ends.path), 1 << m, ends, bright.lights)
            blocked = occluded_in_world(model.accelerator, at, rays.origin, rays.direction, rays.limit, rays.value)
            add_reflected(rays, blocked, of_bright / bright.lights.radiance[:, :1] / math.pi, total)
        each = (np.repeat(a, 1 << m, axis=0) for a in start)
        ends = starts(path.reshape(-1), np.repeat(np.arange(n), 1 << m), *each)
        origin, direction = np.empty((2, count, 3), np.float32)
        scatter(world.bsdfs, self._seed, m, 0, ends, origin, direction)
        of, frame = model.accelerator, (1 << m, np.arange(n + 1) << m, start[1], at.rotation[0], direction)
        hits[:] = -1
        ending = KeptHits(hits, Bright(bright.lights.of_face, bright.lights.density), of_bright)
        if of.has_panes:
            rays = nearest_past_panes(of, world, at, self._seed, 0, ends.path, origin, direction)
            bounces = BounceHits(*frame, rays.distance, rays.face).past_panes(rays.shares)
            arrive(world, at, lights.area, lights.sky, bounces, ending, total)
            self._move_to_open_sides(hits, rays.origin, rays.direction, rays.distance)
            _absorb(self._seed, ends.path, rays.shares, hits)
            return total
        limits = np.full(count, far, np.float32)
        met = BounceHits(*frame, *nearest_in_world(of, at, origin, direction, limits))
        arrive(world, at, lights.area, lights.sky, met, ending, total)
        self._move_to_open_sides(hits, origin, direction, met.distance)
        return total

    def _move_to_open_sides(self, hits: np.ndarray, origin, direction, distance) -> None:
        """Move hits (n,) on faces that go on under a wall to a side in the open, at the corner that is nearest.

        Receivers at its foot would read light of its other side. Rays: origin, direction (n, 3), distance (n,).
        """
        s, rows = self._model.surfaces, np.flatnonzero(hits >= 0)
        rows = rows[self._open_sides[hits[rows], 0] >= 0]
        places = origin[rows] + distance[rows, None] * direction[rows]
        away = s.vertices[0][s.faces[0][hits[rows] >> 1]] - places[:, None]
        hits[rows] = self._open_sides[hits[rows], (away * away).sum(axis=2).argmin(axis=1)]


@kernel
def _absorb(seed, path, shares, hits):
    """Drop hits (n,) by chance: a kept hit has no factor of its own for the panes on its way, shares (n, 4)."""
    for k in range(len(hits)):
        left = dot(REC709, row(shares, k))
        if random_numbers.independent(seed, path[k], 0, PASSAGE + 1) >= left:
            hits[k] = -1


@kernel
def _reflect(world, front, back, E, direct, reflected, first, last, out):
    """Write the light that faces first .. last - 1 reflect: rho times the mean E (n, 3 G) of their lit corners.

    A corner inside another part is black, and does not count (see BLACK). direct, reflected: see FaceLight, in place
    of corners' light by delta lights.
    """
    for f in range(first, last):
        for side in range(2):
            if side == 1 and not world.two_sided[f]:
                out[f, side] = 0.0
                continue
            corners, brightest, lit = front[f] if side == 0 else back[f], 0.0, 0
            for k in range(3):
                total = 0.0
                for c in range(E.shape[1]):
                    total += E[corners[k], c]
                brightest = max(brightest, total)
            for c in range(E.shape[1]):
                out[f, side, c] = 0.0
            for k in range(3):
                total = 0.0
                for c in range(E.shape[1]):
                    total += E[corners[k], c]
                if total > BLACK * brightest:
                    lit += 1
                    for c in range(E.shape[1]):
                        out[f, side, c] += E[corners[k], c] - (direct[corners[k], c] if len(direct) > 0 else 0.0)
            for c in range(E.shape[1]):
                out[f, side, c] *= world.bsdfs.albedo[f, c % 3] / max(lit, 1)
                if len(direct) > 0:
                    out[f, side, c] += reflected[2 * f + side, c]


@kernel
def _mean(hits, reflected, first, last, out):
    for i in range(first, last):
        for c in range(out.shape[1]):
            out[i, c] = 0.0
        for k in range(hits.shape[1]):
            if hits[i, k] >= 0:
                for c in range(out.shape[1]):
                    out[i, c] += reflected[hits[i, k], c]
        for c in range(out.shape[1]):
            out[i, c] /= hits.shape[1]
