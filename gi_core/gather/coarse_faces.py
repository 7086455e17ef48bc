"""Reflectance of coarse faces, scaled such that bounces reflect the flux of the photons on the face.

A bounce ends in irradiance interpolated between the corners of a face. A face larger than the disc of an estimator may
be lit quite otherwise than its corners, as the two triangles of a wall are. Many photons hit such a face, so its flux
is known. Its reflectance is scaled such that interpolated light reflects that flux.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.lights.mix import mix
from gi_core.model import Model
from gi_core.photons.paths import PathVertices

MOST_COUNTED = 1 << 16  # that are counted: some 5 ms
LEAST_HITS = 100  # of a face: noise of a tenth


class CoarseFaces(NamedTuple):
    """Static faces larger than a disc, and the flux that photons bring to them."""

    faces: np.ndarray  # (k,) int64
    flux: np.ndarray  # (k, 3 G) float64 [W], per lamp
    sure: np.ndarray  # (k,) bool, enough photons arrive

    @classmethod
    def of(cls, model: Model, paths: PathVertices, disc_area: float) -> CoarseFaces:
        """Count the paths of the first photons; disc_area [m2]."""
        s, lamps = model.surfaces, model.emitters.lamps
        coarse = np.flatnonzero(s.areas[s.face_range(0)] > disc_area)
        if not len(coarse):
            return cls(coarse, np.zeros((0, lamps.channels)), np.zeros(0, bool))
        photons, place = len(paths.offsets) - 1, np.full(s.face_range(0).stop, -1)
        place[coarse] = np.arange(len(coarse))
        arrived = paths.side >= 0
        arrived[paths.offsets[:-1]] = False  # the first vertex of a path is on the light
        arrived[arrived] = place[paths.side[arrived] >> 1] >= 0
        rows = np.flatnonzero(arrived)
        face, back = paths.side[rows] >> 1, paths.side[rows] & 1 > 0
        black = back & ~s.two_sided[face]  # the back of a one-sided face
        rows, at = rows[~black], place[face[~black]]
        lamp = paths.lamp[np.searchsorted(paths.offsets, rows, side="right") - 1] if lamps.count > 1 else 0
        cell, cells = at * lamps.count + lamp, len(coarse) * lamps.count
        flux = np.stack([np.bincount(cell, paths.flux[rows - 1, c], cells) for c in range(3)], axis=1)
        flux = flux.reshape(len(coarse), lamps.channels) * (model.emitters.unit_flux / photons)
        flux *= np.repeat(model.emitters.scale, 3)
        return cls(coarse, flux, np.bincount(at, minlength=len(coarse)) >= LEAST_HITS)

    def reflectance(self, model: Model, light: np.ndarray, levels: np.ndarray) -> np.ndarray:
        """Return reflectance (F, 3) float64 of all faces, scaled on these such that interpolated light conserves flux.

        light (n, 3) [W/m2]: irradiance of the static receivers without mobiles, at levels (G, 3) of the lamps.
        """
        s, coarse = model.surfaces, self.faces
        if not len(coarse):
            return model.world.bsdfs.albedo
        flux = mix(self.flux, levels)
        received = light[s.corner_front[coarse]].mean(axis=1)
        received += np.where(s.two_sided[coarse, None], light[s.corner_back[coarse]].mean(axis=1), 0.0)
        received *= s.areas[coarse, None]
        out, where = model.world.bsdfs.albedo.copy(), self.sure[:, None] & (received > 0)
        out[coarse] *= np.divide(flux, received, out=np.ones(received.shape), where=where)
        return out
