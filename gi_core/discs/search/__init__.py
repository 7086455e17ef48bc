"""Which segments cross which discs, and their flux added to the discs' sums.

A new search is one file that follows `Search`, and one line here.
"""

from __future__ import annotations

from typing import Protocol

from gi_core.discs.search.brute_force import BruteForce
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.discs.search.predicate import Discs, Lines
from gi_core.discs.search.ray_cache import RayCache
from gi_core.photons.flux_sums import Sums


class Search(Protocol):
    """A search over the discs of one object, made once and used by every frame.

    All searches accept the same disc intersections bit for bit: each proposes candidates, `predicate.accepts` decides.
    """

    @property
    def discs(self) -> Discs:
        """The discs (n) that it was made from, in the object's space. Read by contact handling and instruments."""

    def __init__(self, discs: Discs) -> None:
        """Build over discs; no disc at all is allowed."""

    def accumulate(self, lines: Lines, sign: int, sums: Sums) -> int:
        """Add sign x flux of the lines to the sums of the discs that they cross; return the number of intersections.

        lines: (k) segments in the discs' space (`predicate.lines`), zero of them allowed; sign: 1 or -1; sums: int64
        fixed-point units, one row per disc. Threads call it at the same time, each with its own lines and sums.
        Called by tangent_plane for background and frames.
        """

    def summary(self) -> str:
        """Return a summary of the structures, beginning with the search's name. Shown by `info` and the panel."""


__all__ = ["DEFAULT", "SEARCHES", "Search"]

DEFAULT = "disc_index"

SEARCHES: dict[str, type[Search]] = {"disc_index": DiscIndex, "ray_cache": RayCache, "brute_force": BruteForce}
