"""Size of a frame: its photons, and the paths that light its mobiles."""

from __future__ import annotations

from typing import NamedTuple

PATHS = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)  # per receiver of a mobile
PATHS_AT_REST = 64  # the default, with some 4 % of noise


class FrameSize(NamedTuple):
    """Photons and paths of a frame."""

    photons: int
    paths: int  # per receiver of a mobile; 0: photons light mobiles
