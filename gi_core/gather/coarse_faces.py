"""Reflectance of coarse faces, scaled such that bounces reflect the flux of the photons on the face.

A bounce ends in irradiance interpolated between the corners of a face. A face larger than the disc of an estimator may
be lit quite otherwise than its corners, as the two triangles of a wall are. Many photons hit such a face, so its flux
is known. Its reflectance is scaled such that interpolated light reflects that flux.
"""

from __future__ import annotations

import numpy as np

from gi_core.model import Model
from gi_core.photons.paths import PathVertices

PHOTONS = 1 << 16  # at most: some 5 ms
LEAST_HITS = 100  # of a face: noise of a tenth


def conserving_reflectance(model: Model, paths: PathVertices, disc_area: float, light: np.ndarray) -> np.ndarray:
    """Return reflectance (F, 3) float64 of all faces, scaled on static faces larger than disc_area [m2].

    paths: of the first photons; light (n, 3) [W/m2]: irradiance of the static receivers without mobiles.
    """
    s = model.surfaces
    coarse = np.flatnonzero(s.areas[s.face_range(0)] > disc_area)
    if not len(coarse):
        return s.reflectance
    photons, faces = len(paths.offsets) - 1, s.face_range(0).stop
    arrived = paths.side >= 0
    arrived[paths.offsets[:-1]] = False  # the first vertex of a path is on the light
    arrived[arrived] = np.isin(paths.side[arrived] >> 1, coarse)
    rows = np.flatnonzero(arrived)
    face, back = paths.side[rows] >> 1, paths.side[rows] & 1 > 0
    rows, face = (a[~back | s.two_sided[face]] for a in (rows, face))  # the back of a one-sided face is black
    flux = np.stack([np.bincount(face, paths.flux[rows - 1, c], faces) for c in range(3)], axis=1)
    flux *= model.emitters.unit_flux / photons
    known = light[s.corner_front[coarse]].mean(axis=1)
    known += np.where(s.two_sided[coarse, None], light[s.corner_back[coarse]].mean(axis=1), 0.0)
    known *= s.areas[coarse, None]
    sure = (np.bincount(face, minlength=faces)[coarse] >= LEAST_HITS)[:, None] & (known > 0)
    out = s.reflectance.copy()
    out[coarse] *= np.divide(flux[coarse], known, out=np.ones(known.shape), where=sure)
    return out
