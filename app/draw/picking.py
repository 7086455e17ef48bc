"""Picking: one ray against the surfaces that the picture shows, mobiles at their poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.model import Model
from gi_core.rays.all_objects import nearest_in_world
from gi_core.rays.holes import BEYOND
from gi_core.scene import Pose


class Hit(NamedTuple):
    object: int  # 0 static, i + 1 the scene's mobile i
    face: int  # within the object
    distance: float  # [m]
    point: np.ndarray  # (3,) float64, world


class Picker:
    """Traces rays as pictures do: in float32, through holes of cutouts and past culled faces."""

    def __init__(self, model: Model) -> None:
        self._model = model

    def pick(self, origin, direction, poses: list[Pose], cull: bool) -> Hit | None:
        """Return the nearest hit of a ray with a unit direction; `poses` are the mobiles', in the scene's order.

        With `cull`, backs of one-sided faces do not count. Distance and point lie in the plane of the face, in float64.
        """
        model, s = self._model, self._model.surfaces
        at = model.transforms(dict(zip(model.names, poses, strict=True)))
        d, eye = np.asarray(direction, np.float64), np.asarray(origin, np.float64) - model.origins[0]
        start = eye
        for _ in range(64):  # 64 culled faces along a ray at most
            t, face = nearest_in_world(model.accelerator, at, start[None], d[None], np.full(1, np.inf))
            if face[0] < 0:
                return None
            o = int(model.accelerator.face_object[face[0]])
            k = int(face[0] - s.first_face[o])
            corners = s.vertices[o][s.faces[o][k]] @ at.rotation[o].T + at.position[o]
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            if not cull or s.two_sided[face[0]] or normal @ d < 0:
                distance = float((corners[0] - eye) @ normal / (d @ normal))
                return Hit(o, k, distance, np.asarray(origin) + distance * d)
            start = start + (t[0] * (1 + BEYOND) + BEYOND * np.abs(corners).max()) * d
        return None

    def on(self, o: int, point, normal, reach: float) -> int:
        """Return the face of object o below a point of its space (3,), along -normal (3,) from `reach` above it [m].

        -1 if none is there within twice that distance.
        """
        model, d = self._model, -np.asarray(normal, np.float64)
        start = np.asarray(point, np.float64) - model.origins[o] - reach * d
        _, face = model.accelerator.nearest(o, start[None], d[None], np.full(1, 2 * reach))
        return int(face[0] - model.surfaces.first_face[o]) if face[0] >= 0 else -1
