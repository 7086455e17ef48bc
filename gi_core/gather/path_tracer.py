"""Path tracing: next-event estimation and a cosine-sampled bounce per vertex, until the rule for the end says so.

Emissive faces are found both ways, with weights of the balance heuristic (Veach 1997). The rules are those of
`path_ends.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.base.vec import row
from gi_core.bsdf import lambertian, surface
from gi_core.gather.path_ends import WHOLE, InKnownLight, PathEnds, PathHits, arrive, starts
from gi_core.lights.lamps import Lights
from gi_core.lights.next_event import (
    Shadows,
    add_lit,
    join_area,
    join_delta,
    lifted,
    picks,
    points_on_lamps,
    room_for_shadows,
)
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, Transforms
from gi_core.rays.all_objects import nearest_in_world, nearest_past_panes, occluded_in_world

BLOCK = 1 << 14  # paths per batch: their arrays fit into a core's cache, and Embree needs 10,000 rays or more

# Dimensions after those of path_ends.py; scattering needs a pair.
SCATTER_PART, SCATTER_U, SCATTER_V = range(5, 8)


class ByBounce(NamedTuple):
    """Light of paths apart by the number of its bounces, and the face that each path meets first; added to."""

    light: np.ndarray  # (B, rows, 3 G) float64 [W/m2]: straight from lamps, bounced once, ..., B - 1 times or more
    face: np.ndarray  # (rows,) int32, global; -1: none
    # Takes rows (n,) and positions (n, 3) [m] of the paths that go on, per vertex; None: not asked for
    places: list[tuple[np.ndarray, np.ndarray]] | None = None

    def part(self, rows: slice) -> ByBounce:
        """Return a view of some rows."""
        return ByBounce(self.light[:, rows], self.face[rows], self.places)


class PathTracer(NamedTuple):
    """What paths have in common."""

    model: Model
    at: Transforms
    lights: Lights
    seed: int
    m: int = 0  # log2 of the paths of a set, see stratified()
    ending: InKnownLight = WHOLE  # not WHOLE: lights are of one lamp
    bounced: bool = False  # light straight from lamps to the starts is left out

    def follow(
        self, ends: PathEnds, total: np.ndarray, first: np.ndarray | None = None, apart: ByBounce | None = None
    ) -> None:
        """Trace a batch of paths to their ends, adding to total (rows, 3 G) [W/m2]; overwrites `ends`.

        first (n, 3) float32 unit: directions of the first rays, whose starts are not joined with lights; None: sample.
        apart: of a batch with a row per path; added to in place of total.
        """
        model, vertex, n = self.model, 0, len(ends.path)
        rays = room_for_shadows(n * (1 + self.lights.delta.suns))
        while n:
            if apart is not None and apart.places is not None:
                apart.places.append((ends.row.copy(), ends.position.copy()))
            if apart is not None:
                total = apart.light[min(vertex, len(apart.light) - 1)]
            origin, direction = rays.origin[:n], rays.direction[:n]
            if first is None or vertex:
                if vertex or not self.bounced:
                    self.join_lights(vertex, ends, rays, total)
                scatter(model.world.bsdfs, self.seed, self.m, vertex, ends, origin, direction)
            else:
                origin[:], direction[:] = ends.position + ends.lift[:, None] * ends.normal, first
            hits = self.hits(vertex, ends, origin, direction)
            if apart is not None and not vertex:
                apart.face[:] = hits[1]
            arrivals = PathHits(ends, self.seed, self.m, vertex, direction, *hits)
            area = self.lights.area
            if self.bounced and not vertex:
                area = area._replace(radiance=np.zeros_like(area.radiance))
            n = arrive(model.world, self.at, area, self.lights.sky, arrivals, self.ending, total)
            ends = PathEnds(*(a[:n] for a in ends))
            vertex += 1

    def hits(self, vertex: int, ends: PathEnds, origin, direction) -> tuple[np.ndarray, np.ndarray]:
        """Return distances (n,) [m] and faces (n,) of rays from the vertices; panes change throughput and vertices."""
        of, world = self.model.accelerator, self.model.world
        if not of.has_panes:
            limits = np.full(len(origin), FAR * world.size, np.float32)
            return nearest_in_world(of, self.at, origin, direction, limits)
        rays = nearest_past_panes(of, world, self.at, self.seed, vertex, ends.path, origin, direction)
        ends.throughput[:] *= rays.shares[:, :3]
        turned = np.flatnonzero(rays.shares[:, 3])
        ends.position[turned], ends.lift[turned] = origin[turned], 0.0
        ends.face[turned], ends.density[turned] = 0, -1.0  # as a mirror
        return rays.distance, rays.face

    def join_lights(self, vertex: int, ends: PathEnds, rays: Shadows, total: np.ndarray) -> None:
        """Add next-event estimates of path vertices to `total` (rows, 3 G): one area light and one delta light each.

        `rays` is a buffer with a row per end, and one more per directional light, overwritten.
        """
        model, lights, seed, m = self.model, self.lights, self.seed, self.m
        bsdfs, far = model.world.bsdfs, float(np.float32(FAR * model.world.size))
        path = ends.path[:, None]
        if len(lights.delta.kind):
            pick = picks(seed, m, vertex, path, lights.delta)
            together = 1 << m if vertex == 0 else 1  # a set of paths begins at one point
            count = join_delta(bsdfs, pick, 1, ends, lights.delta, far, 0, rays, together)
            add_unblocked(model, self.at, rays, count, total)
        points = points_on_lamps(seed, m, vertex, path, lights.area)
        add_unblocked(model, self.at, rays, join_area(bsdfs, points, ends, lights.area, rays), total)


def gather(model: Model, at: Transforms, lights: Lights, seed: int, path, position, normal, m=0,
           ending: InKnownLight = WHOLE, lift: np.ndarray | None = None,
           apart: ByBounce | None = None):  # fmt: skip
    """Trace paths to their ends; return the estimate of each, (n, 3 G) float64 [W/m2] for `lights` of G lamps.

    path (n,) int64: path numbers, in sets of 2^m (stratified()) that begin at one point. position [m] and normal (n, 3)
    float64 of the starts; lift: see starts(); apart: see follow(). An
    estimate depends on its own path alone; the mean of a set has no noise of delta lights at its start.
    """
    total = np.zeros((len(path), lights.channels))
    tracer = PathTracer(model, at, lights, seed, m, ending)

    def work(_, a, b):
        for first in range(a, b, BLOCK):
            s = slice(first, min(first + BLOCK, b))
            off = None if lift is None else lift[s].copy()
            ends = starts(path[s].copy(), np.arange(s.stop - first), position[s].copy(), normal[s].copy(), off)
            tracer.follow(ends, total[s], apart=None if apart is None else apart.part(s))

    # 1 << 10 paths per thread: steps of 10 ms hold some 5,000 paths per core
    run_ranges(work, len(path), model.threads, 1 << 10)
    return total


def add_unblocked(model: Model, at: Transforms, rays: Shadows, n: int, total) -> None:
    """Add the values of those of the first n rays that are not blocked to their rows of `total` (rows, 3 G)."""
    if n:
        lines = rays.origin[:n], rays.direction[:n], rays.limit[:n]
        blocked = occluded_in_world(model.accelerator, at, *lines, rays.value[:n])
        add_lit(rays.row, rays.value, rays.lamp, blocked, total)


def last_kernels_first(model: Model) -> None:
    """Call the kernels of paths from the last one on, for no path: another process begins with the first one."""
    world, at, lights = model.world, model.static, model.lights
    none, points, rays = np.zeros(0, np.int64), np.zeros((0, 3)), room_for_shadows(0)
    ends = starts(none, none, points, points)
    arrivals = PathHits(ends, 0, 0, 0, rays.direction, rays.limit, np.zeros(0, np.int32))
    arrive(world, at, lights.area, lights.sky, arrivals, WHOLE, points)
    scatter(world.bsdfs, 0, 0, 0, ends, rays.origin, rays.direction)
    add_lit(rays.row, rays.value, rays.lamp, np.zeros(0, bool), points)
    occluded_in_world(model.accelerator, at, rays.origin, rays.direction, rays.limit)


@kernel
def scatter(bsdfs, seed, m, vertex, ends, origin, direction):
    """Write origin [m] and direction (n, 3) of the next ray of each path; update throughput and density."""
    for k in range(len(ends.path)):
        u = random_numbers.stratified(seed, ends.path[k], vertex, SCATTER_U, m)
        v = random_numbers.stratified(seed, ends.path[k], vertex, SCATTER_V, m)
        f = ends.face[k]
        if f < 0:
            x, y, z = lambertian.sample(u, v)
            x, y, z = random_numbers.from_frame(x, y, z, ends.normal[k, 0], ends.normal[k, 1], ends.normal[k, 2])
        else:
            part = random_numbers.stratified(seed, ends.path[k], vertex, SCATTER_PART, m)
            i, n, t = row(ends.arrival, k), row(ends.normal, k), row(ends.tangent, k)
            (x, y, z), weight, p = surface.sampled(bsdfs, f, i, n, t, u, v, part)
            ends.density[k] = p
            ends.throughput[k, 0] *= weight[0]
            ends.throughput[k, 1] *= weight[1]
            ends.throughput[k, 2] *= weight[2]
        direction[k, 0], direction[k, 1], direction[k, 2] = x, y, z
        origin[k, 0], origin[k, 1], origin[k, 2] = lifted(ends, k)
