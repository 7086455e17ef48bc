"""Final gathering of the light on mobiles (Reichert 1992; Jensen 2001): shadow rays and one bounce per path.

Photons rarely reach a small mobile, so its photon estimate is the noisiest of a frame. Its surroundings are known:
lamps, and the irradiance of the static part in this frame. A bounce therefore ends at its first hit with rho E of that
place. Where it hits a mobile, E is unknown: these few hits form a linear system, solved by Jacobi's method. Bright
places of the static part get rays of their own (`candidates.py`).

All receivers of a mobile choose among the same points on lamps (`area.aimed`, `gather/candidates.py`), so
errors of neighbours are correlated and invisible on a smooth surface. Bounces come in a few kinds, fixed in the
mobile's object space. Each receiver traces one kind, and bounced light is averaged over neighbours
(`interleaved_mean.py`). So E = direct + mean of bounced: `direct` comes from shadow rays, `bounced` from hits on static
part, mobiles, sky and (weighted) lamps.

The result is a function of poses and static light alone, bit for bit: cached hits (`hit_cache.py`) equal new ones.
"""

from __future__ import annotations

import itertools
import operator
import threading
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import Stream, seed_of
from gi_core.base.threads import run_ranges
from gi_core.gather import path_ends
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
    relative_light,
)
from gi_core.gather.hit_cache import BounceRays, ShadowRays
from gi_core.gather.interleaved_mean import (
    KINDS,
    average_neighbours,
    bounce_shares,
    bounces,
    closeness,
    kinds,
    near_receivers,
    shared_directions,
)
from gi_core.gather.mobile_gloss import BouncedLight, DirectLight, PathLight, direct_light, for_cells
from gi_core.gather.path_ends import Bright, Exchange, OneBounce, add_exchanged, reached_corners, reflected, starts
from gi_core.geometry.surfaces import glossy_receivers
from gi_core.gloss.sharp import is_sharp
from gi_core.lights.area import aimed
from gi_core.lights.lamps import Lights
from gi_core.lights.next_event import add_lit, picks
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, LIFT, Transforms
from gi_core.rays.all_objects import World
from gi_core.scene.pose import to_world_at

CACHED_PATHS = 1 << 19  # paths with cached rays, some 100 bytes each
RAYS_AHEAD = 1 << 11  # bounces per call of rays_ahead(): a quarter of a millisecond


class ReceiverBatch(NamedTuple):
    """A batch of receivers of one mobile, and their rays."""

    mobile: int
    rows: slice  # index among the receivers of mobiles
    first: np.ndarray  # (n + 1,) int64: bounces first[i] to first[i + 1] are those of receiver i
    directions: np.ndarray  # (k, 3) float32 unit, of bounces, object space
    bounce: BounceRays
    shadow: ShadowRays
    to_bright: ShadowRays


def steady(centre: np.ndarray, radius: float) -> np.ndarray:
    """Return the centre of the grid cell, one radius wide, that contains a position (3,) [m].

    Flicker is the difference of a frame from the mean of its two neighbours. With 8 paths per receiver it is 2.7 % in
    gallery (6.3 % without the grid, 2.3 % with very many paths), and 4.4 % in living_room (5.6 %, 2.6 %).
    """
    return radius * np.round(centre / radius)


class LampSamples(NamedTuple):
    """Lights and bright faces, and where on them the rays of all receivers of a mobile end."""

    lights: Lights
    candidates: Candidates  # on area lights
    picks: np.ndarray  # of delta lights, see `next_event.picks`
    bright: BrightFaces
    on_bright: Candidates  # a set per kind of bounces
    relative: np.ndarray  # (A, 3), see relative_light()


class PathSums(NamedTuple):
    """Sums over paths at n receivers."""

    direct: np.ndarray  # (n, 3) float64 [W/m2], from shadow rays
    bounced: np.ndarray  # (n, 3) float64 [W/m2], from bounces, without hits on mobiles
    close: np.ndarray  # (n,) float64 [1/m], closeness() of the bounces


