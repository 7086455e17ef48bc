"""The naive twin of the solver: loops, and no background, cuts or suffixes.

Every photon is traced through static part and mobiles on every bounce, every segment is tried on every receiver.
Shared with the solver are only the two-level nearest hit, the sampling functions, the accept predicate and the
rounding of flux. The naive twin of `gi_core.discs.stale_receivers`: every receiver looks along every direction at
every other object.
"""

import math

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.fixed_point import MAX_PATH, attenuate
from gi_core.base.jit import kernel
from gi_core.base.random_numbers import basis
from gi_core.bsdf import lambertian, surface
from gi_core.discs.region import EXTENSION, PROBES, RAYS, Regions, look_from, regions
from gi_core.discs.search.predicate import LANES, Discs, Lines, accepts, blocks, discs_crossed
from gi_core.lights.emission import emit
from gi_core.model import Model
from gi_core.photons.hit_grid import OTHER_SIDE
from gi_core.rays.accelerator import GAP
from gi_core.rays.all_objects import landing, nearest_mobile, static_end
from gi_core.rays.structures import new_ray
from gi_core.scene.pose import rotation

F32 = np.float32


@kernel
def _is_glossy(bsdfs, f):
    return surface.is_glossy(bsdfs, f)


@kernel
def _tangent(bsdfs, R, f):
    return surface.tangent_of(bsdfs, R, f)


@kernel
def _scattered(bsdfs, f, i, n, t, u, v, s, w):
    return surface.scattered(bsdfs, f, i, n, t, u, v, s, w)


@kernel
def _landing(world, at, f, origin, direction, distance):
    return landing(world, at, f, origin, direction, distance)


