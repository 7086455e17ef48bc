"""Where the light at a point comes from: its shares by lamp, by the surface that sent it last, and by bounces.

Whole paths from the point, those of the reference, are added up by origin. Sets of paths are independent, so their
covariance gives the standard error of each share, which is a ratio of means.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gi_core.gather.path_tracer import ByBounce
from gi_core.gather.reference import Gatherer
from gi_core.geometry.error import luminance
from gi_core.lights.lamps import lamps_at
from gi_core.model import Model
from gi_core.scene.pose import three
from gi_core.scene.types import Pose, part_named

LAMPS, SURFACES, BOUNCES = GROUPS = "lamp", "last surface", "bounces"
STRAIGHT, OTHER = "straight from lamps", "other"
COUNTS = "0", "1", "2", "3", "4 or more"  # of bounces
SHARE_NOISE = 0.003  # standard error of all shares at the end
STEP_PATHS, TOTAL_PATHS = 1 << 12, 1 << 18  # of a step, some 15 ms, and at most


class Share(NamedTuple):
    """Light of one origin at a point."""

    name: str
    share: float  # of all light there, 0 .. 1
    error: float  # standard error of the share
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
    now = Origins(names, 0, np.zeros((sum(map(len, names)), 3)), np.zeros((sum(map(len, names)),) * 2))
    while now.fraction < 1:
        apart = ByBounce(np.zeros((len(COUNTS), count, lights.channels)), np.full(count, -1, np.int32))
        gatherer.paths(np.zeros(1, np.int64), now.sets * size, count, m, apart=apart)
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
        yield now


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