class MobileGather:
    """Irradiance of the receivers of a model's mobiles. Not thread safe."""

    def __init__(self, model: Model, seed: int):
        self._model, self._seed = model, seed_of(Stream.MOBILES, seed)
        self.first = model.surfaces.receiver_range(0).stop  # the first receiver on a mobile
        self._positions, self._normals = (a[self.first :] for a in model.evaluation_points)
        s = model.surfaces
        self._faces = StaticFaces.of(s)
        # Lights, static light at rest and reflectance of the last call, and the luminance of `_faces` by these.
        self._light: tuple[Lights | None, np.ndarray | None, np.ndarray | None] = None, None, None
        self._luminance = np.zeros(len(self._faces.face))
        self._aimed: dict[int, tuple[bytes, Lights, BrightFaces]] = {}  # by mobile: cell of its position, lights there
        corners = np.concatenate([c[(c >= self.first).all(axis=1)] for c in (s.corner_front, s.corner_back)])
        self._near = near_receivers(self._positions, self._normals, corners - self.first)
        self._kinds = kinds(self._near)
        self._directions: dict[int, np.ndarray] = {}  # by number of bounces
        self._batches: dict[int, list[ReceiverBatch | None]] = {}  # by number of paths
        glossy = glossy_receivers(s, besides=is_sharp(s))
        self._glossy = np.unique(s.object_of(glossy[glossy >= self.first]))
        self._shares = self._bounce_shares()
        self.path_light: PathLight | None = None  # of the last call, until the next; None without glossy mobiles

    def irradiance(
        self, at: Transforms, static: np.ndarray, paths: int, reflectance: np.ndarray | None = None,
        lights: Lights | None = None, resting: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return irradiance (m, 3) float64 [W/m2] of the receivers on mobiles, from `first` on.

        static (>= first, 3) float64 [W/m2]: irradiance of the static receivers at these poses. paths: per receiver, at
        least 1, of bounces on average. reflectance (F, 3) float64 of all faces, None: their albedo.
        lights: of one lamp; None: those of the last call, at first those of the scene file. resting (>= first, 3)
        [W/m2]: static irradiance without mobiles, by which faces are bright; None: none is.
        """
        n, world = len(self._positions), self._model.world
        if reflectance is not None:
            world = world._replace(bsdfs=world.bsdfs._replace(albedo=reflectance))
        self._light_by(lights, resting, world.bsdfs.albedo)
        light = PathSums(*np.zeros((2, n, 3)), np.empty(n))
        if n == 0:
            return light.direct
        counts = self._bounces(paths)
        for count in {paths, *np.unique(counts).tolist()} - set(self._directions):
            self._directions[count] = shared_directions(self._seed, count, KINDS)
        by_path = np.empty((n if len(self._glossy) else 0, 3, paths), np.float32)  # see PathLight
        exchange, lit = self._gather_batches(world, at, static, paths, light, by_path)
        direct, bounced = light.direct / paths, light.bounced / paths
        reached_corners(exchange.corners, direct + bounced, exchange.share)
        E = _exchanged(direct, bounced, exchange, paths)
        if len(self._glossy):
            add_exchanged(exchange, direct + E, by_path)
            directions = np.ascontiguousarray(self._directions[paths].transpose(0, 2, 1), np.float32)
            light_by_path = BouncedLight(self._normals, self._near, self._kinds, directions, light.close, by_path)
            self.path_light = PathLight(light_by_path, lit)
        return direct + average_neighbours(self._near, light.close, counts, E, self._model.threads)

    def rays_ahead(self, at: Transforms, paths: int) -> list[Callable[[], None]]:
        """Return calls that trace bounces of the next irradiance() at these poses, before its light is known.

        Only batches are traced that are cached and have moved.
        """
        batches = (batch.bounce for batch in self._batches.get(paths, ()) if batch is not None)
        parts = ((rays, range(0, rays.left(at), RAYS_AHEAD)) for rays in batches)
        return [partial(rays.trace, at, min(RAYS_AHEAD, part.stop - k)) for rays, part in parts for k in part]

    @property
    def _rows(self) -> list[tuple[int, int]]:
        """First and last receivers of each mobile, among those of mobiles."""
        return list(itertools.pairwise((self._model.surfaces.first_receiver[1:] - self.first).tolist()))

    def _bounce_shares(self) -> np.ndarray:
        """Return bounce_shares() (n,) of the receivers of each mobile; 1 on glossy ones, whose cells take P bounces."""
        areas, out = self._model.object_receivers.areas[self.first :], np.ones(len(self._positions))
        for o, (first, last) in enumerate(self._rows, 1):
            if last > first and o not in self._glossy:
                out[first:last] = bounce_shares(areas[first:last])
        return out

    def _bounces(self, paths: int) -> np.ndarray:
        """Return the bounces (n,) int64 of each receiver."""
        return np.maximum(np.rint(paths * self._shares), 1.0).astype(np.int64)

    def _light_by(self, lights: Lights | None, resting: np.ndarray | None, reflectance: np.ndarray) -> None:
        """Use this light from now on; arguments as for irradiance()."""
        lights = lights or self._light[0] or self._model.lights_at(self._model.emitters.lamps.full())
        light = lights, resting, reflectance
        if all(map(operator.is_, light, self._light)):
            return
        self._light, dark = light, np.zeros(len(self._faces.face))
        self._luminance = dark if resting is None else self._faces.luminance(resting, reflectance)
        self._aimed.clear()
        for batch in itertools.chain.from_iterable(self._batches.values()):
            if batch is not None:
                batch.shadow.forget()
                batch.to_bright.forget()

    def _lights_of(self, o: int, at: Transforms) -> tuple[Lights, BrightFaces]:
        """Return the lights with area lights sampled by importance for mobile o at its pose, and its bright faces."""
        world = self._model.world
        centre = to_world_at(at.rotation[o, None], at.position[o, None], world.sphere_centre[o, None])[0]
        radius = max(float(world.sphere_radius[o]), LIFT * float(np.abs(centre).max()), 1e-9)
        centre = steady(centre, radius)
        cell, lights = centre.tobytes(), self._light[0]
        if self._aimed.get(o, (None,))[0] != cell:
            view = self._faces.view(centre, radius)
            bright = self._faces.bright(self._luminance, view, len(world.face_object))
            self._aimed[o] = cell, lights._replace(area=aimed(lights.area, centre, radius)), bright
        return self._aimed[o][1:]

    def _lamps(self, world: World, o: int, at: Transforms, static: np.ndarray, paths: int) -> LampSamples:
        """Return where the paths of each receiver of mobile o look for lamps and bright faces."""
        (lights, bright), every = self._lights_of(o, at), np.arange(paths)[None]
        on_lamps, m = candidates(self._seed, paths, lights.area), (paths - 1).bit_length()
        rays = max(paths // BOUNCES_PER_BRIGHT, 1)
        on_bright = candidates(seed_of(Stream.BRIGHT_FACES, self._seed), PATHS_PER_SHADOW * rays, bright.lights, KINDS)
        corners, albedo = self._model.surfaces.corner_front, world.bsdfs.albedo
        relative = relative_light(bright.face, bright.lights.radiance, corners, albedo, static)
        pick = picks(self._seed, m, 0, every, lights.delta)
        return LampSamples(lights, on_lamps, pick, bright, on_bright, relative)

    def _places(self, paths: int) -> list[tuple[int, slice]]:
        """Return mobile and receivers of each batch, of the mobiles in turn."""
        before, of = np.concatenate([[0], np.cumsum(self._bounces(paths))]), []
        for o, (first, last) in enumerate(self._rows, 1):
            count = int(before[last] - before[first])
            # Each thread has as many batches. Batches of 2^12 paths take a tenth more time, those of 2^14 no less.
            parts = -(-count // ((1 << 13) * self._model.threads)) * self._model.threads
            parts = min(parts, -(-count // (1 << 11)))  # where there are more threads than batches
            bounds = np.searchsorted(before, before[first] + count * np.arange(parts + 1) // max(parts, 1)).tolist()
            of.append([(o, slice(*bound)) for bound in itertools.pairwise(bounds)])
        return [place for turn in itertools.zip_longest(*of) for place in turn if place is not None]

    def _room(self, paths: int) -> list[ReceiverBatch | None]:
        """Return the cached batches of so many paths, None at first; beyond CACHED_PATHS others are evicted."""
        if paths not in self._batches:
            if len(self._positions) * sum((*self._batches, paths)) > CACHED_PATHS:
                self._batches.clear()
            self._batches[paths] = [None] * len(self._places(paths))
        return self._batches[paths]

    def _batch(self, paths: int, mobile: int, rows: slice) -> ReceiverBatch:
        of_all = self._bounces(paths)
        counts, before = of_all[rows], int(of_all[: rows.start].sum())
        first = np.concatenate([[0], np.cumsum(counts)])
        directions = np.empty((first[-1], 3), np.float32)
        for count in np.unique(counts).tolist():
            bounces(self._directions[count], self._kinds[rows], self._normals[rows], first, directions)
        positions, normals = self._positions[rows], self._normals[rows]
        lift = LIFT * np.abs(positions).max(axis=1, keepdims=True, initial=0.0)
        origins = np.repeat((positions + lift * normals).astype(np.float32), counts, axis=0)
        rays, shadows = (
            BounceRays(self._model, mobile, origins, directions, before),
            partial(ShadowRays, self._model, mobile),
        )
        return ReceiverBatch(mobile, rows, first, directions, rays, shadows(), shadows())

    def _gather_batches(
        self, world: World, at: Transforms, static: np.ndarray, paths: int, light: PathSums, bounced: np.ndarray
    ) -> tuple[Exchange, list[DirectLight]]:
        """Gather at all batches, on all threads; results as for _gather()."""
        places, kept = self._places(paths), self._room(paths)
        in_world = np.empty((2, len(self._positions), 3))  # positions [m] and normals of receivers
        lamps: dict[int, LampSamples] = {}
        looking = [threading.Lock() for _ in self._model.names]
        results: list = [None] * len(places)
        waiting = iter(range(len(places)))

        def look(o: int) -> LampSamples:
            with looking[o - 1]:  # the first thread at a mobile looks for its lamps
                if o not in lamps:
                    R, p, own = at.rotation[o, None], at.position[o, None], slice(*self._rows[o - 1])
                    in_world[0, own] = to_world_at(R, p, self._positions[own])
                    in_world[1, own] = to_world_at(R, 0 * p, self._normals[own])
                    lamps[o] = self._lamps(world, o, at, static, paths)
                return lamps[o]

        def work(*_):
            for k in waiting:  # each thread takes the next batch, as they take different times
                batch = kept[k] or self._batch(paths, *places[k])
                samples, sums = look(batch.mobile), PathSums(*(a[batch.rows] for a in light))
                place = in_world[:, batch.rows]
                results[k] = self._gather(world, batch, at, samples, place, static, paths, sums, bounced)
                if len(self._positions) * paths <= CACHED_PATHS:
                    kept[k] = batch

        run_ranges(work, len(places), self._model.threads, 1)
        exchanges, lit = zip(*results, strict=True)
        hits = Exchange(*(np.concatenate(a) for a in zip(*exchanges, strict=True)))
        return hits, [d for d in lit if d is not None]

    def _gather(
        self, world: World, batch: ReceiverBatch, at: Transforms, lamps: LampSamples, places: np.ndarray, static, paths,
        light: PathSums, bounced: np.ndarray,
    ) -> tuple[Exchange, DirectLight | None]:  # fmt: skip
        """Gather at a batch of receivers: add known light to `light`, return the hits on mobiles.

        places (2, n, 3): their positions and normals in the world. Of a glossy mobile, write `bounced`, as in
        PathLight, and return the direct light too.
        """
        s, (lights, every, pick, bright, on_bright, relative) = self._model.surfaces, lamps
        (positions, normals), n, R = places, places.shape[1], at.rotation[batch.mobile]
        far = float(np.float32(FAR * world.size))

        ends = starts(np.arange(n), np.arange(n), positions, normals)
        to_lamps = every, pick, paths, ends, lights, far
        rays, blocked = batch.shadow.occluded(at, lambda: join_lamps(world.bsdfs, *to_lamps))
        add_lit(rays.row, rays.value, rays.lamp, blocked, light.direct)
        if len(bright.face):
            kind = self._kinds[batch.rows].astype(np.uint64)
            to_bright = on_bright, kind, paths, ends, bright.lights
            of_bright = batch.to_bright.occluded(at, lambda: rays_to_candidates(*to_bright))
            add_reflected(*of_bright, relative, light.bounced)
        directions, has_panes = batch.directions, self._model.accelerator.has_panes
        if has_panes:
            distance, face, shares, directions = batch.bounce.past_panes(at, self._seed)
        else:
            distance, face = batch.bounce.nearest(at)
        closeness(batch.first, distance, light.close)
        glossy, start = batch.mobile in self._glossy, batch.rows.start
        by_ray = bounced[batch.rows if glossy else slice(0)]
        by_ray[:] = 0.0
        exchange = Exchange.of(int(np.count_nonzero(face >= world.first_face[1])))
        on_faces = Bright(bright.lights.of_face, bright.lights.density)
        ending = OneBounce(s.corner_front, s.corner_back, static, on_faces, by_ray, exchange, start, self.first)
        bounces = path_ends.BounceHits(paths, batch.first, normals, R, directions, distance, face)
        bounces = bounces.past_panes(shares) if has_panes else bounces
        met = path_ends.arrive(world, at, lights.area, lights.sky, bounces, ending, light.bounced)
        hits = Exchange(*(a[:met].copy() for a in exchange))
        if not glossy:
            return hits, None
        return hits, direct_light(batch.rows, R, positions, lights.area, for_cells(every), rays, blocked)


def _exchanged(direct: np.ndarray, single: np.ndarray, exchange: Exchange, paths: int) -> np.ndarray:
    """Solve bounced = single + exchange (direct + bounced) for bounced (n, 3)."""
    bounced = single
    for _ in range(32):  # of Jacobi's method
        before, bounced = bounced, single.copy()
        _sweep(exchange, paths, direct + before, bounced)
        if np.abs(bounced - before).sum() <= 1e-3 * (direct + bounced).sum():
            break
    return bounced


@kernel
def _sweep(exchange, paths, E, bounced):
    for k in range(len(exchange.row)):
        row, light = exchange.row[k], reflected(exchange, k, E)
        for c in range(3):
            bounced[row, c] += light[c] / paths
