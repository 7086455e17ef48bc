"""Gloss from single rays: its noise against the width of the lobe, the blur of reflections, and its limits.

Limits are lobes sharper than drawn, draws below the surface, more light than arrives.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from app.measure.atlas.row import BLACK, SEEDS, AtlasRow, Number, joined, over_seeds, scene, sheet, solved
from gi_core.bsdf.models import lobe
from gi_core.instruments.gloss_rays import (
    CELLS,
    GRAZING,
    LEAST_ALPHA,
    LIST,
    RADII,
    Directions,
    bounced_once,
    radiance_of,
    single_rays,
)
from gi_core.model import Model
from gi_core.scene import DirectionalLight, Material, Scene, SkyLight
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Gloss
from gi_core.solver import Solver

F0 = 0.04
EYE_DISTANCE = 1e5  # [m], of an eye
SMALL = 0.02  # [m]: a few rays per disc, which are as uneven as random ones; more Sobol photons are more even


def under_the_sky(looks: Sequence[tuple[float, float]], seed: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the radiance (looks, n) of gloss of n small sheets, under irradiance 1, and their numbers (n,) of rays.

    looks: alpha of the sheets, which no photon feels, and angle of the eye [degrees]; radius [m]: of irradiance.
    """
    solver = solved(sheets_under_the_sky(SATIN), 200_000, seed, radius=radius, gloss=LIST)
    rays, row, corner = rays_of(solver)
    seen = [radiance_of(solver, rays, row, corner, eye_at(math.radians(v)), alpha)[:, 1] for alpha, v in looks]
    return np.array(seen, float), np.diff(rays.offsets[::CELLS])[row]


def sheets_under_the_sky(alpha: float) -> Scene:
    """Return a square of 12 x 12 glossy sheets of 2 cm, 1 m apart."""
    sky = SkyLight("sky", (1 / math.pi,) * 3)
    places = [(i, j, 0.0) for i in range(12) for j in range(12)]
    satin = Material("satin", (0.2,) * 3, gloss=Gloss((F0,) * 3, alpha))
    sheets = joined(*(sheet(p, (0.02, 0, 0), (0, 0.02, 0)) for p in places))
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
    polar_nodes, sectors = 1000, 128  # of an integral over polar angle and azimuth
    theta = (np.arange(polar_nodes) + 0.5) * (0.5 * math.pi / polar_nodes)
    phi = (np.arange(sectors) + 0.5) * (2 * math.pi / sectors)
    t, p = (a.reshape(-1) for a in np.meshgrid(theta, phi, indexing="ij"))
    w = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    v = math.radians(view)
    o = np.array([math.sin(v), 0.0, math.cos(v)])
    f = ggx_value(alpha, w, o, least, f0)
    return w, f, w[:, 2] * np.sin(t) * (0.5 * math.pi / polar_nodes) * (2 * math.pi / sectors)


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
NORMAL_TURN = 10.0  # degrees


def noise() -> Iterator[AtlasRow]:
    """The noise of radiance is F times that of irradiance from the same rays: the noise factor of docs/brdfs.md."""
    looks = (0.15, 0.0), (0.2, 0.0), (0.3, 0.0), (0.3, 60.0), (0.5, 0.0), (0.5, 60.0), (0.8, 0.0)

    def run(seed):
        seen, count = under_the_sky(looks, seed, SMALL)
        # All photons of the sky have the same flux: irradiance is proportional to the number of rays.
        return [_noise(radiance * count) / _noise(count) for radiance in seen]

    for (alpha, view), measured in zip(looks, over_seeds(run, 3 * SEEDS), strict=True):
        _, f, weights = lobe_at(alpha, view)
        predicted = math.sqrt(math.pi * float(weights @ f**2)) / float(weights @ f)
        yield AtlasRow(
            f"gloss_noise_{alpha}_{view:.0f}",
            f"gloss of alpha {alpha} by single rays, seen at {view:.0f} degrees under an even sky",
            "F = sqrt(pi integral of f^2 cos) / (integral of f cos)", predicted, measured,
            "64 cells instead of rays; reflections where F is above 2 along the normal", within=0.03 * predicted,
            quantity="noise of radiance / noise of irradiance", title="Gloss from few rays",
        )  # fmt: skip


