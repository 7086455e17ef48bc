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
