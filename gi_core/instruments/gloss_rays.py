"""Light of glossy receivers outside of pictures: their single rays, and radiance."""

from __future__ import annotations

import numpy as np

from gi_core.frames.frame_gloss import RADII
from gi_core.frames.light_setting import LIST, OPENED
from gi_core.gloss.hemisphere import CELLS, GRAZING
from gi_core.gloss.light import LEAST_ALPHA, Directions, gloss_radiance, room_for
from gi_core.photons.paths import segments_of
from gi_core.solver import Solver

__all__ = [
    "CELLS", "GRAZING", "LEAST_ALPHA", "LIST", "RADII", "Directions",
    "bounced_once", "radiance_of", "single_rays",
]  # fmt: skip


def single_rays(solver: Solver, receivers: np.ndarray) -> tuple[Directions, np.ndarray]:
    """Return the single rays of a solver with gloss LIST, and the row (n,) int32 of each receiver (n,) in them."""
    light = solver.frame.gloss
    return light.directions()._replace(opened=OPENED[LIST]), np.searchsorted(light.rows, receivers).astype(np.int32)


def radiance_of(
    solver: Solver, light: Directions, row: np.ndarray, receiver: np.ndarray, eye, alpha: float | None = None
) -> np.ndarray:
    """Return the radiance (n, 3) of gloss under irradiance 1, towards an eye (3,) [m]; all faces have the first's lobe.

    row: of each receiver (n,) in `light`; alpha: in place of that lobe's.
    """
    s, n = solver.surfaces, len(row)
    position, normal = solver.receivers.positions[receiver], solver.receivers.normals[receiver]
    lobes, seen = np.tile(s.lobe[0] if alpha is None else (*s.lobe[0, :4], alpha), (n, 1)), room_for(n)
    gloss_radiance(light, row, np.ones((n, 3)), position, normal, lobes, normal, s.tables, eye, seen)
    return seen


def bounced_once(solver: Solver) -> np.ndarray:
    """Return the vectors (n, 3) [m] from first to second hit of the photons of a frame."""
    paths, _ = solver.frame.store.subset(solver.frame.photons)
    segments = segments_of(paths, 0, solver.frame.photons)
    return (segments.end - segments.origin)[segments.bounce == 1].astype(float)
