"""The naive twin of `gi_core.discs.contact.contact`: every receiver looks along every direction at every other
object."""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.random_numbers import basis
from gi_core.discs.region import PROBES, RAYS, Regions, look_from
from gi_core.model import Model

F32 = np.float32


def regions_in_company(model: Model, o: int, at, radius: float, alone: Regions) -> Regions:
    """Return the regions of object o's receivers at some poses; `alone`: those without other objects."""
    points, normals = look_from(model, o, radius)
    points = np.ascontiguousarray(points, F32)
    row, reach, area = alone.row.copy(), list(alone.reach), alone.area.copy()
    for b in range(model.surfaces.objects):
        if b == o or not len(points):
            continue
        rays = [_ray(points[i], normals[i], k, at, o, b) for i in range(len(points)) for k in range(RAYS)]
        origins, directions = (np.array(a, F32) for a in zip(*rays, strict=True))
        limits = np.full(len(rays), radius, F32)
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


def _ray(point, normal, k: int, at, o: int, b: int):
    """Return origin and direction, three float32 each, of receiver's direction k in object b's space."""
    ax, ay, az, bx, by, bz = basis(*map(float, normal))
    c, s = float(np.cos(2 * np.pi * np.arange(RAYS) / RAYS)[k]), float(np.sin(2 * np.pi * np.arange(RAYS) / RAYS)[k])
    direction = (c * ax + s * bx, c * ay + s * by, c * az + s * bz)
    origin = _across(at.rotation[o], at.position[o], at.rotation[b], at.position[b], [float(x) for x in point])
    return origin, _across(at.rotation[o], np.zeros(3), at.rotation[b], np.zeros(3), direction)


def _across(Ra, pa, Rb, pb, x):
    w = [float(F32(Ra[i, 0] * x[0] + Ra[i, 1] * x[1] + Ra[i, 2] * x[2] + pa[i])) - pb[i] for i in range(3)]
    return [F32(Rb[0, i] * w[0] + Rb[1, i] * w[1] + Rb[2, i] * w[2]) for i in range(3)]