def grazing() -> Iterator[AtlasRow]:
    """Views closer to the surface than a cosine of GRAZING divide by GRAZING: radiance is too small."""
    alpha, view = 0.3, 89.0
    _, f, weights = lobe_at(alpha, view)
    _, clamped, _ = lobe_at(alpha, view, GRAZING)

    def run(seed):
        seen, count = under_the_sky([(alpha, view)], seed, 0.2)  # 0.2 m: many rays, for means
        return (float((seen[0] * count).sum() / count.sum()) * math.pi / float(weights @ f),)

    (measured,) = over_seeds(run, SEEDS)
    yield AtlasRow(
        "gloss_grazing", f"gloss of alpha {alpha} seen at {view:.0f} degrees under an even sky",
        "masking and 1 / cos are those of cos = 0.05", float(weights @ clamped) / float(weights @ f), measured,
        "none; without the limit single rays near the horizon would be bright dots", within=0.02,
        quantity="radiance / truth", title="Gloss at grazing views",
    )  # fmt: skip


def _noise(values: np.ndarray) -> float:
    return float(np.std(values, ddof=1) / np.mean(values))


def blur() -> Iterator[AtlasRow]:
    """A disc of radius R sees a thin strip at a distance h from all its points: it spreads over R / 2h (standard)."""
    strip_height = 1.0  # of the strip [m]
    satin = Material("satin", (0.2,) * 3, gloss=Gloss((0.04,) * 3, 0.3))
    glow = Material("glow", (0.0,) * 3, (100.0,) * 3)
    places = [(0.5 * i, 0.0, 0.0) for i in range(8)]
    strip = sheet((-1.0, 0.005, strip_height), (6.0, 0, 0), (0, -0.01, 0), material=2)
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
    yield AtlasRow(
        "gloss_blur", f"a strip lamp {strip_height} m over glossy faces, discs of {RADII * DISC_RADIUS} m",
        "R / 2h: reflected edges are blurred by 2R / h", 0.5 * RADII * DISC_RADIUS / strip_height, measured,
        "a smaller radius; reflections for sharp lobes",
        within=0.01 * RADII * DISC_RADIUS / strip_height,  # receivers lie 0 to 2 cm off the strip's middle
        quantity="standard deviation of the slope of rays", title="Reflections blurred by the disc",
    )  # fmt: skip


def shading_normals() -> Iterator[AtlasRow]:
    """Parallel light along the normals of mirrors of metal, whose normals for shading are turned by NORMAL_TURN.

    The picture reflects about those, photons are reflected by faces: highlight and caustic lie 2 NORMAL_TURN apart.
    """
    turn = math.radians(NORMAL_TURN)
    metal = Material("metal", (0.0,) * 3, gloss=Gloss((1.0,) * 3, 0.15))
    sun = DirectionalLight("sun", (0, 0, -1.0), (1.0,) * 3, disc_degrees=0.0)
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
    yield AtlasRow(
        "gloss_shading_normals",
        f"parallel light on metal whose vertex normals are turned by {NORMAL_TURN:.0f} degrees from its faces",
        "the picture reflects about vertex normals, photons about faces: 2 x the turn", 2 * NORMAL_TURN, measured,
        "a finer mesh: normals of vertices approach those of faces", within=0.5,
        quantity="angle between highlight and caustic [degrees]", title="Gloss and normals for shading",
    )  # fmt: skip


FIELD_PHOTONS = 100_000
SATIN = 0.3  # alpha


def sharper_than_drawn() -> Iterator[AtlasRow]:
    """Single rays are drawn with a lobe of LEAST_ALPHA at least: too dim in the middle of a sharper one."""
    alpha = 0.05
    solver = solved(_lit_metal(alpha, 0.0), FIELD_PHOTONS, gloss=LIST)
    rays, row, corner = rays_of(solver)
    seen = radiance_of(solver, rays, row, corner, eye_at(0.0))[:, 1]
    up = np.array([0.0, 0.0, 1.0])
    yield AtlasRow(
        "gloss_sharp", f"parallel light on metal of alpha {alpha}, seen along the normal by single rays",
        f"a lobe of alpha {LEAST_ALPHA}: (alpha / {LEAST_ALPHA})^2", (alpha / LEAST_ALPHA) ** 2,
        Number(float(seen.mean() / ggx_value(alpha, up[None], up, f0=1.0)[0])),
        "reflections, by default for such lobes (docs/brdfs.md, Sharp gloss)", within=1e-4,
        quantity="radiance / truth",
    )  # fmt: skip


