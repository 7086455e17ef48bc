"""The background: photon paths through the static part, and the estimate of their light."""

from __future__ import annotations

import copy
import enum
import functools
import itertools
import time

import numpy as np

from gi_core.base import memory
from gi_core.base.fixed_point import MAX_SEGMENTS
from gi_core.base.jit import kernel
from gi_core.base.pause import Pace
from gi_core.base.threads import COSTLY, run_ranges
from gi_core.estimators import ESTIMATORS, Estimator
from gi_core.estimators.base import Setting
from gi_core.frames.unchanged_paths import KnownPaths, known_paths, traced_paths
from gi_core.lights.lamps import irradiance_at
from gi_core.model import Model
from gi_core.photons.flux_sums import Evaluated, SubsetStore
from gi_core.photons.paths import PathStore, PathVertices, segments_of
from gi_core.photons.trace import add_fates, no_flux
from gi_core.retrace.cuts import Coarse, CoarseStore, grid_for, same_grid

PART = 4096  # photons that a thread traces or accumulates in one go: their rays and segments stay in its cache
BYTES_PER_VERTEX = 40  # per stored path vertex, whole and quantised
SPARE_MEMORY = 1 << 30  # bytes reserved for frames and for other programs


def _pace() -> Pace:
    """Return a pace of photons per step, from 1 ms per photon: paths in white rooms may be long."""
    return Pace(1e-3, 64, 1 << 16)


@kernel
def _read_out(sums, scale, area, out):
    """Write irradiance (R, n) [W/m2] of sums of flux units of `scale` [W] over areas (R,) [m2]."""
    for r in range(len(area)):
        # Area 0: no light can reach the receiver, or it has no face.
        factor = scale / area[r] if area[r] > 0.0 else 0.0
        for c in range(sums.shape[1]):
            out[r, c] = sums[r, c] * factor


class StepKind(enum.Enum):
    """Kind of one step towards a background."""

    TRACING = "tracing"
    ESTIMATING = "estimating"


