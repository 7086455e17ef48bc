"""Gloss at its limits: lobes to 0, draws below the surface, two sides, few and many rays, more light than arrives."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from app.measure.atlas.gloss import (
    EYE_DISTANCE,
    F0,
    SMALL,
    eye_at,
    ggx_value,
    lobe_at,
    rays_of,
    sheets_under_the_sky,
)
from app.measure.atlas.row import SEEDS, AtlasRow, Number, near, over_seeds, scene, sheet, solved
from gi_core.bsdf.models import lobe
from gi_core.instruments.gloss_rays import CELLS, LEAST_ALPHA, LIST, MOST_LISTED_PHOTONS, radiance_of, single_rays
from gi_core.model import Model
from gi_core.scene import DirectionalLight, Material, Scene, SkyLight
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Gloss
from gi_core.solver import Solver

FIELD_PHOTONS = 100_000
SATIN = 0.3  # alpha
STEEP = 85.0  # degrees of incidence


def towards_a_mirror() -> Iterator[AtlasRow]:
    """Half of GGX's facets are tilted by less than atan alpha: light along the normal leaves within twice that."""
    for alpha in (0.1, 0.01, 0.002, 0.0):

        def run(seed, alpha=alpha):
            solver = solved(_lit_metal(alpha, 0.0), FIELD_PHOTONS, seed)
            return (float(np.median(_angles(solver))),)

        (measured,) = over_seeds(run, SEEDS)
        yield AtlasRow(
            f"gloss_alpha_{alpha}", f"photons along the normal of metal of alpha {alpha}",
            "median angle of reflection 2 atan(alpha); below 0.001 a mirror", math.degrees(2 * math.atan(alpha)),
            measured if alpha else Number(measured.mean),
            within=1e-5 if alpha == 0 else 0.01 * math.degrees(2 * math.atan(alpha)), quantity="degrees",
            title="Gloss towards a mirror",
        )  # fmt: skip


