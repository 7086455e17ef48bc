"""The place of a copy beside the objects that it copies."""

from __future__ import annotations

from itertools import groupby, product
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from app.draw.camera import Turntable
    from app.session.open_scene import OpenScene

GAP = 0.05  # of the box of the objects, between it and the copy's
FARTHEST = 4  # place tried along each way
MARGIN = 0.05  # of that box, per side: the copy may stand so deep in others, as it does in the floor


def beside(session: OpenScene, camera: Turntable, names: tuple[str, ...]) -> np.ndarray:
    """Return the shift (3,) [m] to a free place beside objects: right of them in the picture, left, behind, in front.

    Then places further away, on a grid. Where no place is free, the copy may stand in others, and where none is in the
    scene's box, to the right.
    """
    low, high = session.box_of(names)
    shifts = _aside(high - low, session.scene.up, camera.basis()[0])
    inside = [s for s in shifts if _holds(session, low + s, high + s)]
    others = _boxes(session)
    free = (s for s in inside if not _meets(others, low + s, high + s))
    return next(free, (inside or shifts)[0])


def _aside(size: np.ndarray, up: tuple[float, float, float], right: np.ndarray) -> list[np.ndarray]:
    """Return shifts (3,) by multiples of a size (3,) and a gap along the two horizontal axes, the nearest first.

    Of places equally near, the first one is that farthest along `right` (3,).
    """
    a, b = np.diag(size * (1 + GAP))[sorted(range(3), key=lambda k: abs(up[k]))[:2]]
    ways = range(-FARTHEST, FARTHEST + 1)
    near = sorted(((i, j) for i, j in product(ways, ways) if (i, j) != (0, 0)), key=lambda p: abs(p[0]) + abs(p[1]))
    rings = groupby(near, key=lambda p: abs(p[0]) + abs(p[1]))
    return [s for _, ring in rings for s in sorted((i * a + j * b for i, j in ring), key=lambda s: -float(s @ right))]


def _holds(session: OpenScene, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether a box lies in that of the scene."""
    margin = MARGIN * (high - low)
    return bool((low + margin >= session.chosen.low).all() and (high - margin <= session.chosen.high).all())


def _boxes(session: OpenScene) -> tuple[np.ndarray, np.ndarray]:
    """Return corners low and high (n, 3) [m] of the boxes of static faces, mobiles, and copies not yet on show."""
    from gi_core.files.edits import Duplicate

    corners = session.scene.static.vertices[session.scene.static.faces]
    boxes = [session.box_of((name,)) for name in session.poses]
    for edit in session.edits:
        if isinstance(edit, Duplicate) and edit.name not in session.poses and edit.of in session.poses:
            shift = np.subtract(edit.pose.position, session.poses[edit.of].position)
            low, high = session.box_of((edit.of,))
            boxes.append((low + shift, high + shift))
    lows = np.concatenate([corners.min(axis=1), *([a] for a, _ in boxes)])
    highs = np.concatenate([corners.max(axis=1), *([b] for _, b in boxes)])
    return lows, highs


def _meets(others: tuple[np.ndarray, np.ndarray], low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether a box overlaps one of the others."""
    margin, (lows, highs) = MARGIN * (high - low), others
    return bool(((lows < high - margin) & (highs > low + margin)).all(axis=1).any())
