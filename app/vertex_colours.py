"""What is drawn: each object's vertices split where their light or paint differs, and their colours.

One mesh vertex is drawn once for every combination of front receiver, back receiver, reflectance and
emission that meets there; colours are linear radiance, one for each side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.radiosity import exitant_radiance
from gi_core.surfaces import Surfaces


class DrawMesh(NamedTuple):
    """One object, ready for a vertex buffer; positions are in object space."""

    positions: np.ndarray  # (D, 3) float32 [m]
    triangles: np.ndarray  # (F, 3) int32, into positions
    front: np.ndarray  # (D,) int32 receiver on the front
    back: np.ndarray  # (D,) int32 receiver on the back, -1 where one-sided
    reflectance: np.ndarray  # (D, 3) float64 rho
    emission: np.ndarray  # (D, 3) float64 Le [W/m2/sr]


def draw_meshes(surfaces: Surfaces) -> tuple[DrawMesh, ...]:
    """Return one DrawMesh an object: the static part, then the mobiles in their order."""
    return tuple(_draw_mesh(surfaces, o) for o in range(len(surfaces.vertices)))


def _draw_mesh(surfaces: Surfaces, o: int) -> DrawMesh:
    faces = surfaces.faces[o]
    of = slice(int(surfaces.first_face[o]), int(surfaces.first_face[o + 1]))
    front, back = surfaces.corner_front[of].reshape(-1), surfaces.corner_back[of].reshape(-1)
    paint = np.concatenate([surfaces.reflectance[of], surfaces.emission[of]], axis=1)
    corner = faces.reshape(-1)
    if not len(corner):
        none = np.zeros(0, np.int32)
        return DrawMesh(np.zeros((0, 3), np.float32), faces, none, none, np.zeros((0, 3)), np.zeros((0, 3)))

    # Pair the columns two by two: a four-column unique of a large mesh sorts ten times slower.
    kind = np.unique(paint, axis=0, return_inverse=True)[1].reshape(-1)
    key = _pair(_pair(corner, front), _pair(back, np.repeat(kind, 3)))
    _, first, draw = np.unique(key, return_index=True, return_inverse=True)
    return DrawMesh(
        positions=surfaces.vertices[o][corner[first]].astype(np.float32),
        triangles=draw.reshape(-1, 3).astype(np.int32),
        front=front[first].astype(np.int32),
        back=back[first].astype(np.int32),
        reflectance=paint[first // 3, :3],
        emission=paint[first // 3, 3:],
    )


def _pair(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Number the distinct pairs of two int columns (n,) from 0."""
    a, b = a.astype(np.int64) - int(a.min()), b.astype(np.int64) - int(b.min())
    return np.unique(a * (int(b.max()) + 1) + b, return_inverse=True)[1].reshape(-1)


def colours(draw: DrawMesh, irradiance: np.ndarray, with_reflectance: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return linear radiance (D, 3) float32 of the front and of the back of each draw vertex.

    `irradiance` (R, 3) [W/m2]. The front shows rho E / pi + Le, the back rho E / pi and nothing where the
    face is one-sided. Without reflectance both show E / pi: every surface as if it were perfectly white.
    """
    E_front = irradiance[draw.front]
    one_sided = draw.back < 0
    E_back = irradiance[draw.back]  # -1 reads the last receiver: blanked below
    E_back[one_sided] = 0.0
    if with_reflectance:
        front = exitant_radiance(E_front, draw.reflectance, draw.emission)
        back = exitant_radiance(E_back, draw.reflectance, 0.0)
    else:
        front, back = exitant_radiance(E_front, 1.0, 0.0), exitant_radiance(E_back, 1.0, 0.0)
    return front.astype(np.float32), back.astype(np.float32)
