"""Receivers that light cannot reach: found at rest, filled from lit ones beside them in pictures."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from gi_core.display.dilation import NONE_UNREACHED, Dilation, Drawn, dilated
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms


class UnreachedReceivers:
    """`static` are those of the static part, by the light of the last search."""

    def __init__(self, model: Model):
        self.static = NONE_UNREACHED
        self._model = model
        self._dilation: Dilation | None = None

    def find(self, size: float, light: np.ndarray) -> Generator[None]:
        """Find static ones in steps by irradiance (n, 3) without mobiles; `size` [m] as in `dilation.py`.

        light: of all lamps; without one of them, its places would be dark, not unreached.
        """
        if self._dilation is None:
            self._dilation = Dilation(self._model, size)
            yield
        self.static = yield from self._dilation.find_static(light)

    def drawn(self, irradiance: np.ndarray, at: Transforms) -> Drawn:
        """Return irradiance (R, 3) at poses for pictures, unreached ones filled; as it is before the search."""
        if self._dilation is None:
            return Drawn(irradiance, None)
        return dilated(irradiance, self.static, self._dilation.find_moved(irradiance, at))
