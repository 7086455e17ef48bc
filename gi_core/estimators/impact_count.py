"""Impact Count (Patanaik and Mudur 1992; report 1.2, 2.5.1).

E of a face = flux of its hits / its area. E of a vertex = the area-weighted mean over its faces, which is their flux /
their area. A hit therefore adds to the three receivers of its face on the side of the hit, and no receiver is stale.
"""

from __future__ import annotations

from collections.abc import Iterable

from gi_core.base.jit import inlined, kernel
from gi_core.base.pause import pause
from gi_core.estimators.base import AdditiveEstimator, Setting
from gi_core.estimators.counting import Counts, Find, Place, hits_on_faces
from gi_core.model import Model
from gi_core.photons.flux_sums import CHUNK_BITS, CutFlux, Evaluated, Sums
from gi_core.photons.paths import Segments, bounced
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange, split_at_cuts


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
def _deposit(side, flux, lamp, front, back, sums, touched):
    for k in range(len(side)):
        _add(side[k], flux[k], 3 * lamp[k], front, back, 1, sums, touched)


@kernel
def _take_out(side, flux, lamp, offsets, photon, vertex, front, back, sums, touched):
    """Subtract the hits of background paths behind the given vertices."""
    for j in range(len(photon)):
        for k in range(vertex[j], offsets[photon[j] + 1] - 1):
            _add(side[k + 1], flux[k], 3 * lamp[photon[j]], front, back, -1, sums, touched)


class ImpactCount(AdditiveEstimator):
    """See the module; radius and neighbours have no effect."""

    about = "Impact Count (Patanaik and Mudur 1992): the flux of the photons that hit a face, over the face's area."
    on_faces = True

    def __init__(self, model: Model, setting: Setting):
        # A receiver's area is a third of its faces; the mean divides by whole faces.
        super().__init__(model, setting, 3 * model.object_receivers.areas)
        self._corners = model.surfaces.corner_front, model.surfaces.corner_back

    def add_background(self, segments: Segments, thread: int) -> None:
        self._deposit(self._background.apart(segments), self._background.added[thread])

    def evaluate(self, frame: PoseChange) -> Evaluated:
        added, new_suffixes = self._frame.added[0], self._frame.new_suffixes[0]
        t = frame.removed_suffixes
        paths, removed = t.paths, (t.photon, t.vertex, *self._corners)
        try:
            _take_out(paths.side, paths.flux, paths.lamp, paths.offsets, *removed, added.flux, added.touched)
            pause()
            self._deposit(frame.kept_prefixes, added)
            self._deposit(frame.new_suffixes, new_suffixes)
            before = self._background.of(frame.photons, frame.direct)
            return self._frame.collect(before, self.area, frame.kept_prefixes)._replace(direct=frame.direct)
        except BaseException:
            self._frame.clear()  # the next frame must not start with half of this one
            raise

    def counted(self, place: Place, find: Find) -> Counts:
        return hits_on_faces(self.model, place, find)

    def from_scratch(self, parts: Iterable[Segments], at: Transforms, direct: bool = True) -> Evaluated:
        lamps = self.model.emitters.lamps
        sums, new_suffixes = (Sums.zeros(len(self.area), lamps.channels) for _ in range(2))
        cut = CutFlux.none(lamps.count)
        for segments in parts:
            kept_prefixes, behind = split_at_cuts(segments)
            segments, behind = (s if direct else bounced(s) for s in (segments, behind))
            self._deposit(segments, sums)
            self._deposit(behind, new_suffixes)
            cut = cut.plus(kept_prefixes)
        new_flux = new_suffixes.flux.reshape(len(self.area), lamps.count, 3).sum(axis=2)
        return Evaluated.of_all(sums.flux, self.area, new_flux, cut, direct)

    def _deposit(self, segments: Segments, sums: Sums) -> None:
        _deposit(segments.hit_side, segments.flux, segments.lamp, *self._corners, sums.flux, sums.touched)