def below_the_surface() -> Iterator[AtlasRow]:
    """A facet that would send light below the surface absorbs it: with F = 1 the rest of the integral of f cos."""
    for alpha, angle in ((0.3, 60.0), (0.6, 60.0), (0.6, 80.0)):
        _, f, weights = lobe_at(alpha, angle, f0=1.0)
        once = Material("metal", brdf=(lobe("ggx", {"f0": 1.0, "alpha": alpha}),))

        def run(seed, alpha=alpha, angle=angle, once=once):
            lit = (_lit(once, angle), _lit_metal(alpha, angle))
            return [1 - _reflected(solved(of, FIELD_PHOTONS, seed)) for of in lit]

        measured, remedied = over_seeds(run, SEEDS)
        yield AtlasRow(
            f"gloss_below_{alpha}_{angle:.0f}",
            f"white metal of alpha {alpha}, light at {angle:.0f} degrees, facets that reflect once (model ggx)",
            "1 - integral of f cos is absorbed", 1 - float(weights @ f), measured,
            "further reflections, which roughness and metallic add", remedied, aim=0.0, within=0.004,
            quantity="share of flux absorbed", title="Draws below the surface",
        )  # fmt: skip


def more_than_arrives() -> Iterator[AtlasRow]:
    """Phong's lobe over cos i is refused where it reflects more than arrives, or darkened to all that arrives."""
    steep = 85.0  # degrees of incidence
    n = 20
    shiny = Material("shiny", brdf=(lobe("phong", {"n": n, "ks": 1.0}),))
    place, title = f"Phong's model, n = {n}, ks = 1", "Surfaces that reflect more light than arrives"
    field = _lit(shiny, steep)
    try:
        Model(field)
        refused = Number(math.nan)
    except SceneError as problem:
        share, angle = re.search(r"\(([\d.]+) % at (\d+) degrees\)", str(problem)).groups()
        refused = Number(float(share) / 100)
        yield AtlasRow(
            "gloss_refused", f"{place}, at {angle} degrees", "integral of f cos", _phong(n, float(angle)), refused,
            "refused, with this share in the message; `scale = true` darkens it",
            within=0.02 * _phong(n, float(angle)), quantity="light that leaves / light that arrives", title=title,
        )  # fmt: skip
    darkened = replace(field, materials=(shiny._replace(scaled=True),))
    for angle, expected in ((45.0, _phong(n, 45.0)), (steep, 1.0)):

        def run(seed, angle=angle):
            return (_reflected(solved(_lit(darkened.materials[0], angle), FIELD_PHOTONS, seed)),)

        (measured,) = over_seeds(run, SEEDS)
        yield AtlasRow(
            f"gloss_scaled_{angle:.0f}", f"{place}, darkened, light at {angle:.0f} degrees",
            f"the smaller of 1 and {_phong(n, angle):.3g}", expected, measured, within=0.01,
            quantity="light that leaves / light that arrives", title=title,
        )  # fmt: skip


def _phong(n: int, angle: float) -> float:
    """Return the integral of (n + 1) / (2 pi) cos^n(a) cos o / cos i, a from the mirror direction of i [degrees]."""
    w, _, weights = lobe_at(SATIN, angle)
    i = math.radians(angle)
    along = np.maximum(w @ [-math.sin(i), 0.0, math.cos(i)], 0.0)
    return float(weights @ along**n) * (n + 1) / (2 * math.pi * math.cos(i))


def _lit(material: Material, angle: float) -> Scene:
    """Return a sheet of 1 m under parallel light at an angle of incidence [degrees]."""
    i = math.radians(angle)
    way = math.sin(i), 0.0, -math.cos(i)
    sun = DirectionalLight("sun", way, (1.0,) * 3, disc_degrees=0.0)
    return scene(sheet((0, 0, 0), (1, 0, 0), (0, 1, 0)), (material,), (2, -4, 2), (0.5, 0.5, 0), (sun,))


def _lit_metal(alpha: float, angle: float) -> Scene:
    """Return the same of white metal."""
    return _lit(Material("metal", (0.0,) * 3, gloss=Gloss((1.0,) * 3, alpha)), angle)


def _reflected(solver: Solver) -> float:
    """Return the flux that leaves the sheet / the flux that arrives."""
    paths, _ = solver.frame.store.subset(solver.frame.photons)
    arrived = np.flatnonzero(paths.side >= 0)
    return float(paths.flux[arrived, 1].sum() / paths.flux[arrived - 1, 1].sum())
