"""Size of a frame: its photons, and the paths that light its mobiles."""

from __future__ import annotations

from typing import NamedTuple

# Per receiver of a mobile, on average: an eighth to a third apart, so that little of a frame's time stays unused.
PATHS = (4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256)
PATHS_AT_REST = 64  # the default, with some 4 % of noise


class FrameSize(NamedTuple):
    """Photons and paths of a frame."""

    photons: int
    paths: int  # per receiver of a mobile; 0: photons light mobiles
