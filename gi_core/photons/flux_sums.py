"""Integer flux sums of receivers: per thread, and of a frame (the background's plus the frame's changes).

Sums are kept per lamp: red, green and blue of lamp g are columns 3 g .. 3 g + 2 of 3 G.
Each thread adds to its own array and marks the chunks of receivers that it touches. A frame of few photons touches few
chunks; only those are summed, cleared and read out.

Sums are stored for photon subsets: the first 4,096, 8,192, ... photons, and all. A subset is a valid smaller solution.
A drag uses the largest one whose frame fits the time; at rest all photons are used.

Background segments that leave lamps have columns of their own, behind those of all others. So bounced light alone costs
no second search.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import CHEAP, run_ranges
from gi_core.photons.paths import Segments

LOWEST = 4096  # photons: the noise of fewer is too high to be useful


def next_level(photons: int) -> int:
    """Return the smallest level (4,096, 8,192, ...) above a number of photons."""
    level = LOWEST
    while level <= photons:
        level *= 2
    return level


def is_level(photons: int) -> bool:
    return photons >= LOWEST and photons & (photons - 1) == 0


class SubsetStore(dict):
    """Results by photon subset: all levels, and the count stored last."""

    def __setitem__(self, photons: int, kept) -> None:
        for n in [n for n in self if not is_level(n) and n != photons]:
            del self[n]
        super().__setitem__(photons, kept)


class BackgroundSums:
    """Sums of n static receivers, of G lamps: 3 G columns, `channels`."""

    def __init__(self, receivers: int, channels: int, threads: int):
        self.added = ThreadSums(receivers, 2 * channels, threads)  # segments as apart() returns them
        self.subsets = SubsetStore()  # (n, 3 G) int64, of all segments
        self._bounced = SubsetStore()  # the same without segments that leave lamps
        self._sums = np.zeros((receivers, 2 * channels), np.int64)

    @property
    def channels(self) -> int:
        return self._sums.shape[1] // 2

    def copied(self, threads: int) -> BackgroundSums:
        """Return a copy; neither changes the other later."""
        self.added.move_to(self._sums)
        other = BackgroundSums(len(self._sums), self.channels, threads)
        other._sums = self._sums.copy()
        other.subsets, other._bounced = SubsetStore(self.subsets), SubsetStore(self._bounced)
        return other

    def apart(self, segments: Segments) -> Segments:
        """Return background segments with the columns that they add to."""
        direct = np.where(segments.direct, self.channels // 3, 0).astype(np.uint8)
        return segments._replace(lamp=segments.lamp + direct)

    def store(self, photons: int) -> None:
        """Store the sums of all that was added, the first `photons`, as a photon subset."""
        self.added.move_to(self._sums)
        bounced, direct = self._sums[:, : self.channels], self._sums[:, self.channels :]
        self.subsets[photons], self._bounced[photons] = bounced + direct, bounced.copy()

    def of(self, photons: int, direct: bool) -> np.ndarray:
        """Return the sums (n, 3 G) int64 of a subset; direct: with segments that leave lamps."""
        return (self.subsets if direct else self._bounced)[photons]


CHUNK_BITS = 3  # a chunk is 8 receivers: 192 bytes of sums
CHUNK = 1 << CHUNK_BITS
NOWHERE = np.empty((0, 0), np.int64)
NOT_ADDITIVE = -1  # the receiver's sums are not background - removed suffixes + new suffixes


def chunks_of(receivers: int) -> int:
    return (receivers + CHUNK - 1) >> CHUNK_BITS


class IntersectionLog(NamedTuple):
    """Record of the disc intersections that a kernel accumulates; empty arrays record nothing."""

    line: np.ndarray  # (room,) int32, index among the lines of the call
    receiver: np.ndarray  # (room,) int32, index within the object
    distance: np.ndarray  # (room,) float32 [m], along the line
    count: np.ndarray  # (1,) int64, intersections, including those beyond the room

    @classmethod
    def of(cls, room: int) -> IntersectionLog:
        """Return a record with room for that many intersections."""
        line, receiver = np.empty(room, np.int32), np.empty(room, np.int32)
        return cls(line, receiver, np.empty(room, np.float32), np.zeros(1, np.int64))


class Sums(NamedTuple):
    """Flux sums of a range of receivers, the target of kernels."""

    flux: np.ndarray  # (n, 3 G) int64, fixed-point units
    touched: np.ndarray  # (chunks,) bool, of all receivers
    first: int  # the receiver of row 0 of `flux`
    log: IntersectionLog

    @classmethod
    def zeros(cls, receivers: int, channels: int = 3) -> Sums:
        return cls(
            np.zeros((receivers, channels), np.int64), np.zeros(chunks_of(receivers), bool), 0, IntersectionLog.of(0)
        )

    def of(self, rows: slice) -> Sums:
        """Return a view of the receivers in `rows`."""
        return self._replace(flux=self.flux[rows], first=self.first + rows.start)


class CutFlux(NamedTuple):
    """Flux of the cut photons at their cuts."""

    flux: np.ndarray  # (G,) int64, fixed-point units, summed over channels
    photons: np.ndarray  # (G,) int64

    @classmethod
    def none(cls, lamps: int) -> CutFlux:
        """Return the flux of no photon."""
        return cls(np.zeros(lamps, np.int64), np.zeros(lamps, np.int64))

    def plus(self, kept_prefixes: Segments) -> CutFlux:
        """Return this and the flux of more cut segments."""
        flux, lamp = kept_prefixes.flux, kept_prefixes.lamp
        more = [flux[lamp == g].sum(dtype=np.int64) for g in range(len(self.photons))]
        return CutFlux(self.flux + more, self.photons + np.bincount(lamp, minlength=len(self.photons)))

    def per_photon(self, levels: np.ndarray) -> float:
        """Return the mean flux of a cut photon at levels (G,), summed over channels; each lamp counts by its flux."""
        flux = self.flux * levels
        total = max(flux.sum(), 1.0)
        return float((flux / total * (flux / np.maximum(self.photons, 1))).sum())


class Evaluated(NamedTuple):
    """Sums and areas of a frame (irradiance = sums / area), valid in the chunks that differ from the background."""

    sums: np.ndarray  # (R, 3 G) int64, fixed-point units
    area: np.ndarray  # (R,) float64 [m2]
    changed: np.ndarray  # (chunks,) bool
    new_flux: np.ndarray  # (R, G) int64, of new suffixes, summed over channels; or NOT_ADDITIVE in the first column
    cut: CutFlux
    direct: bool = True  # segments that leave lamps count

    @classmethod
    def of_all(
        cls, sums: np.ndarray, area: np.ndarray, new_flux: np.ndarray, cut: CutFlux, direct: bool = True
    ) -> Evaluated:
        """Return sums in which all chunks count as changed."""
        return cls(sums, area, np.ones(chunks_of(len(area)), bool), new_flux, cut, direct)


class ThreadSums:
    """Zeroed sums, one per thread, allocated at first use."""

    def __init__(self, receivers: int, channels: int, threads: int):
        self._shape = receivers, channels
        self._parts: list[Sums | None] = [None] * threads

    def __getitem__(self, thread: int) -> Sums:
        if self._parts[thread] is None:
            self._parts[thread] = Sums.zeros(*self._shape)
        return self._parts[thread]

    @property
    def used(self) -> list[Sums]:
        """The sums of the threads that have share."""
        return [part for part in self._parts if part is not None]

    def move_to(self, total: np.ndarray) -> None:
        """Add all sums to `total` (R, 3 G) int64 and clear them. Integers: the order does not matter."""
        for part in self.used:
            _move(np.flatnonzero(part.touched), part.touched, part.flux, total, NOWHERE)


@kernel
def _move(chunks, touched, flux, total, new_flux):
    """Add touched ones of chunks to `total`, and summed over channels to `new_flux` if not empty; clear them."""
    for chunk in chunks:
        if touched[chunk]:
            touched[chunk] = False
            for r in range(chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(flux))):
                for g in range(flux.shape[1] // 3):
                    if len(new_flux):
                        new_flux[r, g] += flux[r, 3 * g] + flux[r, 3 * g + 1] + flux[r, 3 * g + 2]
                    for c in range(3):
                        total[r, 3 * g + c] += flux[r, 3 * g + c]
                        flux[r, 3 * g + c] = 0


class FrameSums:
    """Sums of a frame: `added` to the background's sums per thread, and those of `new_suffixes`."""

    def __init__(self, receivers: int, channels: int, static: int, threads: int):
        self._sums, self._new_flux = (np.zeros((receivers, n), np.int64) for n in (channels, channels // 3))
        self._static, self._threads = static, threads
        self.clear()

    def clear(self) -> None:
        """Clear all that was added."""
        self.added, self.new_suffixes = (ThreadSums(*self._sums.shape, self._threads) for _ in range(2))

    def collect(self, background: np.ndarray, area: np.ndarray, kept_prefixes: Segments) -> Evaluated:
        """Return background sums (static receivers, 3 G) int64 plus all that was added, and clear the latter.

        kept_prefixes: the cut segments. The sums are valid until the next call. Receivers
        on mobiles always count as changed.
        """
        changed = np.zeros(chunks_of(len(self._sums)), bool)
        changed[self._static >> CHUNK_BITS :] = len(self._sums) > self._static
        added, new_suffixes = self.added.used, self.new_suffixes.used
        for part in (*added, *new_suffixes):
            changed |= part.touched

        chunks = np.flatnonzero(changed)

        def work(_, first, last):
            share = chunks[first:last]
            _start(share, background, self._sums, self._new_flux)
            for part in added:
                _move(share, part.touched, part.flux, self._sums, NOWHERE)
            for part in new_suffixes:
                _move(share, part.touched, part.flux, self._sums, self._new_flux)

        run_ranges(work, len(chunks), self._threads, CHEAP)
        cut = CutFlux.none(self._sums.shape[1] // 3).plus(kept_prefixes)
        return Evaluated(self._sums, area, changed, self._new_flux, cut)


@kernel
def _start(chunks, background, sums, new_flux):
    """Begin the sums of chunks with the background's, 0 on mobiles, and those of new suffixes with 0."""
    for chunk in chunks:
        for r in range(chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(sums))):
            for g in range(new_flux.shape[1]):
                new_flux[r, g] = 0
                for c in range(3):
                    sums[r, 3 * g + c] = background[r, 3 * g + c] if r < len(background) else 0
