"""Gloss from single rays: its noise against the width of the lobe, and the blur of what it reflects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from app.measure.atlas.row import BLACK, SEEDS, AtlasRow, joined, over_seeds, scene, sheet, solved
from gi_core.instruments.gloss_rays import (
    CELLS,
    GRAZING,
    LIST,
    RADII,
    Directions,
    bounced_once,
    radiance_of,
    single_rays,
)
from gi_core.scene import DirectionalLight, Material, Scene, SkyLight
from gi_core.scene.types import Gloss
from gi_core.solver import Solver

F0 = 0.04
POLAR_NODES, SECTORS = 1000, 128  # of an integral over polar angle and azimuth
EYE_DISTANCE = 1e5  # [m], of an eye
SMALL = 0.02  # [m]: a few rays per disc, which are as uneven as random ones; more Sobol photons are more even


def under_the_sky(alpha: float, views: Sequence[float], seed: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the radiance (views, n) of gloss of n small sheets, under irradiance 1, and their numbers (n,) of rays.

    views: angles of the eye [degrees]; radius [m]: of irradiance.
    """
    field = sheets_under_the_sky(alpha)
    solver = solved(field, 200_000, seed, radius=radius, gloss=LIST)
    rays, row, corner = rays_of(solver)
    seen = [radiance_of(solver, rays, row, corner, eye_at(math.radians(view)))[:, 1] for view in views]
    return np.array(seen, float), np.diff(rays.offsets[::CELLS])[row]


def sheets_under_the_sky(alpha: float, side: float = 0.02, along: int = 12) -> Scene:
    """Return a square of glossy sheets, 1 m apart; side [m]; along: their number along an edge of the square."""
    sky = SkyLight("sky", (1 / math.pi,) * 3)
    places = [(i, j, 0.0) for i in range(along) for j in range(along)]
    satin = Material("satin", (0.2,) * 3, gloss=Gloss((F0,) * 3, alpha))
    sheets = joined(*(sheet(p, (side, 0, 0), (0, side, 0)) for p in places))
    return scene(sheets, (satin,), (6, -9, 9), (6, 6, 0), (sky,))


def rays_of(solver: Solver) -> tuple[Directions, np.ndarray, np.ndarray]:
    """Return single rays, and one receiver (n,) per sheet: as a row of these rays, and among all receivers."""
    corner = solver.surfaces.corner_front[::2, 0]
    return *single_rays(solver, corner), corner


def eye_at(angle: float) -> np.ndarray:
    """Return a far eye (3,) at an angle [rad] from the normal."""
    return EYE_DISTANCE * np.array([math.sin(angle), 0.0, math.cos(angle)])