class Background:
    """An estimate of photons under one setting."""

    def __init__(self, store: Photons, setting: Setting):
        self.setting, self.store, self.model = setting, store, store.model
        self.estimate: Estimator = ESTIMATORS[setting.estimator](store.model, setting)
        self.added = 0  # photons
        self.built = False
        self.pace = _pace()
        self.evaluated: Evaluated | None = None  # sums of the last frame; the next one overwrites them
        self._irradiance = SubsetStore(), SubsetStore()  # of levels and irradiance: of bounced light alone, of all

    def build(self) -> None:
        """Build the parts that do not depend on photons, once."""
        if not self.built:
            self.estimate.build()
            self.built = True

    def copied(self, store: Photons) -> Background:
        """Return a copy for a model of the same static part; store: the same photons there."""
        other = copy.copy(self)
        other.store, other.model, other.built, other.evaluated = store, store.model, False, None
        other.estimate = self.estimate.copied(store.model, self.setting)
        other.pace = _pace()
        other._irradiance = SubsetStore(self._irradiance[0]), SubsetStore(self._irradiance[1])
        return other

    def irradiance(self, photons: int, levels: np.ndarray | None = None, direct: bool = True) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] of static receivers without mobiles, of a photon subset; cached.

        levels (G, 3): of the lamps; None: those of the scene file. direct: with segments that leave lamps.
        """
        levels, by_photons = self.model.emitters.lamps.full() if levels is None else levels, self._irradiance[direct]
        if photons not in by_photons or not np.array_equal(by_photons[photons][0], levels):
            sums, area = self.estimate.background(photons, direct)
            unit, weights = self.model.emitters.unit_flux / photons, self.store.weights(levels)
            by_photons[photons] = levels, irradiance_at(sums, weights, unit, area, self.model.threads)
        return by_photons[photons][1]

    def irradiance_per_lamp(self, photons: int, direct: bool = True) -> np.ndarray:
        """Return irradiance (n, 3 G) [W/m2] of static receivers by lamp, as irradiance()."""
        sums, area = self.estimate.background(photons, direct)
        light = np.empty(sums.shape)
        _read_out(sums, self.model.emitters.unit_flux / photons, area, light)
        light *= np.repeat(self.model.emitters.scale, 3)
        return light


class Photons:
    """All photons traced so far; none is traced twice.

    earlier: photons of the scene before an edit. Paths that met no edited face are taken over (`unchanged_paths.py`):
    at once where none did, else part by part.
    """

    def __init__(self, model: Model, seed: int, earlier: Photons | None = None):
        self.model, self.seed = model, seed
        self.traced = 0  # photons, without those taken over
        self._known: KnownPaths | None = None  # to be taken over part by part
        self.fates = no_flux(model.emitters.lamps.count)
        self.memory_full = False  # memory holds fewer photons than wanted
        self._pace = _pace()
        self._store = PathStore()
        self._coarse = CoarseStore(grid_for(model.world, *model.lit))  # the same paths, quantised, for the broad phase
        if earlier is not None and earlier.count and earlier.seed == seed:
            self._known = known_paths(earlier.model, model, earlier.subset(earlier.count)[0])
        if self._known is not None and self._known.are_all_kept:
            self._known = None
            self._take_over(earlier)

    def _take_over(self, earlier: Photons) -> None:
        """Take over all photons."""
        self.fates, self._store, coarse = earlier.fates, earlier._store.copied(), earlier._coarse
        if same_grid(coarse.grid, self._coarse.grid):
            self._coarse = coarse.copied()
        else:
            self._coarse.append([self._store.subset(self.count)], 0, self._store.room, self.model.threads)

    @property
    def count(self) -> int:
        return self._store.photons

    def weights(self, levels: np.ndarray) -> np.ndarray:
        """Return the weights (G, 3) of sums per lamp for light at levels (G, 3)."""
        return levels * self.model.emitters.scale[:, None]

    def subset(self, photons: int) -> tuple[PathVertices, Coarse]:
        """Return views of the paths of the first photons, whole and quantised."""
        paths = self._store.subset(photons)
        return paths, self._coarse.subset(len(paths.side))

    def segments(self, photons: int) -> int:
        """Return the number of segments of the first photons."""
        return len(self.subset(photons)[0].side) - photons

    def affordable(self, wanted: int, bytes_per_hit: int) -> int:
        """Return the wanted photons that fit into memory; the estimator needs bytes_per_hit per path vertex."""
        self.memory_full = False
        if not self.count:
            return wanted
        vertices, left = len(self._store.subset(self.count).side), memory.available()
        more = float(MAX_SEGMENTS - vertices)
        if left is not None:
            more = min(more, max(left - SPARE_MEMORY, 0) / (BYTES_PER_VERTEX + bytes_per_hit))
        fit = min(wanted, self.count + int(more * self.count / vertices))
        self.memory_full = fit < wanted
        return fit

    def bring_in(self, b: Background, until: int, wanted: int, seconds: float) -> StepKind:
        """Do one step [s] towards a background of the first `until` photons; returns its kind.

        Photons are traced some steps ahead of the estimate, so that each step does one kind of work on its data in the
        cache. wanted: photons to reserve memory for.
        """
        started = time.perf_counter()
        if b.added == self.count:
            work, pace, left = StepKind.TRACING, self._pace, wanted - self.count
        else:
            work, pace, left = StepKind.ESTIMATING, b.pace, min(until, self.count) - b.added
        count = pace.share_of(left, seconds)
        if work is StepKind.TRACING:
            self._trace(count, wanted)
        else:
            self._estimate(b, count)
        pace.took(count, time.perf_counter() - started)
        return work

    def _trace(self, count: int, wanted: int) -> None:
        """Trace the next photons on all threads."""
        m, stored = self.model, self.count

        def work(_, first, last):
            parts = [(stored + at, min(PART, last - at)) for at in range(first, last, PART)]
            return [traced_paths(m, self.seed, self._known, *part) for part in parts]

        traced = itertools.chain.from_iterable(run_ranges(work, count, m.threads, COSTLY))
        paths, fates, counts = zip(*traced, strict=True)
        self.traced += sum(counts)
        if self._known is not None and stored + count >= len(self._known.paths.lamp):
            self._known = None  # their memory
        self._store.reserve(wanted)
        self._store.append(paths, m.threads)
        try:
            self._coarse.append(paths, stored, self._store.room, m.threads)
        except BaseException:  # memory is full
            self._store.photons = stored  # both hold the same photons
            raise
        self.fates = functools.reduce(add_fates, fates, self.fates)

    def _estimate(self, b: Background, count: int) -> None:
        """Add the next traced photons to a background, on all threads."""
        m, added = self.model, b.added
        paths = self._store.subset(added + count)
        part = max(1, min(PART, (1 << 16) * (added + count) // len(paths.side)))  # paths in white rooms are long

        def work(thread, first, last):
            for at in range(added + first, added + last, part):
                segments = segments_of(paths, at, min(at + part, added + last))
                b.estimate.add_background(segments, thread)

        try:
            run_ranges(work, count, m.threads, COSTLY)
        except BaseException:
            b.setting = None  # incomplete: never continue it
            raise
        b.added += count
