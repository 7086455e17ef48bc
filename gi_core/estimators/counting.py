"""The segments that an estimator counts at one receiver, for the window: across its disc, or hits near it or on faces.

Of a disc under artifact control, the region that light can reach counts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from gi_core.base.random_numbers import basis
from gi_core.base.vectors import dot
from gi_core.discs.region import COS, SIN
from gi_core.model import Model
from gi_core.photons.paths import Segments
from gi_core.rays.accelerator import Transforms

CORNERS = 48  # of a drawn disc

Parts = tuple[Segments, Segments, Segments]  # kept, removed, added
# Rows (m,) of lines (origin, end (n, 3), side (n,) at the end) that count, and the distance (m,) [m] along them.
Rule = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class Find(Protocol):
    """A search of the frame's segments."""

    def __call__(self, rule: Rule, of_hits: bool = False, current: bool = False) -> Parts:
        """Return the segments that a rule selects.

        of_hits: by where they end. current: cut segments as they are now, ending on a mobile, in place of their old
        part.
        """


class Place(NamedTuple):
    """A receiver in the world."""

    row: int
    object: int
    position: np.ndarray  # (3,) float64 [m]
    normal: np.ndarray  # (3,) unit
    radius: float  # [m], of the frame's setting
    at: Transforms
    area: float  # [m2] by which the picture's estimate divides; 0: of a mobile that paths light
    photons: int  # of the picture ...
    searched: int  # ... of which these are searched


class Counts(NamedTuple):
    """What counts at a receiver."""

    parts: Parts
    outline: np.ndarray  # (m, 2, 3) float64 [m], lines round the area that the flux is divided by
    about: str  # the rule in words


def crossing(place: Place, before: float) -> Rule:
    """Return the rule of a disc: lines that cross it from its front, or end at most `before` [m] before it."""
    position, normal, eps = place.position, place.normal, np.float32(before)

    def rule(origin: np.ndarray, end: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = (dot(p - position.astype(np.float32), normal.astype(np.float32)) for p in (origin, end))
        rows = np.flatnonzero((a > 0) & (b <= eps) & (b < a))
        o, e = origin[rows].astype(np.float64), end[rows].astype(np.float64)
        length = np.sqrt(dot(e - o, e - o))
        a, b = dot(o - position, normal), dot(e - position, normal)
        t = a / np.maximum(a - b, 1e-30) * length
        off = o + (t / np.maximum(length, 1e-30))[:, None] * (e - o) - position
        inside = (t <= length + eps) & (dot(off, off) < place.radius * place.radius)
        return rows[inside], t[inside]

    return rule


def ends(wanted: np.ndarray, origin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of wanted lines (n,) bool, and their whole lengths [m]."""
    rows = np.flatnonzero(wanted)
    along = end[rows].astype(np.float64) - origin[rows]
    return rows, np.sqrt(dot(along, along))


def hits_on_faces(model: Model, place: Place, find: Find) -> Counts:
    """Return the hits on the faces around a receiver."""
    s, o = model.surfaces, place.object
    front, back = (np.flatnonzero((c == place.row).any(axis=1)) for c in (s.corner_front, s.corner_back))
    faces, sides = np.concatenate([front, back]), np.concatenate([2 * front, 2 * back + 1])
    R, shift = place.at.rotation[o], place.at.position[o]
    corners = s.vertices[o][s.faces[o][faces - s.first_face[o]]] @ R.T + shift
    outline = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    parts = find(lambda origin, end, side: ends(np.isin(side, sides), origin, end), of_hits=True)
    return Counts(parts, outline, f"hits on the {len(faces)} faces around")


def polygon(reach: np.ndarray, normal: np.ndarray, radius: float) -> np.ndarray:
    """Return the rim (RAYS, 2, 3) [m], round a receiver, of the region (RAYS, 2) uint8 of its disc."""
    frame = np.array(basis(*normal)).reshape(2, 3)
    rim = radius / 255 * reach[:, 1, None] * (np.outer(COS, frame[0]) + np.outer(SIN, frame[1]))
    return np.stack([rim, np.roll(rim, -1, axis=0)], axis=1)


def circle(place: Place, radius: float) -> np.ndarray:
    """Return the rim (CORNERS, 2, 3) [m] of a disc round a receiver."""
    n = place.normal / np.linalg.norm(place.normal)
    side = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    side /= np.linalg.norm(side)
    turn = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    rim = place.position + radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(n, side)))
    return np.stack([rim, np.roll(rim, -1, axis=0)], axis=1)