def lobe_at(alpha: float, view: float, least: float = 0.0, f0: float = F0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return directions w (n, 3), f (n,) and weights cos dw (n,): GGX, height-correlated Smith, Schlick's F of F0.

    view: angle of the eye [degrees]; least: cosine of the eye at least, in masking and in 1 / cos.
    """
    theta = (np.arange(POLAR_NODES) + 0.5) * (0.5 * math.pi / POLAR_NODES)
    phi = (np.arange(SECTORS) + 0.5) * (2 * math.pi / SECTORS)
    t, p = (a.reshape(-1) for a in np.meshgrid(theta, phi, indexing="ij"))
    w = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    v = math.radians(view)
    o = np.array([math.sin(v), 0.0, math.cos(v)])
    f = ggx_value(alpha, w, o, least, f0)
    return w, f, w[:, 2] * np.sin(t) * (0.5 * math.pi / POLAR_NODES) * (2 * math.pi / SECTORS)


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


DISC_RADIUS = 0.1  # of irradiance [m]; gloss has RADII times that
GRAZING_VIEW = 60.0  # degrees
STRIP_HEIGHT = 1.0  # of the strip [m]
NORMAL_TURN = 10.0  # degrees


def noise() -> Iterator[AtlasRow]:
    """The noise of radiance is F times that of irradiance from the same rays: the noise factor of docs/brdfs.md."""
    along, both = (0.0,), (0.0, GRAZING_VIEW)
    for alpha, views in ((0.15, along), (0.2, along), (0.3, both), (0.5, both), (0.8, along)):

        def run(seed, alpha=alpha, views=views):
            seen, count = under_the_sky(alpha, views, seed, SMALL)
            # All photons of the sky have the same flux: irradiance is proportional to the number of rays.
            return [_noise(radiance * count) / _noise(count) for radiance in seen]

        for view, measured in zip(views, over_seeds(run, 3 * SEEDS), strict=True):
            _, f, weights = lobe_at(alpha, view)
            predicted = math.sqrt(math.pi * float(weights @ f**2)) / float(weights @ f)
            yield AtlasRow(
                f"gloss_noise_{alpha}_{view:.0f}",
                f"gloss of alpha {alpha} by single rays, seen at {view:.0f} degrees under an even sky",
                "F = sqrt(pi integral of f^2 cos) / (integral of f cos)", predicted, measured,
                "64 cells instead of rays; reflections where F is above 2 along the normal", within=0.03 * predicted,
                quantity="noise of radiance / noise of irradiance", title="Gloss from few rays",
            )  # fmt: skip


def grazing() -> AtlasRow:
    """Views closer to the surface than a cosine of GRAZING divide by GRAZING: radiance is too small."""
    alpha, view = 0.3, 89.0
    _, f, weights = lobe_at(alpha, view)
    _, clamped, _ = lobe_at(alpha, view, GRAZING)

    def run(seed):
        seen, count = under_the_sky(alpha, (view,), seed, 0.2)  # 0.2 m: many rays, for means
        return (float((seen[0] * count).sum() / count.sum()) * math.pi / float(weights @ f),)

    (measured,) = over_seeds(run, SEEDS)
    return AtlasRow(
        "gloss_grazing", f"gloss of alpha {alpha} seen at {view:.0f} degrees under an even sky",
        "masking and 1 / cos are those of cos = 0.05", float(weights @ clamped) / float(weights @ f), measured,
        "none; without the limit single rays near the horizon would be bright dots", within=0.02,
        quantity="radiance / truth", title="Gloss at grazing views",
    )  # fmt: skip


def _noise(values: np.ndarray) -> float:
    return float(np.std(values, ddof=1) / np.mean(values))


def blur() -> AtlasRow:
    """A disc of radius R sees a thin strip at a distance h from all its points: it spreads over R / 2h (standard)."""
    satin = Material("satin", (0.2,) * 3, gloss=Gloss((0.04,) * 3, 0.3))
    glow = Material("glow", (0.0,) * 3, (100.0,) * 3)
    places = [(0.5 * i, 0.0, 0.0) for i in range(8)]
    strip = sheet((-1.0, 0.005, STRIP_HEIGHT), (6.0, 0, 0), (0, -0.01, 0), material=2)
    field = scene(joined(*(sheet(p, (0.02, 0, 0), (0, 0.02, 0)) for p in places), strip), (satin, BLACK, glow),
                  (2, -4, 2), (2, 0, 0))  # fmt: skip

    def run(seed):
        solver = solved(field, 400_000, seed, radius=DISC_RADIUS, gloss=LIST)
        tree = solver.frame.gloss.tree
        direction, share = tree.rays[:, 3:].astype(float), tree.rays[:, 1].astype(float)
        slope = direction[:, 1] / direction[:, 2]
        share = np.where(direction[:, 2] > 0, share, 0.0)
        mean = (share @ slope) / share.sum()
        return (math.sqrt(share @ (slope - mean) ** 2 / share.sum()),)

    (measured,) = over_seeds(run, 4)
    return AtlasRow(
        "gloss_blur", f"a strip lamp {STRIP_HEIGHT} m over glossy faces, discs of {RADII * DISC_RADIUS} m",
        "R / 2h: reflected edges are blurred by 2R / h", 0.5 * RADII * DISC_RADIUS / STRIP_HEIGHT, measured,
        "a smaller radius; reflections for sharp lobes",
        within=0.01 * RADII * DISC_RADIUS / STRIP_HEIGHT,  # receivers lie 0 to 2 cm off the strip's middle
        quantity="standard deviation of the slope of rays", title="Reflections blurred by the disc",
    )  # fmt: skip


def shading_normals() -> AtlasRow:
    """Parallel light along the normals of mirrors of metal, whose normals for shading are turned by NORMAL_TURN.

    The picture reflects about those, photons are reflected by faces: highlight and caustic lie 2 NORMAL_TURN apart.
    """
    turn = math.radians(NORMAL_TURN)
    metal = Material("metal", (0.0,) * 3, gloss=Gloss((1.0,) * 3, 0.15))
    sun = DirectionalLight("sun", (0, 0, -1.0), (1.0,) * 3)
    sheets = joined(*(sheet((0.5 * i, 0.0, 0.0), (0.3, 0, 0), (0, 0.3, 0)) for i in range(8)))
    normals = np.broadcast_to([math.sin(turn), 0.0, math.cos(turn)], (len(sheets.faces), 3, 3))
    field = scene(sheets._replace(corner_normals=normals), (metal,), (2, -4, 2), (2, 0, 0), (sun,))

    def run(seed):
        solver = solved(field, 50_000, seed, radius=DISC_RADIUS, gloss=LIST)
        rays = rays_of(solver)
        angles = np.radians(np.arange(0.0, 40.0, 0.25))
        seen = [float(radiance_of(solver, *rays, eye_at(angle))[:, 1].sum()) for angle in angles]
        way = bounced_once(solver)
        caustic = way.sum(axis=0) / np.linalg.norm(way, axis=1).max()
        return (math.degrees(angles[np.argmax(seen)] - math.atan2(caustic[0], caustic[2])),)

    (measured,) = over_seeds(run, SEEDS)
    return AtlasRow(
        "gloss_shading_normals",
        f"parallel light on metal whose vertex normals are turned by {NORMAL_TURN:.0f} degrees from its faces",
        "the picture reflects about vertex normals, photons about faces: 2 x the turn", 2 * NORMAL_TURN, measured,
        "a finer mesh: normals of vertices approach those of faces", within=0.5,
        quantity="angle between highlight and caustic [degrees]", title="Gloss and normals for shading",
    )  # fmt: skip
