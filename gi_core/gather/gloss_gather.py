"""Directions of light at glossy receivers by paths: the cells of `gi_core.gloss.cells` without photons' noise and blur.

A receiver sends the same number of rays through each of its cells, spread evenly over the cell's solid angle. A ray
ends in the light that frames know at its first diffuse hit; glossy surfaces scatter it on by their own law. Lamps are
sampled besides, and both ways are weighted by the balance heuristic (Veach 1997), as for irradiance.
"""

from __future__ import annotations

import copy
import math
import time

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.pause import STEP, Pace, Progress, pause
from gi_core.base.random_numbers import Stream, basis, seed_of
from gi_core.base.results import KEPT
from gi_core.base.threads import run_ranges
from gi_core.base.vec import rotate, rotate_back, weighted
from gi_core.gather.path_ends import InKnownLight, in_known_light, starts
from gi_core.gather.path_tracer import SCATTER_U, SCATTER_V, PathTracer
from gi_core.gather.pose_gather import key_of
from gi_core.gloss.discs import GlossDiscs
from gi_core.gloss.hemisphere import CELLS, GRAZING, SIDE, SUMS, add_ray, axes_of, cell_towards, direction_of, weight_of
from gi_core.lights.lamps import Lights
from gi_core.lights.next_event import MOST_DELTA, join_area, join_delta, picks, points_on_lamps, room_for_shadows
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, Transforms
from gi_core.rays.all_objects import occluded_in_world
from gi_core.scene.pose import to_world_at

STAGE = "gathering gloss"
LOG2_RAYS = 8  # of a receiver and round: four per cell
RAYS = 1 << LOG2_RAYS
ROUNDS_AT_POSES = 8
RECEIVERS_PER_CALL = 16  # 4,096 rays


