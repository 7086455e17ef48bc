"""Small glossy sheets of the atlas: their light by single rays, and the lobe that its predictions need."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from app.measure.atlas.row import solved
from app.measure.atlas.shapes import joined, scene, sheet
from gi_core.gloss.hemisphere import CELLS
from gi_core.gloss.radiance import Directions, gloss_radiance, room_for
from gi_core.gloss.source import LIST, OPENED
from gi_core.scene import Material, Scene, SkyLight
from gi_core.scene.types import Gloss
from gi_core.solver import Solver

F0 = 0.04
NODES, SECTORS = 1000, 128  # of an integral over polar angle and azimuth
FAR = 1e5  # [m], of an eye
LARGE = 0.2  # [m]: many rays, for means
SMALL = 0.02  # [m]: a few rays per disc, which are as uneven as random ones; more Sobol photons are more even


def under_the_sky(alpha: float, views: Sequence[float], seed: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the radiance (views, n) of gloss of n small sheets, under irradiance 1, and their numbers (n,) of rays.

    views: angles of the eye [degrees]; radius [m]: of irradiance.
    """
    field = sheets_under_the_sky(alpha)
    solver = solved(field, 200_000, seed, radius=radius, gloss=LIST)
    given, row, corner = rays_of(solver)
    seen = [radiance_of(solver, given, row, corner, eye_at(math.radians(view)))[:, 1] for view in views]
    return np.array(seen, float), np.diff(given.offsets[::CELLS])[row]


def sheets_under_the_sky(alpha: float, side: float = 0.02, along: int = 12) -> Scene:
    """Return a square of glossy sheets, 1 m apart; side [m]; along: their number along an edge of the square."""
    sky = SkyLight("sky", (1 / math.pi,) * 3)
    places = [(i, j, 0.0) for i in range(along) for j in range(along)]
    satin = Material("satin", (0.2,) * 3, gloss=Gloss((F0,) * 3, alpha))
    sheets = joined(*(sheet(p, (side, 0, 0), (0, side, 0)) for p in places))
    return scene(sheets, (satin,), (6, -9, 9), (6, 6, 0), (sky,))


def rays_of(solver: Solver) -> tuple[Directions, np.ndarray, np.ndarray]:
    """Return single rays, and one receiver (n,) per sheet: as a row of these rays, and among all receivers."""
    light, corner = solver.frame.gloss, solver.surfaces.corner_front[::2, 0]
    row = np.searchsorted(light.rows, corner).astype(np.int32)
    return light.directions()._replace(opened=OPENED[LIST]), row, corner


def eye_at(angle: float) -> np.ndarray:
    """Return a far eye (3,) at an angle [rad] from the normal."""
    return FAR * np.array([math.sin(angle), 0.0, math.cos(angle)])


def radiance_of(
    solver: Solver, given: Directions, row: np.ndarray, receiver: np.ndarray, eye: np.ndarray
) -> np.ndarray:
    """Return the radiance (n, 3) of gloss under irradiance 1; all faces have the first one's lobe."""
    s, n = solver.surfaces, len(row)
    position, normal = solver.receivers.positions[receiver], solver.receivers.normals[receiver]
    lobes, seen = np.tile(s.lobe[0], (n, 1)), room_for(n)
    gloss_radiance(given, row, np.ones((n, 3)), position, normal, lobes, normal, s.tables, eye, seen)
    return seen


def lobe_at(alpha: float, view: float, least: float = 0.0, f0: float = F0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return directions w (n, 3), f (n,) and weights cos dw (n,): GGX, height-correlated Smith, Schlick's F of F0.

    view: angle of the eye [degrees]; least: cosine of the eye at least, in masking and in 1 / cos.
    """
    theta = (np.arange(NODES) + 0.5) * (0.5 * math.pi / NODES)
    phi = (np.arange(SECTORS) + 0.5) * (2 * math.pi / SECTORS)
    t, p = (a.reshape(-1) for a in np.meshgrid(theta, phi, indexing="ij"))
    w = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    v = math.radians(view)
    o = np.array([math.sin(v), 0.0, math.cos(v)])
    f = ggx_value(alpha, w, o, least, f0)
    return w, f, w[:, 2] * np.sin(t) * (0.5 * math.pi / NODES) * (2 * math.pi / SECTORS)


def ggx_value(alpha: float, w: np.ndarray, o: np.ndarray, least: float = 0.0, f0: float = F0) -> np.ndarray:
    """Return f (n,) for light from w (n, 3) to an eye at o (3,), see lobe_at()."""
    h = w + o
    h /= np.linalg.norm(h, axis=1)[:, None]
    at_eye = max(o[2], least)
    d = alpha**2 / (math.pi * (h[:, 2] ** 2 * (alpha**2 - 1) + 1) ** 2)
    masked = 1 + _smith(alpha, at_eye) + _smith(alpha, w[:, 2])
    return d / (4 * w[:, 2] * at_eye * masked) * (f0 + (1 - f0) * (1 - (w * h).sum(axis=1)) ** 5)


def _smith(alpha: float, cos):
    return 0.5 * (np.sqrt(1 + alpha**2 * (1 - cos**2) / cos**2) - 1)
