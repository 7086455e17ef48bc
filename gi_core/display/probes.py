"""Irradiance at probes, the named points of a scene file."""

from __future__ import annotations

import numpy as np

from gi_core.model import Model

FACE_SEARCH_LIFT = 1e-4  # of the world's size: start of the ray that finds the face under a probe


def probe_irradiance(model: Model, irradiance: np.ndarray, on_faces: bool) -> dict[str, np.ndarray]:
    """Return irradiance (3,) [W/m2] by probe name, from that of all receivers (R, 3).

    A probe is a receiver. With an estimator that counts hits on faces, it takes the interpolated irradiance of the
    static face that it lies on, or 0 off any face.
    """
    rows = slice(model.first_probe, model.surfaces.receiver_range(0).stop)
    found = _interpolated(model, irradiance, rows) if on_faces else irradiance[rows]
    return dict(zip((p.name for p in model.scene.probes), found, strict=True))


def _interpolated(model: Model, irradiance: np.ndarray, rows: slice) -> np.ndarray:
    r, s, lift = model.object_receivers, model.surfaces, FACE_SEARCH_LIFT * model.world.size
    origins = (r.positions[rows] + lift * r.normals[rows]).astype(np.float32)
    directions = (-r.normals[rows]).astype(np.float32)
    _, face = model.accelerator.nearest(0, origins, directions, np.full(len(origins), 2 * lift, np.float32))
    out = np.zeros((len(origins), 3))
    for k in np.flatnonzero(face >= 0):
        a, *ends = s.vertices[0][s.faces[0][face[k]]]
        u, v = np.linalg.lstsq((ends - a).T, r.positions[rows][k] - a, rcond=None)[0]  # of the foot in the face's plane
        front = directions[k] @ s.normals[face[k]] < 0
        index = (s.corner_front if front else s.corner_back)[face[k]]
        out[k] = np.where(index[:, None] >= 0, irradiance[index], 0).T @ (1 - u - v, u, v)
    return out
