"""Light on mobiles without photons: gathered from each of their receivers along paths of a single bounce.

Photons reach a small mobile rarely, so that its light is the noisiest of a frame. But what it sees is known: lamps,
which are joined to each receiver by shadow rays, and the static part, whose irradiance the frame has just found. A
path therefore ends where its first ray does, with rho E of that place (final gathering, Reichert 1992; Jensen 2001).
Where that is a mobile again, E is itself unknown: those few places make a linear system, solved by Jacobi's
method.

All receivers of a mobile use the same points on lamps (`light_sampling.aimed`), so that the errors of neighbours are
alike: a smooth surface shows nothing where it would show blotches from vertex to vertex. Of bounces there are a few
kinds, which hold in the mobile's own frame: each receiver follows one, and what they bring is averaged over neighbours
(`neighbour_mean`). So in E = direct + mean of (what bounces bring), direct is the light that shadow rays bring; all
that bounces meet is averaged alike, static part, mobiles, sky, and lamps with the share of them that is theirs. A
function of poses and of the static light alone, to the last bit: cached hits (`kept_rays`) equal those of an empty
cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.gather import one_bounce
from gi_core.gather.interleaved_mean import KINDS, beside, closeness, kinds, neighbour_mean
from gi_core.gather.kept_rays import BounceRays, ShadowRays
from gi_core.gather.one_bounce import Exchange
from gi_core.gather.path_tracer import SHADOW_GAP, PathEnds
from gi_core.gather.shared_samples import bounces, shared_directions
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.lights.light_sampling import Lights, aimed, area_lights, sky_of, small_lights, steady
from gi_core.lights.next_event import (
    LightSamples,
    Shadows,
    add_lit,
    join_area,
    join_small,
    light_samples,
    room_for_shadows,
)
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, ORIGIN_LIFT, Transforms
from gi_core.scene.pose import to_world_at

STREAM = 0x3B11  # keeps these random numbers apart from those of photons and reference with the same seed
RUN = 1 << 12  # paths of receivers that are worked on together: their arrays fit into a core's cache
KEPT = 1 << 19  # paths of which rays are kept, some 100 bytes each
SWEEPS = 32  # of Jacobi's method at most ...
SETTLED = 1e-3  # ... or until a sweep changes the sum of all by less than this share


class Run(NamedTuple):
    """Receivers of one mobile, and the rays that leave them."""

    mobile: int
    rows: slice  # among the receivers of mobiles
    directions: np.ndarray  # (n, 3) float32 unit, of bounces, object space
    bounce: BounceRays
    shadow: ShadowRays


class Gathered(NamedTuple):
    """What paths have brought to receivers, summed over them."""

    direct: np.ndarray  # (n, 3) float64, along shadow rays [W/m2]
    bounced: np.ndarray  # (n, 3) float64, along bounces, but for what they meet on mobiles
    close: np.ndarray  # (n,) float64 [1/m], of what bounces meet


class MobileGather:
    """Irradiance of the receivers of a model's mobiles. For one thread at a time."""

    def __init__(self, model: Model, seed: int):
        self._model, self._seed = model, (int(seed) ^ (STREAM << 40)) & (2**63 - 1)
        self.first = model.surfaces.receiver_range(0).stop  # the first receiver on a mobile
        positions, self._normals = (a[self.first :] for a in evaluation_points(model.surfaces, model.object_receivers))
        self._positions = positions + ORIGIN_LIFT * model.world.size * self._normals
        self._lights = Lights(area_lights(model.surfaces), small_lights(model.scene), sky_of(model.scene))
        self._aimed: dict[int, tuple[bytes, Lights]] = {}  # by mobile, where it was
        s = model.surfaces
        corners = np.concatenate([c[(c >= self.first).all(axis=1)] for c in (s.corner_front, s.corner_back)])
        self._beside = beside(positions, self._normals, corners - self.first)
        self._kinds = kinds(self._beside)
        self._directions: dict[int, np.ndarray] = {}  # by the logarithm of paths
        self._runs: dict[int, list[Run | None]] = {}  # by the logarithm of paths, what is kept

    def irradiance(self, at: Transforms, static: np.ndarray, log2_paths: int) -> np.ndarray:
        """Return irradiance (m, 3) float64 [W/m2] of the receivers on mobiles, from `first` on.

        static (>= first, 3) float64: irradiance of the static part's receivers at these poses; 2^log2_paths paths
        a receiver, 0 <= log2_paths <= strata.LARGEST.
        """
        m, n = log2_paths, len(self._positions)
        light = Gathered(*np.zeros((2, n, 3)), np.empty(n))
        if n == 0:
            return light.direct
        if m not in self._directions:
            self._directions[m] = shared_directions(self._seed, m, KINDS)
        lights = [self._lights_of(o, at) for o in range(1, len(at.position))]
        paths = np.arange(1 << m)[None]
        sampled = [(of, light_samples(self._seed, m, 0, paths, of)) for of in lights]
        places, kept = self._places(m), self._room(m)

        def work(_, first, last):
            found = []
            for k in order[first:last]:
                run = kept[k] or self._run(m, *places[k])
                known = Gathered(*(a[run.rows] for a in light))
                found.append(self._gather(run, at, *sampled[run.mobile - 1], static, m, known))
                if (n << m) <= KEPT:
                    kept[k] = run
            return found

        threads = self._model.threads
        order = [k for t in range(threads) for k in range(t, len(places), threads)]  # a mobile's runs: to all threads
        exchanges = [e for part in run_ranges(work, len(places), threads, 1) for e in part]
        exchange = Exchange(*(np.concatenate(a) for a in zip(*exchanges, strict=True)))
        direct = light.direct / (1 << m)
        bounced = _exchanged(direct, light.bounced / (1 << m), exchange, 1 << m)
        return direct + neighbour_mean(self._beside, light.close, 1 << m, bounced, threads)

    def _lights_of(self, o: int, at: Transforms) -> Lights:
        """Return the lights with the choice of lamps for mobile o at its pose."""
        world = self._model.world
        centre = to_world_at(at.rotation[o, None], at.position[o, None], world.sphere_centre[o, None])[0]
        radius = max(float(world.sphere_radius[o]), ORIGIN_LIFT * world.size)
        centre = steady(centre, radius)
        if self._aimed.get(o, (None,))[0] != centre.tobytes():
            lights = self._lights
            self._aimed[o] = centre.tobytes(), lights._replace(area=aimed(lights.area, centre, radius))
        return self._aimed[o][1]

    def _places(self, m: int) -> list[tuple[int, slice]]:
        """Return mobile and receivers of each run."""
        ends, step = self._model.surfaces.first_receiver[1:] - self.first, max(1, RUN >> m)
        return [
            (o, slice(a, min(a + step, int(last))))
            for o, (first, last) in enumerate(zip(ends[:-1], ends[1:], strict=True), 1)
            for a in range(int(first), int(last), step)
        ]

    def _room(self, m: int) -> list[Run | None]:
        """Return the runs that are kept of 2^m paths, None each at first; others give way where it becomes too much."""
        if m not in self._runs:
            if sum(len(self._positions) << k for k in (*self._runs, m)) > KEPT:
                self._runs.clear()
            self._runs[m] = [None] * len(self._places(m))
        return self._runs[m]

    def _run(self, m: int, mobile: int, rows: slice) -> Run:
        directions = np.empty(((rows.stop - rows.start) << m, 3), np.float32)
        bounces(self._directions[m], self._kinds[rows], self._normals[rows], directions)
        origins = np.repeat(self._positions[rows].astype(np.float32), 1 << m, axis=0)
        rays = BounceRays(self._model, mobile, origins, directions)
        return Run(mobile, rows, directions, rays, ShadowRays(self._model, mobile))

    def _gather(
        self, run: Run, at: Transforms, lights: Lights, samples: LightSamples, static, m, light: Gathered
    ) -> Exchange:
        """Gather at a run of receivers: add to `light` what is known, return what depends on mobiles."""
        world, s, area = self._model.world, self._model.surfaces, lights.area
        n, R, p = run.rows.stop - run.rows.start, at.rotation[run.mobile, None], at.position[run.mobile, None]
        positions = to_world_at(R, p, self._positions[run.rows])
        normals = to_world_at(R, 0 * p, self._normals[run.rows])
        far, gap = float(np.float32(FAR * world.size)), SHADOW_GAP * world.size

        def shadows() -> Shadows:
            small, rows = min(len(lights.small.kind), 1 << m), np.arange(n)
            rays = room_for_shadows((n << m) + n * small)
            ends = PathEnds(rows, rows, positions, normals, np.ones((n, 3)))
            count = join_area(samples, ends, area, gap, rays)
            count = join_small(samples, 1 << m, ends, lights.small, far, gap, count, rays)
            return Shadows(*(a[:count] for a in rays))

        rays, blocked = run.shadow.occluded(at, shadows)
        add_lit(rays.row, rays.value, blocked, light.direct)
        distance, face = run.bounce.nearest(at)
        closeness(1 << m, distance, light.close)
        count = len(face)
        out = Exchange(np.empty(count, np.int64), np.empty((count, 3), np.int64), *np.empty((2, count, 3)))
        met = one_bounce.meet(
            1 << m, positions, normals, R[0], run.directions, distance, face, world.normals, world.reflectance,
            world.two_sided, at.rotation, at.position, world.face_object, area.lamp, area.radiance, area.density,
            lights.sky, self._model.object_receivers.positions, s.corner_front, s.corner_back, static, self.first,
            run.rows.start, light.bounced, out,
        )  # fmt: skip
        return Exchange(*(a[:met].copy() for a in out))


def _exchanged(direct: np.ndarray, known: np.ndarray, exchange: Exchange, paths: int) -> np.ndarray:
    """Solve bounced = known + (what paths bring from mobiles, of direct + bounced) for bounced (n, 3)."""
    bounced = known
    for _ in range(SWEEPS):
        before, bounced = bounced, known.copy()
        _sweep(exchange, 1.0 / paths, direct + before, bounced)
        if np.abs(bounced - before).sum() <= SETTLED * (direct + bounced).sum():
            break
    return bounced


@kernel
def _sweep(exchange, share, E, bounced):
    row, corners, shares, rho = exchange
    for k in range(len(row)):
        for c in range(3):
            there = 0.0
            for v in range(3):
                there += shares[k, v] * E[corners[k, v], c]
            bounced[row[k], c] += share * rho[k, c] * there
