"""Light gathered at resting poses before an edit that keeps the static part; the frames after it say its change.

    E' = E + change      change: by the frames' own light, before the edit and after it, of the same photons

Own light is that of a frame without light gathered at its poses. Static light may improve meanwhile, which is no change
by the edit: own light of static receivers counts as its difference from static light, added to that before.
Receivers of mobiles count where the mobile has the same receivers and poses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.frames.earlier_light import change_of
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms


class LightAtPoses(NamedTuple):
    """Light of a frame before an edit."""

    model: Model
    at: Transforms
    levels: np.ndarray  # (G, 3)
    irradiance: np.ndarray  # (R, 3) [W/m2]
    own: np.ndarray  # (R, 3) [W/m2], without light gathered at the poses
    static: np.ndarray  # (n, 3) [W/m2], without mobiles
    deviation: np.ndarray  # (R,) [W/m2], standard error of the luminance


class EarlierAtPoses:
    """Light before an edit, for the model after it. rows (k,) int64: receivers that it lights."""

    def __init__(self, light: LightAtPoses, model: Model):
        self.light = light
        before = {name: o for o, name in enumerate(light.model.names, 1)}
        pairs = [(o, before[name]) for o, name in enumerate(model.names, 1) if name in before]
        self._objects, self._objects_before = np.array(pairs, np.int64).reshape(-1, 2).T
        rows, rows_before = [np.arange(len(light.static))], [np.arange(len(light.static))]
        for o, p in pairs:
            own, others = model.surfaces.receiver_range(o), light.model.surfaces.receiver_range(p)
            mine, theirs = model.object_receivers, light.model.object_receivers
            if all(np.array_equal(a[own], b[others]) for a, b in zip(mine[:2], theirs[:2], strict=True)):
                rows.append(np.arange(own.start, own.stop))
                rows_before.append(np.arange(others.start, others.stop))
        gathered = (light.irradiance != light.own).any(axis=1)
        self.rows_before = np.concatenate(rows_before)
        self.rows = np.concatenate(rows)[gathered[self.rows_before]]
        self.rows_before = self.rows_before[gathered[self.rows_before]]
        self._before = light.irradiance[self.rows_before], light.own[self.rows_before]
        self._static = self.rows < len(light.static)

    def is_at(self, at: Transforms, levels: np.ndarray) -> bool:
        """Return whether the mobiles that both scenes have are at the poses of the light; levels (G, 3)."""
        pairs = zip(at[:2], self.light.at[:2], strict=True)
        same = all(np.array_equal(a[self._objects], b[self._objects_before]) for a, b in pairs)
        return same and np.array_equal(levels, self.light.levels)

    def light_now(self, own: np.ndarray, static: np.ndarray) -> np.ndarray:
        """Return irradiance (k, 3) [W/m2] at `rows`; own (R, 3) and static (n, 3) as in LightAtPoses, of a frame."""
        now, improved = own[self.rows], self.rows[self._static]
        now[self._static] += self.light.static[improved] - static[improved]
        irradiance, before = self._before
        return np.maximum(irradiance + change_of(irradiance, before, np.maximum(now, 0.0)), 0.0)
