"""Level of light in a scene's first view, to which noise is compared.

The sun outside a house may be a thousand times brighter than a room. Noise relative to all light would be that outside,
and a room would stay mottled while its scene counts as done. So noise is relative to the light of each place that is
brighter than the median in view. Places that are white in the picture count less.
"""

from __future__ import annotations

import numpy as np

from gi_core.files.completion.camera_view import picture_rays
from gi_core.model import Model
from gi_core.rays.accelerator import FAR, LIFT

GRID = (32, 20)  # rays through the picture
BACKS = 4  # of one-sided faces, which the camera sees through
WHITE = 8.0  # times the median in view, which is drawn mid-grey


def visual_shares(model: Model, E: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Return shares (n,) by which noise of receivers of luminance E (n,) [W/m2] counts: 1 up to the level, less above.

    n: all receivers, or those of the static part, which come first. areas (n,) [m2]: find a level without a camera.
    """
    level = _median_in_view(model, E)
    if not level > 0.0:
        lit = E > 0.0
        level = _median(E[lit], areas[lit])
    if not level > 0.0:
        return np.ones(len(E))
    return (level / np.maximum(E, level)) * (WHITE * level / np.maximum(E, WHITE * level))


def _median_in_view(model: Model, E: np.ndarray) -> float:
    """Return the median luminance [W/m2] of static faces in the view of the scene's camera; 0: nothing is seen."""
    scene, s = model.scene, model.surfaces
    if scene.camera is None:
        return 0.0
    way = picture_rays([scene.camera], scene.up, *GRID)[0].astype(np.float32)
    origin = np.repeat(np.array(scene.camera.position, np.float32)[None], len(way), axis=0)
    parts, far = [], FAR * model.world.size + float(np.linalg.norm(origin[0]))
    for _ in range(BACKS):
        distance, face = model.accelerator.nearest(0, origin, way, np.full(len(way), far, np.float32))
        hit = face >= 0
        origin, way, distance, face = origin[hit], way[hit], distance[hit], face[hit]
        front = (s.normals[face] * way).sum(axis=1) < 0
        parts.append(E[s.corner_front[face[front]]].mean(axis=1))
        back = ~front & s.two_sided[face]
        parts.append(E[s.corner_back[face[back]]].mean(axis=1))
        on = ~front & ~back
        past = distance[on] + LIFT * np.maximum(
            model.world.reach[face[on]], np.abs(origin[on]).max(axis=1, initial=0.0)
        )
        origin, way = origin[on] + past[:, None] * way[on], way[on]
    seen = np.concatenate(parts)
    return float(np.median(seen)) if len(seen) else 0.0


def _median(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the weighted median; 0 of nothing."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])]) if len(order) and total[-1] > 0 else 0.0
