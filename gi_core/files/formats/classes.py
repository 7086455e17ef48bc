"""Values that a texture varies over triangles become few classes, as materials hold one value each."""

from __future__ import annotations

import numpy as np

from gi_core.base.vectors import cross, length
from gi_core.geometry.texture_filter import mean_colours
from gi_core.scene.pose import three
from gi_core.scene.types import Material, Paint, Texture

MOST_CLASSES = 16  # classes per material and mesh
ALIKE = 0.02  # standard deviation of roughness, metallic, metal colour or emission below which a class is not divided


def lamps_of_texture(
    materials: list[Material], material: int, corners: np.ndarray, texture: Texture, uv: np.ndarray
) -> np.ndarray:
    """Return a material (F,) for each face of one whose emission a texture scales; new ones are appended, named alike.

    corners (F, 3, 3) [m], uv (F, 3, 2): each face emits the mean of its texels, faces of a class the mean over their
    area. `materials[material]` has the emission without the texture.
    """
    faces = len(corners)
    paint = Paint((texture,), np.zeros(faces, np.int32), uv.astype(np.float32), np.ones((faces, 3, 3), np.float32))
    shares = mean_colours(paint, 1.0)
    area = length(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])) + 1e-300
    of, own = classes(shares, area), materials[material]
    out = np.empty(faces, np.int64)
    for c in range(of.max(initial=-1) + 1):
        rows = of == c
        share = area[rows] @ shares[rows] / area[rows].sum()
        out[rows] = len(materials)
        materials.append(own._replace(emission=three(share * np.array(own.emission))))
    return out


def classes(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return classes (n,) int64 of values (n, d): MOST_CLASSES at most, of the largest summed variance divided first.

    A class is divided at its mean along the axis in which it varies most, until all deviate by less than ALIKE.
    """
    out = np.zeros(len(values), np.int64)
    spread = [_variance(values, weights)]
    while len(spread) < MOST_CLASSES:
        total = [weights[out == c].sum() * v.sum() if v.max() > ALIKE**2 else 0.0 for c, v in enumerate(spread)]
        c = int(np.argmax(total))
        if total[c] == 0:
            break
        rows, axis = np.flatnonzero(out == c), int(np.argmax(spread[c]))
        along = values[rows, axis]
        out[rows[along > weights[rows] @ along / weights[rows].sum()]] = len(spread)
        spread[c] = _variance(values[out == c], weights[out == c])
        spread.append(_variance(values[out == len(spread)], weights[out == len(spread)]))
    return out


def _variance(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    share = weights / weights.sum()
    return share @ (values - share @ values) ** 2