def sharper_than_drawn() -> AtlasRow:
    """Single rays are drawn with a lobe of LEAST_ALPHA at least: too dim in the middle of a sharper one."""
    alpha = 0.05
    solver = solved(_lit_metal(alpha, 0.0), FIELD_PHOTONS, gloss=LIST)
    rays, row, corner = rays_of(solver)
    seen = radiance_of(solver, rays, row, corner, eye_at(0.0))[:, 1]
    up = np.array([0.0, 0.0, 1.0])
    return AtlasRow(
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


def two_sided() -> AtlasRow:
    """Segments that cross a disc from behind belong to the other side's receiver."""
    field = _lit_metal(SATIN, 0.0, upwards=True, two_sided=True)
    solver = solved(field, FIELD_PHOTONS, gloss=LIST)
    light, counts = solver.frame.gloss, np.diff(solver.frame.gloss.tree.offsets[::CELLS])
    sides = [
        counts[np.isin(light.rows, corners)] for corners in (solver.surfaces.corner_front, solver.surfaces.corner_back)
    ]
    return AtlasRow(
        "gloss_two_sides", "a two-sided sheet lit from below", "no ray reaches the upper side", 0.0,
        Number(float(sides[0].sum() / sides[1].sum())), quantity="rays above / rays below",
    )  # fmt: skip


def few_rays() -> Iterator[AtlasRow]:
    """Receivers of no ray and of one."""
    solver = solved(sheets_under_the_sky(SATIN), 10_000, radius=SMALL, gloss=LIST)
    listed, row, corner = rays_of(solver)
    seen = radiance_of(solver, listed, row, corner, eye_at(0.0))[:, 1]
    first = listed.offsets[::CELLS]
    counts = np.diff(first)[row]
    yield AtlasRow(
        "gloss_no_ray", f"{(counts == 0).sum()} receivers that no ray reaches", "black, and no division by 0", 0.0,
        Number(float(np.abs(seen[counts == 0]).max())), quantity="largest radiance", title="Few rays",
    )  # fmt: skip
    alone = np.flatnonzero(counts == 1)
    rays = listed.rays[first[row[alone]], 3:].astype(float)
    far = rays[:, 2] > 0.1
    exact = ggx_value(SATIN, rays[far], eye_at(0.0) / EYE_DISTANCE)
    yield AtlasRow(
        "gloss_one_ray", f"{far.sum()} receivers with a single ray", "f E of this ray", 1.0,
        Number(float((seen[alone][far] / exact).mean())), within=1e-4, quantity="radiance / f E", title="Few rays",
    )  # fmt: skip


def many_rays() -> AtlasRow:
    """A receiver of as many rays as a list can get: it has the integral, cells come near in 1/2000 of its memory."""
    _, f, weights = lobe_at(SATIN, 45.0)
    truth = float(weights @ f) / math.pi
    satin = Material("satin", (0.2,) * 3, gloss=Gloss((F0,) * 3, SATIN))
    ground = sheet((0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 2))
    field = scene(ground, (satin,), (2, -4, 2), (0.5, 0.5, 0), (SkyLight("sky", (1 / math.pi,) * 3),))

    def run(seed):
        # 0.35 m: discs of gloss have twice that
        solver = solved(field, MOST_LISTED_PHOTONS, seed, radius=0.35, gloss=LIST)
        middle = np.flatnonzero(near((0.5, 0.5, 0.0))(solver.receivers))[:1]
        rays, row = single_rays(solver, middle)
        counts.append(int(np.diff(rays.offsets[::CELLS])[row[0]]))
        cells = rays._replace(opened=0.0, offsets=np.zeros(1, np.int64))
        eye = eye_at(math.radians(45.0))
        return [float(radiance_of(solver, d, row, middle, eye)[0, 1]) / truth for d in (rays, cells)]

    counts: list[int] = []
    listed, summed = over_seeds(run, 6)
    return AtlasRow(
        "gloss_many_rays", f"a receiver of {min(counts):,} rays under an even sky, {min(counts) * 24 / 1e6:.1f} MB",
        "the integral of f L cos", 1.0, listed, f"64 cells, {CELLS * 24:,} B", summed, within=0.005, aim_within=0.02,
        quantity="radiance / truth",
    )  # fmt: skip


def from_below() -> AtlasRow:
    """An eye below the plane of a one-sided face."""
    solver = solved(sheets_under_the_sky(SATIN), 10_000, radius=SMALL, gloss=LIST)
    seen = radiance_of(solver, *rays_of(solver), -eye_at(0.5))
    return AtlasRow(
        "gloss_from_below", "lit gloss seen from below its surface", "nothing is sent there", 0.0,
        Number(float(np.abs(seen).max())), quantity="largest radiance",
    )  # fmt: skip


def more_than_arrives() -> Iterator[AtlasRow]:
    """Phong's lobe over cos i is refused where it reflects more than arrives, or darkened to all that arrives."""
    n = 20
    shiny = Material("shiny", brdf=(lobe("phong", {"n": n, "ks": 1.0}),))
    place, title = f"Phong's model, n = {n}, ks = 1", "Surfaces that reflect more light than arrives"
    field = _lit(shiny, STEEP)
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
    for angle, expected in ((45.0, _phong(n, 45.0)), (STEEP, 1.0)):

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


def _lit(material: Material, angle: float, upwards: bool = False) -> Scene:
    """Return a sheet of 1 m under parallel light at an angle of incidence [degrees], or over it."""
    i = math.radians(angle)
    sun = DirectionalLight("sun", (math.sin(i), 0.0, math.cos(i) if upwards else -math.cos(i)), (1.0,) * 3)
    return scene(sheet((0, 0, 0), (1, 0, 0), (0, 1, 0)), (material,), (2, -4, 2), (0.5, 0.5, 0), (sun,))


def _lit_metal(alpha: float, angle: float, two_sided: bool = False, upwards: bool = False) -> Scene:
    """Return the same of white metal."""
    metal = Material("metal", (0.0,) * 3, gloss=Gloss((1.0,) * 3, alpha), two_sided=two_sided)
    return _lit(metal, angle, upwards)


def _reflected(solver: Solver) -> float:
    """Return the flux that leaves the sheet / the flux that arrives."""
    paths, _ = solver.frame.store.subset(solver.frame.photons)
    arrived = np.flatnonzero(paths.side >= 0)
    return float(paths.flux[arrived, 1].sum() / paths.flux[arrived - 1, 1].sum())


def _angles(solver: Solver) -> np.ndarray:
    """Return the angles [degrees] from the normal at which photons leave the sheet."""
    paths, _ = solver.frame.store.subset(solver.frame.photons)
    left = np.flatnonzero((paths.side >= 0) & (paths.flux[:, 1] > 0))
    way = (paths.position[left + 1] - paths.position[left]).astype(float)
    return np.degrees(np.arctan2(np.hypot(way[:, 0], way[:, 1]), way[:, 2]))
