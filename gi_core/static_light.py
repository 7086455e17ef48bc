"""What frames take the light of the static part from: their own photons, all of them, or what has been gathered."""

from __future__ import annotations

import math
from collections.abc import Generator

import numpy as np

from gi_core.background import Background
from gi_core.dilation import NONE_UNREACHED, Dilation
from gi_core.error_at_hand import noise_from_prefix, prefix_to_compare
from gi_core.model import Model
from gi_core.reference import Gathered
from gi_core.scene.errors import SceneError
from gi_core.static_gather import StaticGather

STATIC_LIGHT = ("all", "prefix", "gathered")


class StaticLight:
    """`kind` is one of STATIC_LIGHT; the frame's own light is carried over to it by `control_variate.py`."""

    def __init__(self):
        self.kind = STATIC_LIGHT[0]
        self.gathered: StaticGather | None = None
        self.unreached = NONE_UNREACHED  # receivers of the static part, by the light last looked at
        self._less_noise = False  # in gathered light than in all photons
        self.dilation: Dilation | None = None

    def choose(self, kind: str) -> None:
        """Take the light from elsewhere from now on. Raises SceneError for a kind that there is not."""
        if kind not in STATIC_LIGHT:
            raise SceneError(f"static_light must be one of {', '.join(STATIC_LIGHT)}, got {kind!r}")
        self.kind = kind

    @property
    def is_gathered(self) -> bool:
        """Whether frames start from gathered light: it is asked for, and has less noise than the photons."""
        return self.kind == "gathered" and self._less_noise

    def gather(self, model: Model, seed: int, photons, state: Gathered | None) -> StaticGather:
        """Return what is to be gathered, begun with `state` or gone on with; arguments are those of StaticGather.

        Raises ValueError for the state of another scene.
        """
        if self.gathered is None or state is not None:
            self.gathered = StaticGather(model, seed, photons, state)
        return self.gathered

    def compare(self, shown: Background | None) -> bool:
        """Compare the noise of gathered light with that of all photons; returns whether frames start from it.

        Photons too few to know their noise have more.
        """
        g, photons = self.gathered, 0 if shown is None else shown.estimate.photons
        if photons and g is not None and math.isfinite(g.noise):
            prefix = prefix_to_compare(shown.estimate.prefixes)
            E, theirs = shown.resting(photons), math.inf
            if prefix is not None:
                theirs = noise_from_prefix(E, shown.resting(prefix), photons, prefix, shown.weights)
            self._less_noise = g.noise < theirs
        return self.is_gathered

    def irradiance(self, shown: Background, photons: int) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] of static receivers without mobiles, for a frame of so many photons."""
        if self.is_gathered:
            return self.gathered.mean
        return shown.resting(photons if self.kind == "prefix" else shown.estimate.photons)

    def find_unreached(self, model: Model, size: float, shown: Background) -> Generator[None]:
        """Find static receivers that no light reaches, in steps, by this light; `size` is that of `dilation.py`."""
        if self.dilation is None:
            self.dilation = Dilation(model, size)
            yield
        self.unreached = yield from self.dilation.find_static(self.irradiance(shown, shown.estimate.photons))
