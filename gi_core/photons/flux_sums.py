"""Integer sums at receivers that several threads add to, and a frame's: the background's plus what was added.

Each thread adds to an array of its own and marks the chunks of receivers it touched. A frame at few photons
changes few of them: only those are summed, cleared, and read out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges

CHUNK_BITS = 6  # a chunk is 64 receivers: 1.5 kB of sums
CHUNK = 1 << CHUNK_BITS
CHUNK_GRAIN = 256  # chunks a thread
NOWHERE = np.empty(0, np.int64)
NOT_TOLD = -1  # the receiver's sums are not those of the background less tails plus branches


def chunks_of(receivers: int) -> int:
    return (receivers + CHUNK - 1) >> CHUNK_BITS


class Log(NamedTuple):
    """What kernels write down of the crossings that they add; nothing where there is no room at all."""

    line: np.ndarray  # (room,) int32, counted within the lines of the call
    receiver: np.ndarray  # (room,) int32, counted within the object
    distance: np.ndarray  # (room,) float32 [m], along the line
    count: np.ndarray  # (1,) int64, crossings; those that there was no room for included

    @classmethod
    def of(cls, room: int) -> Log:
        """Return a log for so many crossings."""
        line, receiver = np.empty(room, np.int32), np.empty(room, np.int32)
        return cls(line, receiver, np.empty(room, np.float32), np.zeros(1, np.int64))


class Sums(NamedTuple):
    """Sums of some receivers, as kernels add to them."""

    flux: np.ndarray  # (n, 3) int64, fixed-point units
    touched: np.ndarray  # (chunks,) bool, of all receivers
    first: int  # the receiver that row 0 of `flux` stands for
    log: Log

    @classmethod
    def zeros(cls, receivers: int) -> Sums:
        return cls(np.zeros((receivers, 3), np.int64), np.zeros(chunks_of(receivers), bool), 0, Log.of(0))

    def of(self, rows: slice) -> Sums:
        """Return a view of the receivers in `rows`."""
        return self._replace(flux=self.flux[rows], first=self.first + rows.start)


class Evaluated(NamedTuple):
    """What a frame's irradiance is read from: sums / area, valid in the chunks that differ from the background."""

    sums: np.ndarray  # (R, 3) int64, fixed-point units
    area: np.ndarray  # (R,) float64 [m2]
    changed: np.ndarray  # (chunks,) bool
    brought: np.ndarray  # (R,) int64, of the sums what branches have brought, all channels together; or NOT_TOLD
    carried: float  # flux units that a cut photon carries on average, all channels together

    @classmethod
    def of_all(cls, sums: np.ndarray, area: np.ndarray, brought: np.ndarray, each: float) -> Evaluated:
        """Return one in which all counts as changed."""
        return cls(sums, area, np.ones(chunks_of(len(area)), bool), brought, each)


def carried(flux: int, photons: int) -> float:
    """Return `Evaluated.carried` of so many photons cut that carry so much."""
    return flux / max(photons, 1)


class ThreadSums:
    """Sums of zero, one a thread, made when first used."""

    def __init__(self, receivers: int, threads: int):
        self._receivers = receivers
        self._parts: list[Sums | None] = [None] * threads

    def __getitem__(self, thread: int) -> Sums:
        if self._parts[thread] is None:
            self._parts[thread] = Sums.zeros(self._receivers)
        return self._parts[thread]

    def move_to(self, total: np.ndarray) -> None:
        """Add all to `total` (R, 3) int64 and start from zero again. Integers: the order does not matter."""
        for part in self._parts:
            if part is not None:
                _move(part.touched, part.flux, total, NOWHERE, 0, len(part.touched))


@kernel
def _move(touched, flux, total, brought, first, last):
    """Add touched chunks of `flux` to `total`, all channels together to `brought` if it has room, and clear them."""
    for chunk in range(first, last):
        if touched[chunk]:
            touched[chunk] = False
            for r in range(chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(flux))):
                if len(brought):
                    brought[r] += flux[r, 0] + flux[r, 1] + flux[r, 2]
                for c in range(3):
                    total[r, c] += flux[r, c]
                    flux[r, c] = 0


class FrameSums:
    """Sums of a frame: what threads have `added` to those of the background, and what `branches` have brought."""

    def __init__(self, receivers: int, static: int, threads: int):
        self._sums, self._static, self._threads = np.zeros((receivers, 3), np.int64), static, threads
        self._brought = np.zeros(receivers, np.int64)
        self.clear()

    def clear(self) -> None:
        """Forget what was added."""
        self.added, self.branches = (ThreadSums(len(self._sums), self._threads) for _ in range(2))

    def collect(self, background: np.ndarray, area: np.ndarray, heads: np.ndarray) -> Evaluated:
        """Return background (static receivers, 3) int64 plus all that was added, which is then zero again.

        heads: flux (n, 3) int32 of photons where they are cut. The sums are valid until the next call. Receivers on
        mobiles always count as changed.
        """
        changed = np.zeros(chunks_of(len(self._sums)), bool)
        changed[self._static >> CHUNK_BITS :] = len(self._sums) > self._static
        added, branches = ([sums[k] for k in range(self._threads)] for sums in (self.added, self.branches))
        for part in (*added, *branches):
            changed |= part.touched

        def work(_, first, last):
            _start(changed, background, self._sums, self._brought, first, last)
            for part in added:
                _move(part.touched, part.flux, self._sums, NOWHERE, first, last)
            for part in branches:
                _move(part.touched, part.flux, self._sums, self._brought, first, last)

        run_ranges(work, len(changed), self._threads, CHUNK_GRAIN)
        each = carried(int(heads.sum(dtype=np.int64)), len(heads))
        return Evaluated(self._sums, area, changed, self._brought, each)


@kernel
def _start(changed, background, sums, brought, first, last):
    for chunk in range(first, last):
        if changed[chunk]:
            for r in range(chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(sums))):
                brought[r] = 0
                for c in range(3):
                    sums[r, c] = background[r, c] if r < len(background) else 0
