"""Settings of the light of frames, besides those of the estimator; the size of a frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gi_core.gloss.source import QUADTREE, WAYS
from gi_core.scene.rules import FLAG, one_of

LIGHTS = ("best", "photons")
# Per receiver of a mobile, on average: an eighth to a third apart, so that little of a frame's time stays unused.
PATHS = (4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256)
PATHS_AT_REST = 64  # the default, with some 4 % of noise


class FrameSize(NamedTuple):
    """Photons and paths of a frame."""

    photons: int
    paths: int  # per receiver of a mobile; 0: photons light mobiles


@dataclass(eq=False)
class LightSetting:
    """`light` is one of LIGHTS. "photons": the estimator lights everything. "best": gathered light has a part.

    levels (G, 3): of the lamps; never written to; `asked` (G, 3): the same, or more where lamps hold targets.
    subset_only: frames of a photon subset start from the static light of that subset, as in the report. gloss: how rays
    at glossy receivers are kept, one of `gi_core.gloss.source.WAYS`.
    """

    levels: np.ndarray
    light: str = "photons"
    subset_only: bool = False
    gloss: str = QUADTREE

    def __post_init__(self) -> None:
        self.asked = self.levels

    def choose(self, light: str | None, subset_only: bool | None, gloss: str | None = None) -> None:
        """Change the settings; None keeps one. Raises SceneError for an unknown light or way of gloss."""
        self.gloss = self.gloss if gloss is None else one_of(WAYS).check("gloss", gloss)
        self.light = self.light if light is None else one_of(LIGHTS).check("light", light)
        self.subset_only = self.subset_only if subset_only is None else FLAG.check("subset_only", subset_only)

    @contextmanager
    def dimmed_to(self, levels: np.ndarray) -> Iterator[None]:
        """Set the levels (G, 3) of the lamps, from the next frame on; an exception takes them back."""
        before, self.asked, self.levels = (self.asked, self.levels), levels, levels
        try:
            yield
        except BaseException:
            self.asked, self.levels = before
            raise

    @property
    def takes_gathered(self) -> bool:
        """Whether frames may take gathered light of the static part, and at resting poses."""
        return self.light == "best" and not self.subset_only

    @property
    def takes_gathered_gloss(self) -> bool:
        """Whether frames may take gathered directions: single rays come from photons."""
        return self.takes_gathered and self.gloss == QUADTREE