class Twin:
    """Irradiance at given poses, from the scene alone."""

    def __init__(self, scene, photons: int, radius: float, neighbours: int, seed: int, rays: str | None = None):
        self.model = Model(scene, threads=1, rays=rays)
        self.photons, self.radius, self.neighbours, self.seed = photons, radius, neighbours, seed
        self._traced: tuple[dict | None, list[dict]] = None, []

    def segments(self, poses) -> list[dict]:
        """Return all segments at some poses; the last ones are kept, because estimators share them."""
        if poses != self._traced[0]:
            at = self.model.transforms(poses)
            self._traced = dict(poses), [s for i in range(self.photons) for s in self._path(i, at)]
        return self._traced[1]

    def _path(self, i: int, at):
        """Follow photon i until it ends."""
        m, world = self.model, self.model.world
        origin, direction, flux, side, _ = emit(m.emitters, self.seed, i, 1)
        q = [int(c) for c in flux[0]]
        for bounce in range(MAX_PATH):
            end, end_side = _static_end(m, at, origin, direction, side)
            cut, cut_side = _cut(m, at, origin, end, side)
            d, length = _line(origin[0], end[0])
            segment = {
                "photon": i, "bounce": bounce, "flux": tuple(q), "origin": origin[0], "end": end[0],
                "low": min(self._extended(origin[0], F32(0)), F32(0.5) * F32(length)),
                "high": self._extended(origin[0], length) if end_side[0] >= 0 else length,
                "start_side": int(side[0]), "end_side": int(end_side[0]), "cut_side": int(cut_side[0]),
                "hit": end[0], "hit_side": int(end_side[0]),
            }  # fmt: skip
            if cut_side[0] >= 0:
                segment["high"] = self._extended(origin[0], cut[0])
                segment["hit"] = np.array(
                    _landing(world, at, cut_side[0] >> 1, tuple(origin[0]), tuple(d), cut[0]), F32
                )
                segment["hit_side"] = int(cut_side[0])
            yield segment
            side = np.array([segment["hit_side"]], np.int32)
            if side[0] < 0 or bounce + 1 == MAX_PATH:
                return
            face, back = side[0] >> 1, side[0] & 1
            rho = world.bsdfs.reflectance[face]
            survival = max(rho)
            u, v = random_numbers.bounce_numbers(self.seed, i, bounce + 1)
            if _is_glossy(world.bsdfs, face):
                if back and not world.two_sided[face]:
                    return
                more = [random_numbers.independent(self.seed, i, bounce + 1, k) for k in (2, 3)]
                arrival, n = tuple(-d.astype(float)), tuple(self._side_normal(side[0], at))
                along = _tangent(world.bsdfs, at.rotation[world.face_object[face]], face)
                direction, factor = _scattered(world.bsdfs, face, arrival, n, along, u, v, *more)
                q = [attenuate(c, w, 1.0) for c, w in zip(q, factor, strict=True)]
                if not any(q):
                    return
                origin, direction = segment["hit"][None], np.array([direction], F32)
                continue
            if (back and not world.two_sided[face]) or u >= survival:
                return
            q = [attenuate(c, r, survival) for c, r in zip(q, rho, strict=True)]
            n = self._side_normal(side[0], at)
            direction = np.array([random_numbers.from_frame(*lambertian.sample(u / survival, v), *n)], F32)
            origin = segment["hit"][None]

    def _extended(self, origin, t):
        """Return a distance t that ends a part, lengthened by a share of the radius or of the coordinates."""
        return t + max(F32(EXTENSION * self.radius), F32(GAP) * (np.abs(origin).max() + t))

    def _side_normal(self, side: int, at):
        """Return the world normal [x, y, z] of a side."""
        world, face = self.model.world, side >> 1
        n, R = world.normals[face], at.rotation[world.face_object[face]]
        return [(-1 if side & 1 else 1) * (R[k, 0] * n[0] + R[k, 1] * n[1] + R[k, 2] * n[2]) for k in range(3)]

    def irradiance(self, estimator: str, poses) -> np.ndarray:
        """Return E (R, 3) of every receiver at the given poses."""
        segments = self.segments(poses)
        sums, area = getattr(self, "_" + estimator)(segments, poses)
        scale = self.model.emitters.unit_flux / self.photons
        area = np.asarray(area, float)
        factor = np.divide(scale, area, out=np.zeros(len(area)), where=area > 0)
        return np.array(sums, np.int64) * factor[:, None]

    def _impact_count(self, segments, poses):
        s = self.model.surfaces
        areas = 3 * self.model.object_receivers.areas
        sums = [[0, 0, 0] for _ in areas]
        for segment in segments:
            side = segment["hit_side"]
            if side >= 0:
                for r in (s.corner_back if side & 1 else s.corner_front)[side >> 1]:
                    if r >= 0:
                        sums[r] = [a + b for a, b in zip(sums[r], segment["flux"], strict=True)]
        return sums, areas

    def _tangent_plane(self, segments, poses):
        model, radius = self.model, F32(self.radius)
        receivers, own, patch = model.object_receivers, model.receiver_sides, model.surfaces.patch
        r2 = radius * radius
        sums, area = [[0, 0, 0] for _ in receivers.areas], np.empty(len(receivers.areas))
        for o in range(model.surfaces.objects):
            rows = np.arange(len(receivers.areas))[model.surfaces.receiver_range(o)]
            p, n = receivers.positions[rows].astype(F32), receivers.normals[rows].astype(F32)
            region = regions(model, o, self.radius)
            region = regions_in_company(model, o, model.transforms(poses), self.radius, region)
            area[rows] = region.area
            filled = np.full(-(-len(rows) // LANES) * LANES, -1)
            filled[: len(rows)] = np.arange(len(rows))
            # One disc per receiver; only the searches share one disc between two sides.
            alone = np.full(len(rows), -1, np.int32)
            discs = Discs(p, n, own[rows], alone, radius, region)
            data = blocks(discs, filled).data
            pose = None if o == 0 else poses[model.names[o - 1]]
            R = None if o == 0 else rotation(pose)
            for s in segments:
                points = [_to_object(pose, R, s[k]) for k in ("origin", "end", "hit")]
                d, _ = _line(points[0], points[1])
                stop = F32(s["high"])
                side = s["hit_side"]
                bent = side >= 0 and model.concave[2 * patch[side >> 1] + (side & 1)]
                high = stop + F32(2 * self.radius) if bent else stop
                every = range(len(filled) // LANES)
                origin, d = tuple(points[0]), tuple(d)
                lanes = [discs_crossed(data, b, origin, d, F32(s["low"]), high, r2) for b in every]
                near = [LANES * b + k for b in every for k in range(LANES) if lanes[b] >> k & 1]
                if not near:
                    continue
                patches = [
                    2 * patch[k >> 1] + (k & 1) if k >= 0 else -1
                    for k in (s["start_side"], s["end_side"], s["cut_side"])
                ]
                low_stop_high = (np.array([t], F32) for t in (s["low"], stop, high))
                origin_and_way, flux = np.array([[points[0]], [d]], F32), np.zeros((1, 3), np.int32)
                patches, touches = np.array([patches], np.int32), np.array([points], F32)
                line = Lines(*origin_and_way, *low_stop_high, flux, np.zeros(1, np.uint8), patches, touches)
                for j in near:
                    if not d[0] * n[j, 0] + d[1] * n[j, 1] + d[2] * n[j, 2] < 0:
                        continue
                    if accepts(discs, j, tuple(p[j]), tuple(n[j]), line, 0):
                        sums[rows[j]] = [a + b for a, b in zip(sums[rows[j]], s["flux"], strict=True)]
        return sums, area

    def _photon_map(self, segments, poses):
        model, k, radius = self.model, self.neighbours, F32(self.radius)
        receivers = model.receivers_at(poses)
        hits = [s for s in segments if s["hit_side"] >= 0]
        at = model.transforms(poses)
        x = np.array([h["hit"] for h in hits], F32).reshape(-1, 3)
        d = np.array([self._side_normal(h["hit_side"], at) for h in hits], F32).reshape(-1, 3)
        sums, area = [], []
        own = np.array([2 * model.surfaces.patch[h["hit_side"] >> 1] + (h["hit_side"] & 1) for h in hits])
        share = model.covered_share
        for r, (p, n) in enumerate(zip(receivers.positions.astype(F32), receivers.normals.astype(F32), strict=True)):
            a, b, c = x[:, 0] - p[0], x[:, 1] - p[1], x[:, 2] - p[2]
            d2 = a * a + b * b + c * c
            front = d[:, 0] * n[0] + d[:, 1] * n[1] + d[:, 2] * n[2] > OTHER_SIDE
            if share[r] < 1:
                front &= own == model.receiver_sides[r]
            near = [j for j in range(len(hits)) if d2[j] <= radius * radius and front[j]]
            near = sorted(near, key=lambda j: (d2[j], hits[j]["photon"], hits[j]["bounce"]))[:k]
            full = len(near) == k and d2[near[-1]] > 0
            counted = near[: k - 1] if full else near
            sums.append([sum(hits[j]["flux"][c] for j in counted) for c in range(3)])
            area.append(math.pi * float(d2[near[-1]] if full else radius * radius) * share[r])
        return sums, area


def _static_end(m: Model, at, origin, direction, side):
    """Return the static end (1, 3) float32 of a ray (1, 3) that leaves a side (1,), and the side that it hits (1,)."""
    x, y, z, hit = static_end(m.accelerator.scenes, new_ray(), m.world, at, *origin[0], *direction[0], side[0])
    return np.array([[x, y, z]], F32), np.array([hit], np.int32)


def _cut(m: Model, at, *line):
    cut, side = np.empty(1, F32), np.empty(1, np.int32)
    nearest_mobile(m.accelerator.scenes, new_ray(), m.world, at, *line, cut, side)
    return cut, side


def _line(origin, end):
    """Return the float32 unit direction and length from one float32 point to another."""
    d = end.astype(float) - origin.astype(float)
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    scale = 1.0 / length if length > 0 else 0.0
    return np.array([c * scale for c in d], F32), F32(length)


def _to_object(pose, R, point):
    """Carry a world point (3,) float32 to the space of an object at a pose of rotation R; None: the static part."""
    if pose is None:
        return point
    x, y, z = (float(point[k]) - pose.position[k] for k in range(3))
    return np.array([R[0, k] * x + R[1, k] * y + R[2, k] * z for k in range(3)], F32)


def regions_in_company(model: Model, o: int, at, radius: float, alone: Regions) -> Regions:
    """Return the regions of object o's receivers at some poses; `alone`: those without other objects."""
    points, normals = look_from(model, o, radius)
    points = np.ascontiguousarray(points, F32)
    row, reach, area = alone.row.copy(), list(alone.reach), alone.area.copy()
    for b in range(model.surfaces.objects):
        if b == o or not len(points):
            continue
        origins, directions = _rays(points, normals, at, o, b)
        limits = np.full(len(origins), radius, F32)
        distance, _ = model.accelerator.nearest(b, origins, directions, limits)
        distance = distance.reshape(-1, RAYS)
        for i in range(len(points)):
            # A few directions decide whether a receiver of a mobile is tested against the static part at all.
            if b == 0 and not (distance[i, :: RAYS // PROBES] < F32(radius)).any():
                continue
            there = [min(math.floor(F32(d) * F32(255 / radius) + F32(1e-3)), 255) for d in distance[i]]
            before = reach[row[i]] if row[i] >= 0 else np.full((RAYS, 2), 255, np.uint8)
            now = np.minimum(before, np.array(there, np.uint8)[:, None])
            if area[i] > 0 and (now < before).any():
                reach.append(now)
                row[i] = len(reach) - 1
                far = [int(d) for d in now[:, 1]]
                twice = sum(far[k] * far[(k + 1) % RAYS] for k in range(RAYS))
                area[i] = 0.5 * math.sin(2 * math.pi / RAYS) * (radius / 255) ** 2 * twice
                if area[i] < 1e-3 * math.pi * radius * radius:
                    area[i] = 0.0
    return Regions(row, np.array(reach, np.uint8).reshape(-1, RAYS, 2), area)


def _rays(points, normals, at, o: int, b: int):
    """Return origins and directions (RAYS n, 3) float32 of all directions of n receivers, in object b's space."""
    frames = np.array([basis(*map(float, n)) for n in normals])
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    directions = np.cos(angle)[:, None] * frames[:, None, :3] + np.sin(angle)[:, None] * frames[:, None, 3:]
    origins = _across(at.rotation[o], at.position[o], at.rotation[b], at.position[b], points.astype(float))
    directions = _across(at.rotation[o], np.zeros(3), at.rotation[b], np.zeros(3), directions.reshape(-1, 3))
    return np.repeat(origins, RAYS, axis=0), directions


def _across(Ra, pa, Rb, pb, x):
    """Carry points (n, 3) float64 from object a's space to object b's: float32, as rounded in world space."""
    world = (x[:, :1] * Ra[:, 0] + x[:, 1:2] * Ra[:, 1] + x[:, 2:] * Ra[:, 2] + pa).astype(F32)
    w = world.astype(float) - pb
    return (w[:, :1] * Rb[0] + w[:, 1:2] * Rb[1] + w[:, 2:] * Rb[2]).astype(F32)
