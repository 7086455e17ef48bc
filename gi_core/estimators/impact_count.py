"""Impact Count (Patanaik and Mudur 1992; report 1.2, 2.5.1).

E of a face = flux of its hits / its area. E of a vertex = the area-weighted mean over its faces, which is their flux /
their area. A hit therefore adds to the three receivers of its face on the side of the hit, and no receiver is stale.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.pause import pause
from gi_core.discs.search import Search
from gi_core.discs.stale_receivers import ControlFacts
from gi_core.estimators.base import Setting
from gi_core.estimators.counting import Counts, Find, Place, hits_on_faces
from gi_core.model import Model
from gi_core.photons.flux_sums import CHUNK_BITS, BackgroundSums, CutFlux, Evaluated, FrameSums, Sums
from gi_core.photons.paths import Segments, bounced
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange, Wanted, split_at_cuts


@inlined
def _add(side, flux, first_channel, front, back, sign, sums, touched):
    """Add the flux (3,) of a hit to the receivers of its face."""
    if side >= 0:
        corners = front if side & 1 == 0 else back
        for v in range(3):
            r = corners[side >> 1, v]
            if r >= 0:
                touched[r >> CHUNK_BITS] = True
                for c in range(3):
                    sums[r, first_channel + c] += sign * flux[c]


@kernel
def _deposit(side, flux, lamp, front, back, sign, sums, touched):
    for k in range(len(side)):
        _add(side[k], flux[k], 3 * lamp[k], front, back, sign, sums, touched)


@kernel
def _take_out(side, flux, lamp, offsets, photon, vertex, front, back, sums, touched):
    """Subtract the hits of background paths behind the given vertices."""
    for j in range(len(photon)):
        for k in range(vertex[j], offsets[photon[j] + 1] - 1):
            _add(side[k + 1], flux[k], 3 * lamp[photon[j]], front, back, -1, sums, touched)


class ImpactCount:
    """See the module; radius and neighbours have no effect."""

    about = "Impact Count (Patanaik and Mudur 1992): the flux of the photons that hit a face, over the face's area."
    additive, controlled, on_faces = True, False, True
    smoothing: str | None = None
    bytes_per_hit = 0

    def __init__(self, model: Model, setting: Setting):
        self.model, self._corners = model, (model.surfaces.corner_front, model.surfaces.corner_back)
        # A receiver's area is a third of its faces; the mean divides by whole faces.
        self.area = 3 * model.object_receivers.areas
        self.photons = 0
        self.control_facts = ControlFacts(0.0, 0, 0)
        self.searches: list[Search] = []
        self._static, channels = model.surfaces.receiver_range(0).stop, model.emitters.lamps.channels
        self._background = BackgroundSums(self._static, channels, model.threads)
        self.subsets = self._background.subsets
        self._frame = FrameSums(len(self.area), channels, self._static, model.threads)

    def copied(self, model: Model, setting: Setting) -> ImpactCount:
        """Return a copy of all that was added, for a model of the same static part."""
        other = ImpactCount(model, setting)
        other._background, other.photons = self._background.copied(model.threads), self.photons
        other.subsets = other._background.subsets
        return other

    @staticmethod
    def summary(setting: Setting) -> str:
        return ""

    def build(self) -> None:
        """Nothing to build."""

    def add_background(self, segments: Segments, thread: int) -> None:
        """Add the hits of background segments. Thread safe for different `thread` numbers."""
        self._deposit(self._background.apart(segments), 1, self._background.added[thread])

    def prepare(self, photons: int) -> None:
        """Store the sums of all that was added, the first `photons`, as a photon subset."""
        self._background.store(photons)
        self.photons = photons

    def background(self, photons: int, direct: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Return sums (n, 3 G) int64 and area (n,) [m2] of static receivers without mobiles, of a photon subset."""
        return self._background.of(photons, direct), self.area[: self._static]

    def wanted(self, at: Transforms, mobiles: bool) -> Wanted:
        """Return the needs of a frame: path changes only."""
        return Wanted.changes(self.model, mobiles)

    def evaluate(self, frame: PoseChange) -> Evaluated:
        """Return the frame's sums and areas, valid until the next call."""
        added, new_suffixes = self._frame.added[0], self._frame.new_suffixes[0]
        t = frame.removed_suffixes
        paths, removed = t.paths, (t.photon, t.vertex, *self._corners)
        try:
            _take_out(paths.side, paths.flux, paths.lamp, paths.offsets, *removed, added.flux, added.touched)
            pause()
            self._deposit(frame.kept_prefixes, 1, added)
            self._deposit(frame.new_suffixes, 1, new_suffixes)
            before = self._background.of(frame.photons, frame.direct)
            return self._frame.collect(before, self.area, frame.kept_prefixes)._replace(direct=frame.direct)
        except BaseException:
            self._frame.clear()  # the next frame must not start with half of this one
            raise

    def counted(self, place: Place, find: Find) -> Counts:
        """Return the hits on the faces around a receiver."""
        return hits_on_faces(self.model, place, find)

    def from_scratch(self, parts: Iterable[Segments], at: Transforms, direct: bool = True) -> Evaluated:
        """Return sums and areas from all current segments (an iterable of Segments, whole photons each)."""
        lamps = self.model.emitters.lamps
        sums, new_suffixes = (Sums.zeros(len(self.area), lamps.channels) for _ in range(2))
        cut = CutFlux.none(lamps.count)
        for segments in parts:
            kept_prefixes, behind = split_at_cuts(segments)
            segments, behind = (s if direct else bounced(s) for s in (segments, behind))
            self._deposit(segments, 1, sums)
            self._deposit(behind, 1, new_suffixes)
            cut = cut.plus(kept_prefixes)
        new_flux = new_suffixes.flux.reshape(len(self.area), lamps.count, 3).sum(axis=2)
        return Evaluated.of_all(sums.flux, self.area, new_flux, cut, direct)

    def _deposit(self, segments: Segments, sign: int, sums: Sums) -> None:
        _deposit(segments.hit_side, segments.flux, segments.lamp, *self._corners, sign, sums.flux, sums.touched)
