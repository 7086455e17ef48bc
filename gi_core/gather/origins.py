"""Where the light at a point comes from: its shares by lamp, by the surface that sent it last, and by bounces.

Whole paths from the point, those of the reference, are added up by origin. Sets of paths are independent, so their
covariance gives the standard error of each share, which is a ratio of means. Some paths, drawn in proportion to their
light (Efraimidis and Spirakis 2006), are kept as ways from the point to a lamp.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import dot
from gi_core.gather.path_tracer import ByBounce
from gi_core.gather.reference import Gatherer
from gi_core.geometry.error import luminance
from gi_core.lights.lamps import lamps_at
from gi_core.lights.next_event import FACE, LightPoints, light_points
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, GAP, LIFT, Transforms
from gi_core.rays.all_objects import occluded_in_world
from gi_core.scene.pose import three
from gi_core.scene.types import Pose, part_named

LAMPS, SURFACES, BOUNCES = GROUPS = "lamp", "last surface", "bounces"
STRAIGHT, OTHER = "straight from lamps", "other"
COUNTS = "0", "1", "2", "3", "4 or more"  # of bounces
SHARE_NOISE = 0.003  # standard error of all shares at the end
MOST_WAYS = 24
STEP_PATHS, TOTAL_PATHS = 1 << 12, 1 << 18  # of a step, some 15 ms, and at most


class Share(NamedTuple):
    """Light of one origin at a point."""

    name: str
    share: float  # of all light there, 0 .. 1
    error: float  # standard error of the share
    colour: tuple[float, float, float]  # of this light, the largest channel 1


class Way(NamedTuple):
    """A way of light to a point."""

    places: np.ndarray  # (n, 3) float64 [m]: the point, its bounces from the last to the first, and the lamp
    colour: tuple[float, float, float]  # of this light, the largest channel 1


class Origins(NamedTuple):
    """Light at a point by origin; C rows: lamps, then last surfaces, then numbers of bounces. Each group is all light.

    The last surface of light straight from lamps is STRAIGHT.
    """

    names: tuple[tuple[str, ...], ...]  # of the rows of each of GROUPS
    sets: int  # independent sets of paths
    light: np.ndarray  # (C, 3) float64 [W/m2]
    moments: np.ndarray  # (C, C) float64, sums over sets of products of luminances [W2/m4]
    fraction: float = 0.0  # of the paths needed, 0 .. 1
    ways: tuple[Way, ...] = ()  # at the end, each for an equal share of the light of at most three bounces

    @property
    def total(self) -> tuple[float, float]:
        """Irradiance as luminance [W/m2], and its standard error."""
        all_lamps = np.repeat([1.0, 0.0], [len(self.names[0]), len(self.light) - len(self.names[0])])
        return float(all_lamps @ luminance(self.light)), self._error(all_lamps)

    def _error(self, weights: np.ndarray) -> float:
        """Return the standard error of a weighted sum of rows."""
        mean = float(weights @ luminance(self.light))
        squares = float(weights @ self.moments @ weights) - self.sets * mean * mean
        return (max(squares, 0.0) / (self.sets * max(self.sets - 1, 1))) ** 0.5

    def shares(self, group: str, most: int = 1 << 30) -> tuple[Share, ...]:
        """Return the shares of a group, the largest first, those of bounces in order; beyond `most` one of all others.

        () in the dark.
        """
        k = GROUPS.index(group)
        first, lamps, total = sum(map(len, self.names[:k])), np.zeros(len(self.light)), self.total[0]
        lamps[: len(self.names[0])] = 1.0
        of = luminance(self.light)[first : first + len(self.names[k])]
        order = range(len(of)) if group == BOUNCES else np.argsort(-of, kind="stable").tolist()
        rows = [[row] for row in order if of[row] > 0]
        if len(rows) > most:
            rows[most - 1 :] = [sum(rows[most - 1 :], [])]
        out = []
        for at in rows:
            these, light = np.zeros(len(lamps)), self.light[first + np.array(at)].sum(axis=0)
            these[first + np.array(at)] = 1.0
            share = float(luminance(light)) / total
            name = self.names[k][at[0]] if len(at) == 1 else OTHER
            out.append(Share(name, share, self._error(these - share * lamps) / total, three(light / light.max())))
        return tuple(out)


def origin_steps(
    model: Model, position: np.ndarray, normal: np.ndarray, poses: Mapping[str, Pose], levels: np.ndarray, seed: int
) -> Iterator[Origins]:
    """Trace paths from a point (3,) [m] with a normal (3,) until its shares are known; yield them per step.

    levels (G, 3): of the lamps. A share is known by SHARE_NOISE, or after TOTAL_PATHS. Raises SceneError for bad poses.
    """
    lights, lamps = lamps_at(model.lights, levels), model.emitters.lamps
    gatherer = Gatherer(model.scene, position[None], normal[None], seed, poses, model=model, lights=lights)
    of_face, parts = _parts(model)
    names, m = (lamps.names, parts, COUNTS), max(6, gatherer.least_set)  # 64 paths of a set
    size, count = 1 << m, max(STEP_PATHS, 1 << m)
    drawn, random = _Drawn(), np.random.default_rng(seed)
    now = Origins(names, 0, np.zeros((sum(map(len, names)), 3)), np.zeros((sum(map(len, names)),) * 2))
    while now.fraction < 1:
        apart = ByBounce(np.zeros((len(COUNTS), count, lights.channels)), np.full(count, -1, np.int32))
        gatherer.paths(np.zeros(1, np.int64), now.sets * size, count, m, apart=apart)
        drawn.add(apart.light[:-1], now.sets * size, random)
        light = apart.light.reshape(len(COUNTS), -1, size, lamps.count, 3)
        sets = light.shape[1]
        bounced = light[1:].sum(axis=(0, 3)).reshape(count, 3)
        cell = np.repeat(np.arange(sets), size) * len(parts) + np.where(apart.face >= 0, of_face[apart.face], 0)
        by_part = np.stack([np.bincount(cell, bounced[:, c], sets * len(parts)) for c in range(3)], axis=1)
        by_part = by_part.reshape(sets, len(parts), 3)
        by_part[:, 0] += light[0].sum(axis=(1, 2))
        groups = light.sum(axis=(0, 2)), by_part, light.sum(axis=(2, 3)).transpose(1, 0, 2)
        values = np.concatenate(groups, axis=1) / size
        flat = luminance(values.reshape(-1, 3)).reshape(values.shape[:2])
        n = now.sets + sets
        mean = (now.sets * now.light + values.sum(axis=0)) / n
        now = Origins(names, n, mean, now.moments + flat.T @ flat)
        error = max((share.error for group in GROUPS for share in now.shares(group)), default=0.0)
        done = error <= SHARE_NOISE or n * size >= TOTAL_PATHS
        now = now._replace(fraction=1.0 if done else min((SHARE_NOISE / error) ** 2, 0.99))
        if done:
            now = now._replace(ways=_ways(drawn, gatherer, model, poses, m, normal))
        yield now


class _Drawn:
    """Paths drawn without replacement, by their light: those with the largest log(u) / light."""

    def __init__(self) -> None:
        # Key, number of the path, number of bounces, and light (3 G,) [W/m2]
        self.paths: list[tuple[float, int, int, np.ndarray]] = []

    def add(self, light: np.ndarray, first: int, random: np.random.Generator) -> None:
        """Draw among the light (B, n, 3 G) of paths from number `first` on, by the number of their bounces."""
        weight = luminance(light.reshape(*light.shape[:2], -1, 3).sum(axis=2))
        with np.errstate(divide="ignore"):
            keys = np.log(1.0 - random.random(weight.shape)) / weight
        keys[weight <= 0] = -np.inf
        best = np.argpartition(-keys, MOST_WAYS, axis=None)[:MOST_WAYS]
        for bounces, row in zip(*np.unravel_index(best, keys.shape), strict=True):
            if weight[bounces, row] > 0:
                light_of = light[bounces, row].copy()
                self.paths.append((float(keys[bounces, row]), first + int(row), int(bounces), light_of))
        self.paths = sorted(self.paths, key=lambda path: -path[0])[:MOST_WAYS]


def _ways(
    drawn: _Drawn, gatherer: Gatherer, model: Model, poses: Mapping[str, Pose], m: int, normal: np.ndarray
) -> tuple[Way, ...]:
    """Trace drawn paths again, in their sets of 2^m; return their ways."""
    points, out = light_points(model.lights, model.emitters.arriving, 0, most=np.inf), []
    at = model.transforms({**model.start_poses(), **poses})
    for _, path, bounces, light in drawn.paths:
        seen = ByBounce(np.zeros((1, 1 << m, len(light))), np.full(1 << m, -1, np.int32), [])
        gatherer.paths(np.zeros(1, np.int64), path >> m << m, 1 << m, m, apart=seen)
        places = [p[row == path % (1 << m)][0] for row, p in seen.places[: bounces + 1]]
        of_lamps = light.reshape(-1, 3)
        lamp = int(luminance(of_lamps).argmax())
        side = normal if bounces == 0 else places[-2] - places[-1]
        start = places[-1] + LIFT * model.world.size * side / np.linalg.norm(side)
        end = _place_on(LightPoints(*(a[points.lamp == lamp] for a in points)), start, model, at)
        way = np.array(places if end is None else [*places, end]) + model.origins[0]
        out.append(Way(way, three(of_lamps.sum(axis=0) / of_lamps.sum(axis=0).max())))
    return tuple(out)


def _place_on(points: LightPoints, start: np.ndarray, model: Model, at: Transforms) -> np.ndarray | None:
    """Return a point (3,) [m] on a lamp that lights a place (3,), far away towards a distant one; None: none does."""
    size, on_face = model.world.size, points.kind == FACE
    away = np.where(points.distant[:, None], size * points.place, points.place - start)
    distance = np.linalg.norm(away, axis=1)
    towards = away / distance[:, None]
    ends = distance - 2 * GAP * np.maximum(points.reach, np.abs(start).max())
    limits = np.where(points.distant, FAR * size, np.maximum(ends, 0.0))
    lines = np.broadcast_to(start, away.shape).astype(np.float32), towards.astype(np.float32), limits.astype(np.float32)
    seen = ~occluded_in_world(model.accelerator, at, *lines)
    seen[on_face] &= dot(model.lights.area.normal[points.index[on_face]], towards[on_face]) < 0
    rows = np.flatnonzero(seen)
    return start + away[rows[len(rows) // 2]] if len(rows) else None


def _parts(model: Model) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the part of each face, (F,) int64, and the names of the parts; part 0 has no faces: STRAIGHT."""
    scene, names = model.scene, [STRAIGHT]
    of_face = []
    for mobile in (None, *scene.mobiles):
        mesh = scene.static if mobile is None else mobile.mesh
        used, of = np.unique(mesh.face_material, return_inverse=True)
        of_face.append(len(names) + of.reshape(-1))
        for k in used:
            material = scene.materials[k].name
            part = material if mobile is None else part_named(mobile.name, material)
            names.append(part if mobile is None or part == mobile.name else f"{part} of {mobile.name}")
    return np.concatenate(of_face), tuple(names)
