"""Arrays that frames are read out into, used again as soon as nobody holds them.

Most receivers are in every frame as they are at rest: what an array holds of these need not be written again. At few
photons, or in a mesh of many vertices, that is most of what reading out costs.
"""

from __future__ import annotations

import sys

import numpy as np

from gi_core.photons.flux_sums import chunks_of

KEPT = 2  # arrays: a frame is read out into one while the other is shown


class _Kept:
    """An array, and which of its chunks are those of the light at rest that it was last read out over."""

    def __init__(self, receivers: int, rest: np.ndarray | None):
        self.light, self.rest = np.empty((receivers, 3)), rest
        self.at_rest = np.zeros(chunks_of(receivers), bool)

    @property
    def holders(self) -> int:
        return sys.getrefcount(self.light)


_NOBODY = _Kept(0, None).holders  # besides this module: how Python counts differs from version to version


class LightPool:
    """For one thread at a time."""

    def __init__(self):
        self._kept: list[_Kept] = []

    def read_out(self, rest: np.ndarray, changed: np.ndarray, receivers: int, write) -> np.ndarray:
        """Return irradiance (receivers, 3) float64 whose chunks are written by write(out, wanted).

        rest: the light of receivers that have not changed, an array that is never written to; changed, wanted:
        (chunks,) bool. An array that anybody else holds is left as it is.
        """
        kept = self._free(rest, receivers)
        wanted = changed | ~kept.at_rest
        kept.at_rest[:] = False  # until all is written: an exception leaves nothing that is half done
        write(kept.light, wanted)
        np.logical_not(changed, out=kept.at_rest)
        return kept.light

    def _free(self, rest: np.ndarray, receivers: int) -> _Kept:
        for kept in self._kept:
            if kept.rest is rest and len(kept.light) == receivers and kept.holders == _NOBODY:
                return kept
        made = _Kept(receivers, rest)
        self._kept = [*self._kept[1 - KEPT :], made]
        return made
