"""The search that has taken least time so far, for as many lines as there are.

Grids cost the same a line however few there are; spheres cost less a line the more of them there are, and less
where discs crowd (report 2.7, tables 2.2 to 2.4). So every candidate is tried in turn on the calls that come,
by the number of their lines; what it adds has the same bits, so no trial is for nothing. Nobody who waits for a
frame is made to wait for a trial: while not `patient`, the nearest number of lines that is known decides, and
`rehearse()` makes up for it at rest.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from gi_core.disc_search.crossing import Discs, Lines, share
from gi_core.disc_search.disc_index import DiscIndex
from gi_core.disc_search.ray_cache import RayCache
from gi_core.sums import Sums

TRIALS = 3  # calls, of which the fastest counts: other programs may well have the processor during one of them
FEW = 64  # lines: the first candidate, not worth a clock


class Auto:
    """Chooses between candidates; a share of the work is some of the lines, whichever is chosen."""

    parts_share_lines = False

    def __init__(self, discs: Discs, pretest: str = "none", clock: Callable[[], float] = time.perf_counter):
        """clock: of seconds. Several threads may call splat(): each time is one thread's own."""
        self.discs, self._clock, self.patient = discs, clock, True
        self.candidates = {"disc_index": DiscIndex(discs, pretest), "ray_cache": RayCache(discs, pretest)}
        self._taken: dict[tuple[int, str], tuple[int, float]] = {}  # (size class, name) -> trials, seconds a line

    def splat(self, lines: Lines, sign: int, sums: Sums, part: int = 0, parts: int = 1) -> int:
        """Add sign x flux of lines to the sums of the discs they cross; see `gi_core.disc_search`."""
        if parts > 1:
            first, last = share(len(lines.low), part, parts)
            lines = Lines(*(a[first:last] for a in lines))
        n = len(lines.low)
        if n < FEW:
            return next(iter(self.candidates.values())).splat(lines, sign, sums)
        name = self.choice(n)
        return self._timed(name, lines, sign, sums)

    def _timed(self, name: str, lines: Lines, sign: int, sums: Sums) -> int:
        n, started = len(lines.low), self._clock()
        found = self.candidates[name].splat(lines, sign, sums)
        trials, best = self._taken.get((_class(n), name), (0, float("inf")))
        self._taken[_class(n), name] = trials + 1, min(best, (self._clock() - started) / n)
        return found

    def choice(self, n: int) -> str:
        """Return the candidate for n lines: one that is still to be tried if there is time, else the fastest."""
        size = _class(n)
        untried = self._untried(size) if self.patient else None
        if untried:
            return untried
        taken = dict(self._taken)  # other threads add to it
        sizes = [k for k in {key[0] for key in taken} if all((k, name) in taken for name in self.candidates)]
        if not sizes:
            return next(iter(self.candidates))
        near = min(sizes, key=lambda k: (abs(k - size), k))
        return min(self.candidates, key=lambda name: taken[near, name][1])

    def _untried(self, size: int) -> str | None:
        trials = {name: self._taken.get((size, name), (0, 0.0))[0] for name in self.candidates}
        return next((name for name, n in trials.items() if n < TRIALS), None)

    def rehearse(self, n: int, ready: Callable[[int], Lines]) -> Iterator[None]:
        """Try what has not been tried on n lines or fewer, a trial a step; ready(m) returns the first m of them."""
        for size in range(_class(FEW), _class(max(n, 1)) + 1):
            m = min(n, 2 << 2 * size)  # the middle of the class
            while name := self._untried(size):
                self._timed(name, ready(m), 1, Sums.zeros(len(self.discs.positions)))
                yield

    def told(self) -> str:
        """Return in words what was chosen and why: what each has taken, by the number of lines at a time."""
        taken, parts = dict(self._taken), []
        for size in sorted({key[0] for key in taken}):
            took = sorted((taken[size, name][1], name) for name in self.candidates if (size, name) in taken)
            words = " against ".join(f"{name} {1e6 * seconds:.2f}" for seconds, name in took)
            parts.append(f"{words} us a segment at {1 << 2 * size:,} to {(4 << 2 * size) - 1:,} at a time")
        built = "; ".join(search.told() for search in self.candidates.values())
        return f"auto: {'; '.join(parts) or 'nothing timed yet'}. {built}"


def _class(n: int) -> int:
    """Return the size class of n lines: powers of four."""
    return (n.bit_length() - 1) // 2
