"""Segments to be drawn, each kept, removed or added by the mobiles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from gi_core.base.vectors import dot
from gi_core.photons.paths import Segments


class Strokes(NamedTuple):
    """Segments to be drawn. Places are relative to `Model.origins[0]`."""

    ends: np.ndarray  # (n, 2, 3) float64 [m], from the light on
    kind: np.ndarray  # (n,) int64: KEPT, REMOVED, ADDED of gi_core.photons.paths
    hits: np.ndarray  # (n,) bool: the second end lies on a surface


Arrays = TypeVar("Arrays", Segments, Strokes)


def strokes(s: Segments, kind: int) -> Strokes:
    """Return segments from where they begin to where they end."""
    origin, end, hit = (a.astype(np.float64) for a in (s.origin, s.end, s.hit))
    along = end - origin
    length = np.sqrt(dot(along, along))
    begin = np.clip(s.low / np.maximum(length, 1e-30), 0.0, 1.0)
    ends = np.stack([origin + begin[:, None] * along, hit], axis=1)
    return Strokes(ends, np.full(len(origin), kind), s.hit_side >= 0)


def joined(parts: Sequence[Arrays]) -> Arrays:
    """Return segments or strokes as one."""
    return type(parts[0])(*(np.concatenate(a) for a in zip(*parts, strict=True)))
