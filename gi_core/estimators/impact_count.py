"""Impact Count (Patanaik and Mudur 1992; report 1.2, 2.5.1).

E of a face = flux of the photons that hit it / its area; E of a vertex = the area-weighted mean over
its faces, which is the flux on all of them / their area. So a hit adds to the three receivers of its
face, on the side it hit, and nothing is ever stale.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from gi_core.base.jit import kernel
from gi_core.discs.contact.stale_receivers import ControlFacts
from gi_core.discs.search import Search
from gi_core.estimators.setting import Setting
from gi_core.model import Model
from gi_core.photons.flux_sums import CHUNK_BITS, Evaluated, FrameSums, Sums, ThreadSums, carried
from gi_core.photons.paths import Segments
from gi_core.photons.prefixes import SubsetStore
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import CutFlux, PoseChange, Wanted


@kernel
def _deposit(side, flux, front, back, sign, sums, touched):
    for k in range(len(side)):
        if side[k] >= 0:
            corners = front if side[k] & 1 == 0 else back
            f = side[k] >> 1
            for v in range(3):
                r = corners[f, v]
                if r >= 0:
                    touched[r >> CHUNK_BITS] = True
                    for c in range(3):
                        sums[r, c] += sign * flux[k, c]


@kernel
def _take_out(side, flux, offsets, photon, vertex, front, back, sums, touched):
    """Subtract the hits of background paths from those of some photons' vertices on."""
    for j in range(len(photon)):
        v, end = vertex[j], offsets[photon[j] + 1]
        _deposit(side[v + 1 : end], flux[v : end - 1], front, back, -1, sums, touched)


class ImpactCount:
    """See the module; radius and neighbours play no part."""

    about = "Impact Count (Patanaik and Mudur 1992): the flux of the photons that hit a face, over the face's area."
    additive, controlled, on_faces = True, False, True
    smoothing: str | None = None
    compile_seconds = 1
    bytes_a_hit = 0
    stale = 0

    def __init__(self, model: Model, setting: Setting):
        self.model, self._corners = model, (model.surfaces.corner_front, model.surfaces.corner_back)
        # Receiver areas are a third of each face around; the mean divides by the whole faces.
        self.area = 3 * model.object_receivers.areas
        self.photons = 0
        self.prefixes = SubsetStore()  # sums of the background
        self.control_facts = ControlFacts(0.0, 0, 0)
        self.searches: list[Search] = []
        self._background = np.zeros((len(self.area), 3), np.int64)
        self._added = ThreadSums(len(self.area), model.threads)
        self._frame = FrameSums(len(self.area), model.surfaces.receiver_range(0).stop, 1)

    @staticmethod
    def summary(setting: Setting) -> str:
        return ""

    def build(self) -> Iterator[None]:
        """Nothing to build."""
        return iter(())

    def add_background(self, segments: Segments, thread: int) -> None:
        """Add the hits of background segments; several threads may, each with its number."""
        self._deposit(segments, 1, self._added[thread])

    def prepare(self, photons: int) -> Iterator[None]:
        """Let frames use all that was added, which is the first `photons`; kept by that prefix."""
        self._added.move_to(self._background)
        self.prefixes[photons] = self._background.copy()
        self.photons = photons
        return iter(())

    def background(self, photons: int) -> tuple[np.ndarray, np.ndarray]:
        """Return sums (n, 3) int64 and area (n,) [m2] of static receivers without mobiles, of a prefix."""
        rows = self.model.surfaces.receiver_range(0)
        return self.prefixes[photons][rows], self.area[rows]

    def wanted(self, at: Transforms, mobiles: bool) -> Wanted:
        """Return the segments that a frame at these poses must hold: nothing but what changes."""
        return Wanted.changes(self.model, mobiles)

    def evaluate(self, frame: PoseChange) -> Evaluated:
        """Return what the frame's irradiance is read from, valid until the next call."""
        added, new_suffixes = self._frame.added[0], self._frame.new_suffixes[0]
        corners, paths, t = self._corners, frame.removed_suffixes.paths, frame.removed_suffixes
        try:
            _take_out(paths.side, paths.flux, paths.offsets, t.photon, t.vertex, *corners, added.flux, added.touched)
            self._deposit(frame.kept_prefixes, 1, added)
            self._deposit(frame.new_suffixes, 1, new_suffixes)
            return self._frame.collect(self.background(frame.photons)[0], self.area, frame.kept_prefixes.flux)
        except BaseException:
            self._frame.clear()  # or the next frame would begin with half of this one
            raise

    def from_scratch(self, parts: Iterable[Segments], at: Transforms) -> Evaluated:
        """Return what irradiance is read from, from all current segments (an iterable of Segments)."""
        sums, new_suffixes, kept_prefixes = Sums.zeros(len(self.area)), Sums.zeros(len(self.area)), CutFlux()
        for segments in parts:
            self._deposit(segments, 1, sums)
            self._deposit(kept_prefixes.split_off(segments), 1, new_suffixes)
        each = carried(kept_prefixes.flux, kept_prefixes.count)
        return Evaluated.of_all(sums.flux, self.area, new_suffixes.flux.sum(axis=1), each)

    def _deposit(self, segments: Segments, sign: int, sums: Sums) -> None:
        _deposit(segments.hit_side, segments.flux, *self._corners, sign, sums.flux, sums.touched)