class GlossGather:
    """Directional light at n glossy receivers at one set of poses.

    rows (n,) int64, ascending: receivers. mean (n, CELLS, SUMS) float64: per cell its irradiance (3) [W/m2], and its
    weight times direction (3) in the object's space, and weight, as in GlossCells. rounds: complete ones, of `most`.
    """

    def __init__(self, model: Model, seed: int, rows: np.ndarray, at: Transforms, lights: Lights, ending: InKnownLight):
        """lights: of one lamp; ending: in the light of all objects at the poses `at`."""
        self.rows, self.rounds, self.mean = rows, 0, np.zeros((len(rows), CELLS, SUMS))
        self._tracer = PathTracer(model, at, lights, seed_of(Stream.GLOSS, seed), LOG2_RAYS, ending)
        receivers = model.object_receivers
        # Light of the static part without mobiles is then averaged over discs, that on mobiles is not.
        self.most = 4 if len(at.position) == 1 else ROUNDS_AT_POSES
        self._pace = Pace(5e-4, 8, 1 << 10)
        self._object = model.surfaces.object_of(rows)
        self._normals = receivers.normals[rows]
        points, normals = (a[rows] for a in model.evaluation_points)
        R, p = at.rotation[self._object], at.position[self._object]
        self._points = to_world_at(R, p, points)
        self._up = to_world_at(R, 0 * p, normals)  # 0: black

    def copied(self, model: Model) -> GlossGather:
        """Return a copy that goes on from here; model: of the same static part and lamps, for light without mobiles."""
        other = copy.copy(self)
        other._tracer = self._tracer._replace(model=model)
        return other

    @property
    def enough(self) -> bool:
        """Whether gathering has ended."""
        return self.rounds >= self.most or not len(self.rows)

    def progress(self, picture: bool) -> Progress:
        """Return the progress of gathering."""
        return Progress(STAGE, self.rounds / self.most, picture)

    def add_round(self) -> None:
        """Gather the next round, with a pause every 10 ms; `mean` is then a new array.

        A round that is broken off is gathered again.
        """
        light, first = np.empty_like(self.mean), 0
        while first < len(self.rows):
            began, last = time.perf_counter(), min(first + self._pace.fit(STEP), len(self.rows))

            def work(_, a, b, first=first):
                for i in range(first + a, first + b, RECEIVERS_PER_CALL):
                    part = slice(i, min(i + RECEIVERS_PER_CALL, first + b))
                    light[part] = self._round(part)

            run_ranges(work, last - first, self._tracer.model.threads, 4)
            self._pace.took(last - first, time.perf_counter() - began)
            first = last
            pause(self.progress(picture=False))
        self.mean = (self.mean * self.rounds + light) / (self.rounds + 1)
        self.rounds += 1

    def _round(self, part: slice) -> np.ndarray:
        """Return the light (k, CELLS, SUMS) of the next round at some receivers."""
        model, at, lights, seed, *_ = self._tracer
        world, k, far = model.world, part.stop - part.start, float(np.float32(FAR * model.world.size))
        own = self._normals[part], at.rotation[self._object[part]]
        number = (self.rows[part] * ROUNDS_AT_POSES + self.rounds)[:, None] * RAYS
        path = number + np.arange(RAYS)
        out, rays = np.zeros((k, CELLS, SUMS)), room_for_shadows(k * RAYS)

        # Join the receivers with lamps: a point on an area light per ray, and every delta light once.
        ends = starts(path.reshape(-1), *(np.repeat(a, RAYS, axis=0) for a in self._starts(part)))
        if len(lights.area.cdf):
            points = points_on_lamps(seed, LOG2_RAYS, 0, path.reshape(-1, 1), lights.area)
            self._join(rays, join_area(world.bsdfs, points, ends, lights.area, rays), 1 / RAYS, own, out)
        if delta := min(len(lights.delta.kind), MOST_DELTA):
            pick = picks(seed, 0, 0, path[:, :delta], lights.delta)
            few, room = starts(path[:, 0].copy(), *self._starts(part)), room_for_shadows(k * delta)
            n = join_delta(world.bsdfs, pick, delta, few, lights.delta, far, 0, room, 1)
            self._join(room, n, 1 / delta, own, out)

        # Send rays through the cells, and on from glossy surfaces.
        total, direction = np.zeros((k * RAYS, 3)), np.empty((k * RAYS, 3), np.float32)
        _aim(seed, ends, *own, direction)
        self._tracer.follow(ends, total, direction)
        rows, seen = np.repeat(np.arange(k), RAYS), np.zeros(k * RAYS, bool)
        _deposit(rows, direction, total, seen, CELLS / RAYS, *own, out)
        return out

    def _starts(self, part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.arange(part.stop - part.start), self._points[part], self._up[part]

    def _join(self, rays, n: int, share: float, own, out: np.ndarray) -> None:
        """Add the light of the first n shadow rays that are not blocked, `share` of it, to cells."""
        if n:
            of, at = self._tracer.model.accelerator, self._tracer.at
            blocked = occluded_in_world(of, at, rays.origin[:n], rays.direction[:n], rays.limit[:n], rays.value[:n])
            _deposit(rays.row, rays.direction, rays.value, blocked, share, *own, out)


class GlossGathers:
    """Directional light of the static part without mobiles, and at the last KEPT poses, at levels of the lamps.

    It belongs to the discs of some cells. Other discs start an empty one.
    """

    def __init__(self, model: Model, seed: int):
        self._model, self._seed = model, seed
        self._kept: dict[bytes, tuple[GlossDiscs, GlossGather]] = {}

    def find(self, discs: GlossDiscs, at: Transforms, levels: np.ndarray) -> GlossGather | None:
        """Return the light at poses and levels (G, 3) once it has a result, None before."""
        of, gather = self._kept.get(key_of(at, levels), (None, None))
        return gather if of is discs and gather is not None and (gather.rounds or gather.enough) else None

    def begin_with(self, light: GlossGather, discs: GlossDiscs, levels: np.ndarray) -> None:
        """Keep light of the static part without mobiles, at levels (G, 3) of the lamps."""
        self._kept[key_of(self._model.static, levels)] = discs, light

    def begin(
        self, discs: GlossDiscs, at: Transforms, levels: np.ndarray, rows: np.ndarray, irradiance: np.ndarray,
        disc_area: float,
    ) -> GlossGather:  # fmt: skip
        """Return the light at poses and levels, begun now if necessary, at receivers rows (n,) int64, ascending.

        irradiance: of the objects in `at` [W/m2]; disc_area [m2]: of the frame's estimator, see in_known_light().
        """
        of, gather = self._kept.pop(key := key_of(at, levels), (None, None))
        if of is not discs or gather is None:
            lights, ending = self._model.lights_at(levels), in_known_light(self._model, at, irradiance, disc_area)
            gather = GlossGather(self._model, self._seed, rows, at, lights, ending)
        self._kept = dict([*self._kept.items(), (key, (discs, gather))][-KEPT - 1 :])
        return gather


@kernel
def _aim(seed, ends, normals, rotations, direction):
    """Write the rays of receivers through their cells; ends: RAYS paths per receiver, with their throughput set."""
    along = int(math.sqrt(RAYS // CELLS))  # rays along a side of a cell
    solid = 2.0 * math.pi / CELLS
    for j in range(len(ends.path)):
        i, k = ends.row[j], j % RAYS
        cell, part = k // (RAYS // CELLS), k % (RAYS // CELLS)
        u = random_numbers.stratified(seed, ends.path[j], 0, SCATTER_U, 0)
        v = random_numbers.stratified(seed, ends.path[j], 0, SCATTER_V, 0)
        a = 2.0 * (cell // SIDE + (part // along + u) / along) / SIDE - 1.0
        b = 2.0 * (cell % SIDE + (part % along + v) / along) / SIDE - 1.0
        n = normals[i]
        ax, ay, az, bx, by, bz = basis(n[0], n[1], n[2])
        x, y, z = direction_of(a, b)
        d = rotate(rotations[i], weighted((x, y, z), (ax, ay, az), (bx, by, bz), n))
        direction[j, 0], direction[j, 1], direction[j, 2] = d[0], d[1], d[2]
        ends.row[j] = j
        for c in range(3):
            ends.throughput[j, c] = z * solid / math.pi  # the mean of pi L over the rays of a cell is its irradiance


@kernel
def _deposit(rows, direction, value, blocked, share, normals, rotations, out):
    """Add `share` of the light of rays that are not blocked to cells (k, CELLS, SUMS).

    rows (n,): receivers; direction, value (n, 3), directions in the world; normals (k, 3) and rotations (k, 3, 3).
    """
    for j in range(len(blocked)):
        if blocked[j]:
            continue
        i, light = rows[j], (share * value[j, 0], share * value[j, 1], share * value[j, 2])
        x, y, z = d = rotate_back(rotations[i], direction[j])
        cell, cosine = cell_towards(axes_of(normals[i]), d)
        weight = weight_of(share * (value[j, 0] + value[j, 1] + value[j, 2]), cosine, GRAZING)
        add_ray(out[i, cell], light, (weight * x, weight * y, weight * z), weight)
