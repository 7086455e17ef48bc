"""Irradiance at probes, the named points of a scene file."""

from __future__ import annotations

import numpy as np

from gi_core.model import Model


def probe_irradiance(model: Model, irradiance: np.ndarray, on_faces: bool) -> dict[str, np.ndarray]:
    """Return irradiance (3,) [W/m2] by probe name, from that of all receivers (R, 3).

    A probe is a receiver. With an estimator that counts hits on faces, it takes the interpolated irradiance of the
    static face that it lies on, or 0 off any face.
    """
    rows = slice(model.first_probe, model.surfaces.receiver_range(0).stop)
    at_probes = _interpolated(model, irradiance, rows) if on_faces else irradiance[rows]
    return dict(zip((p.name for p in model.scene.probes), at_probes, strict=True))


def _interpolated(model: Model, irradiance: np.ndarray, rows: slice) -> np.ndarray:
    r, s = model.object_receivers, model.surfaces
    positions, normals = r.positions[rows], r.normals[rows]
    # a probe nearer than 1e-4 of a face's largest coordinate lies on it
    face = model.faces_at(model.static, positions, normals, 1e-4)
    out = np.zeros((len(face), 3))
    for k in np.flatnonzero(face >= 0):
        a, *ends = s.vertices[0][s.faces[0][face[k]]]
        u, v = np.linalg.lstsq((ends - a).T, positions[k] - a, rcond=None)[0]  # of the foot in the face's plane
        front = normals[k] @ s.normals[face[k]] > 0
        index = (s.corner_front if front else s.corner_back)[face[k]]
        out[k] = np.where(index[:, None] >= 0, irradiance[index], 0).T @ (1 - u - v, u, v)
    return out
