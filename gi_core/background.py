"""The background: photons traced through the static part alone, and an estimate of their light."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gi_core import memory
from gi_core.estimators import ESTIMATORS
from gi_core.ladder import Ladder
from gi_core.model import Model
from gi_core.near_scan import Coarse, CoarseStore
from gi_core.paths import PathStore, PathVertices, segments_of
from gi_core.photon_trace import Fates, no_flux, trace_background
from gi_core.radiosity import irradiance
from gi_core.setting import Setting
from gi_core.threads import run_ranges

PART = 4096  # photons that a thread traces and splats in one go: their segments stay in its cache
PART_GRAIN = 256  # photons a thread
BYTES_A_VERTEX = 40  # of a path as it is stored, twice: whole and coarse
SPARE_MEMORY = 1 << 30  # bytes that are left to others, and to what frames need


class Background:
    """An estimate of the background under one setting."""

    def __init__(self, model: Model, setting: Setting):
        self.setting, self._model = setting, model
        self.estimate = ESTIMATORS[setting.estimator](model, setting)
        self.added = 0  # photons
        self.built = False
        self._resting = Ladder()

    def serves(self, setting: Setting) -> bool:
        """Tell whether its sums are those of a setting, which may want them found by another search."""
        return self.setting is not None and self.setting.light == setting.light

    def build(self) -> Iterator[None]:
        """Build what does not depend on photons, unless that has been done, in steps."""
        if not self.built:
            yield from self.estimate.build()
            self.built = True

    def switch(self, setting: Setting) -> Iterator[None]:
        """Go over, in steps, to a setting of the same light: what has been summed stays, what finds it is made anew."""
        if setting != self.setting:
            yield from self.estimate.switch(setting)
            self.setting = setting

    @property
    def weights(self) -> np.ndarray:
        """The areas (n,) [m2] that static receivers stand for."""
        return self._model.object_receivers.areas[self._model.surfaces.receiver_range(0)]

    def resting(self, photons: int) -> np.ndarray:
        """Return irradiance (n, 3) of static receivers without mobiles, of a prefix; computed once."""
        if photons not in self._resting:
            sums, area = self.estimate.background(photons)
            self._resting[photons] = irradiance(sums, self._model.emitters.unit_flux / photons, area)
        return self._resting[photons]


class Photons:
    """All photons traced so far; none is traced twice."""

    def __init__(self, model: Model, seed: int):
        self.model, self.seed = model, seed
        self.fates = no_flux()
        self._store = PathStore()
        self._coarse = CoarseStore(model.grid)  # the same paths, for the scan

    @property
    def count(self) -> int:
        return self._store.photons

    def prefix(self, photons: int) -> tuple[PathVertices, Coarse]:
        """Return views of the paths of the first photons, whole and coarse."""
        paths = self._store.prefix(photons)
        return paths, self._coarse.prefix(len(paths.side))

    def affordable(self, wanted: int, bytes_a_hit: int) -> int:
        """Return how many of the photons wanted memory holds; an estimator keeps bytes_a_hit more a path vertex."""
        left = memory.available()
        if not self.count or left is None or wanted <= self.count:
            return wanted
        vertices = len(self._store.prefix(self.count).side) / self.count
        more = max(left - SPARE_MEMORY, 0) / (vertices * (BYTES_A_VERTEX + bytes_a_hit))
        return min(wanted, self.count + int(more))

    def take_in(self, b: Background, count: int, wanted: int) -> str:
        """Bring the next photons into a background, tracing those that are new, a share of them a thread.

        wanted: photons that there is going to be room for. Returns what most of the time went into.
        """
        m, stored = self.model, self.count
        known = self._store.prefix(min(stored, b.added + count))

        def work(thread, first, last):
            fresh = []
            at, last = b.added + first, b.added + last
            while at < last:
                n = min(PART, last - at)
                if at < stored:
                    n = min(n, stored - at)
                    segments = segments_of(known, m.eps, at, at + n)
                else:
                    paths, fates = trace_background(m.accelerator, m.world, m.static, m.emitters, self.seed, at, n)
                    fresh.append((paths, fates))
                    segments = segments_of(paths, m.eps, 0, n, base=at)
                b.estimate.add_background(segments, thread)
                at += n
            return fresh

        try:
            parts = run_ranges(work, count, m.threads, PART_GRAIN)
        except BaseException:
            b.setting = None  # it holds a part of these photons: never go on with it
            raise
        for paths, fates in (pair for fresh in parts for pair in fresh):
            self._store.reserve(wanted)
            self._coarse.append(paths, self._store.photons, self._store.room)
            self._store.append(paths)
            self.fates = add_fates(self.fates, fates)
        b.added += count
        return "tracing" if self.count > stored else "estimating"


def add_fates(a: Fates, b: Fates) -> Fates:
    return Fates(*(x + y for x, y in zip(a, b, strict=True)))
