"""The place of a copy beside the objects that it copies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from app.draw.camera import Turntable
    from app.session.open_scene import OpenScene

GAP = 0.05  # of the box of the objects, between it and the copy's
MARGIN = 0.05  # of that box, per side: the copy may stand so deep in others, as it does in the floor


def beside(session: OpenScene, camera: Turntable, names: tuple[str, ...]) -> np.ndarray:
    """Return the shift (3,) [m] to a free place beside objects: right of them in the picture, left, behind, in front.

    Where no place is free, the copy may stand in others, and where none is in the scene's box, to the right.
    """
    low, high = session.box_of(names)
    shifts = sorted(_aside(high - low, session.scene.up), key=lambda shift: -float(shift @ camera.basis()[0]))
    inside = [s for s in shifts if _holds(session, low + s, high + s)]
    free = (s for s in inside if not _meets(session, low + s, high + s))
    return next(free, (inside or shifts)[0])


def _aside(size: np.ndarray, up: tuple[float, float, float]) -> Iterator[np.ndarray]:
    """Yield the shifts (3,) by a size (3,) and a gap, both ways along the two horizontal axes."""
    for axis in sorted(range(3), key=lambda k: abs(up[k]))[:2]:
        yield np.eye(3)[axis] * size * (1 + GAP)
        yield np.eye(3)[axis] * size * -(1 + GAP)


def _holds(session: OpenScene, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether a box lies in that of the scene."""
    margin = MARGIN * (high - low)
    return bool((low + margin >= session.chosen.low).all() and (high - margin <= session.chosen.high).all())


def _meets(session: OpenScene, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether a box overlaps that of a mobile or of a static face."""
    margin = MARGIN * (high - low)
    corners = session.scene.static.vertices[session.scene.static.faces]
    boxes = [session.box_of((name,)) for name in session.poses]
    lows = np.concatenate([corners.min(axis=1), *([a] for a, _ in boxes)])
    highs = np.concatenate([corners.max(axis=1), *([b] for _, b in boxes)])
    return bool(((lows < high - margin) & (highs > low + margin)).all(axis=1).any())
