"""Light per pixel of a picture by rays: direct light at each ray's hit, bounced light where other things are near.

Vertices hold the light that bounces, which bends little, except beside other things: there paths gather it at pixels.
Where the harmonic mean of distances is 3 edges or more, bounced light is that of vertices, at 1 edge or less that of
paths (Ward, Rubinstein and Clear 1988). Rays of a pixel that meet one surface share a site.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.draw import raycast, visible
from app.draw.lit_scene import LitScene
from app.draw.visible import PIXEL_OFFSETS, PictureScene, PictureView, Strip
from gi_core.base.threads import run_ranges
from gi_core.base.vectors import length
from gi_core.display.dilation import Drawn
from gi_core.display.fine_points import FinePoints
from gi_core.display.pixel_light import LOG2_SET, TILE, PixelLight, Sites, around, group, spans, start_rays
from gi_core.gather.direct_light import Places
from gi_core.gather.path_ends import WHOLE, InKnownLight, in_known_light
from gi_core.geometry.error import luminance
from gi_core.model import Model
from gi_core.solver import Solver

SAMPLES = len(PIXEL_OFFSETS)
SETS = 2, 32  # of paths that gather bounced light at a site
AT_ONCE = 1 << 20  # rays or paths between two reports of progress

Report = Callable[[str, float], None]


class PixelSites(NamedTuple):
    """n sites of a picture and the rays that hit one."""

    of_ray: np.ndarray  # (rays,) int32, site of each ray of the picture, -1: none
    places: Sites  # a point per ray; their keys are pixels
    edge: np.ndarray  # (n,) float64 [m], longest edge of the face
    bounced: np.ndarray  # (n, 3) float64 [W/m2], light of vertices without direct light
    pixels: np.ndarray  # (h, >= w) int64, first site of each pixel, -1: none
    threads: int
    strips: list[Strip]

    def each(self, kernel: Callable, values: np.ndarray, *options) -> np.ndarray:
        """Return numbers, shaped as `values`, by a kernel of `pixel_light.py` at all sites."""
        out, places = np.empty_like(values), self.places
        of = self.pixels, places.key, places.turn(0), places.normal, values, *options
        run_ranges(lambda _, a, b: kernel(*of, a, out[a:b]), len(out), self.threads, 1 << 12)
        return out

    def mean(
        self, values: np.ndarray, radius: int, width: np.ndarray | None = None, at: np.ndarray | None = None
    ) -> np.ndarray:
        """Return means (n, c) of values (n, c) over the sites around, see around(); width None: of equal weight.

        at (n, d): None: places of the sites [m].
        """
        at = self.places.turn(0) if at is None else np.ascontiguousarray(at)
        return self.each(around, values, at, np.full(len(values), np.inf) if width is None else width, radius)


class PixelIrradiance(NamedTuple):
    """Light of a picture's sites."""

    strips: list[Strip]  # the rays of the picture
    of_ray: np.ndarray  # (rays,) int32, as of PixelSites
    light: np.ndarray  # (n, 3) float64 [W/m2], beside that of vertices at each ray
    variance: np.ndarray  # (n,) float64 [(W/m2)^2], of luminance
    share: np.ndarray  # (n,) float64, of the pixel's rays
    vertices: Drawn  # light of vertices that pixels interpolate

    def at(self, strip: Strip, hit: np.ndarray) -> np.ndarray:
        """Return the irradiance (n, 3) [W/m2] at hits of a strip beside that of vertices."""
        site = self.of_ray[strip.rays][hit]
        return np.where(site[:, None] < 0, 0.0, self.light[site])

    def variance_at(self, strip: Strip, hit: np.ndarray) -> np.ndarray:
        """Return values (n,) per hit of a strip whose means over pixels are variances of luminance."""
        site = self.of_ray[strip.rays][hit]
        return np.where(site < 0, 0.0, self.variance[site] * self.share[site])


def pixel_irradiance(
    solver: Solver, lit: LitScene, world: PictureScene, view: PictureView, fine: FinePoints | None, paths: int,
    report: Report,
) -> PixelIrradiance:  # fmt: skip
    """Return the light of a picture's pixels by rays; paths: whole ones per pixel, without bias; 0: see above.

    fine: the points that the lit scene has beside receivers.
    """
    light = PixelLight(solver.model, lit.at, lit.levels, solver.seed)
    if paths:
        drawn = lit.drawn._replace(irradiance=np.zeros_like(lit.drawn.irradiance))
    else:
        report("direct light at vertices", 0.0)
        drawn = _without_direct(solver, lit, light, fine)
    white = replace(lit, shows_radiance=False, drawn=drawn)
    sites = _sites(lit, world, view, raycast.both_sides(world, white.sides, lit.weights), fine, report)
    if paths:
        E, variance = _whole_paths(sites, light, paths, report)
    else:
        E, variance = _gathered(sites, light, solver, lit, view, *_direct(sites, light, report), report)
    return PixelIrradiance(sites.strips, sites.of_ray, E, variance, sites.places.count / SAMPLES, drawn)


def _without_direct(solver: Solver, lit: LitScene, light: PixelLight, fine: FinePoints | None) -> Drawn:
    """Return drawn light of receivers and fine points without direct light."""
    sets, rays = 4, 32  # of points on lights per vertex, and to each of them
    model, drawn = solver.model, solver.drawn(solver.irradiance)
    places, normals, lift = Places.at_poses(model, lit.at)
    every = np.arange(len(places))
    sites = Sites(places + lift[:, None] * normals, every, np.ones_like(every), normals, every)
    E, near = drawn.irradiance.copy(), np.zeros(len(places), bool)
    for k in range(sets):
        direct, _, too_near = light.direct(sites._replace(key=sets * every + k), rays)
        E -= direct / sets
        near |= too_near
    E[near] = light.gathered(sites.at(near), 0, SETS[1], _ending(solver, lit), True).mean(axis=0)
    drawn = drawn._replace(irradiance=E)
    return drawn if fine is None else fine.between(drawn)


def _sites(lit: LitScene, world: PictureScene, view: PictureView, vertices: raycast.Coloured,
           fine: FinePoints | None, report: Report) -> PixelSites:  # fmt: skip
    """Return the sites of a picture."""
    normals, edges = _vertex_normals(lit, fine), longest_edges(lit.model)
    parts: dict[int, tuple] = {}

    def part(strip: Strip) -> None:
        hit = np.flatnonzero(strip.face >= 0)
        face, u, v, d = strip.seen(hit)
        facing = (world.normals[face] * d).sum(axis=1) < 0
        on = facing | ~world.one_sided[face]
        hit, face, u, v, facing = hit[on], face[on], u[on], v[on], facing[on]
        (start, normal), (site, begin) = np.empty((2, len(hit), 3)), np.empty((2, len(hit)), np.int64)
        start_rays(world.corners, world.normals, normals, world.draw, face, u, v, facing, start, normal)
        n = group(hit // SAMPLES, start, normal, site, begin)
        order, begin = np.argsort(site, kind="stable"), begin[:n]
        count = np.bincount(site, minlength=n)
        ends = hit[np.stack([begin, order[np.cumsum(count) - 1]])]  # of a whole pixel their middle is that of the pixel
        E = math.pi * sum(raycast.seen_radiance(vertices, *strip.seen(h), None, strip.eye)[0] for h in ends) / 2
        of_ray = np.full(len(strip.face), -1, np.int32)
        of_ray[hit] = site
        pixel, edge = (hit[begin] + strip.rays.start) // SAMPLES, edges[world.base[face[begin]]]
        parts[strip.rows.start] = strip, of_ray, pixel, count, start[order], normal[begin], edge, E

    visible.draw_strips(part, lit, world, view, lambda f: report("casting rays", f))
    ordered = [parts[top] for top in sorted(parts)]
    sites = np.cumsum([0, *(len(p[3]) for p in ordered)])
    for p, n in zip(ordered, sites, strict=False):
        p[1][p[1] >= 0] += n
    strips, arrays = [p[0] for p in ordered], (p[1:] for p in ordered)
    of_ray, pixel, count, hits, normal, edge, light = (np.concatenate(a) for a in zip(*arrays, strict=True))
    row = view.width + (TILE - view.width) % TILE**2  # any square of pixels has all sets of points on lights
    pixel += pixel // view.width * (row - view.width)
    pixels, places = np.full((view.height, row), -1), Sites(hits, np.cumsum(count) - count, count, normal, pixel)
    pixels.flat[pixel[::-1]] = np.arange(len(pixel))[::-1]
    return PixelSites(of_ray, places, edge, light, pixels, lit.model.threads, strips)


def _vertex_normals(lit: LitScene, fine: FinePoints | None) -> np.ndarray:
    """Return the normals (D, 3) float64 of all draw vertices on their fronts, in the world."""
    of = lit.model.object_receivers.normals
    if fine is not None:
        of = np.concatenate([of, np.empty((len(fine.parents.shares), 3))])
        fine.parents.fill(len(lit.model.object_receivers.normals), of)
    return np.concatenate([of[mesh.front] @ lit.at.rotation[o].T for o, mesh in enumerate(lit.meshes)])


def _direct(sites: PixelSites, light: PixelLight, report: Report) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return direct light (n, 3) [W/m2] of sites, the variance of its luminance, and where (n,) lamps are too near."""
    rays_at_first, rays_at_borders, differ = 8, 32, 0.02  # of a pixel's light, beside it
    pixels, even_share = TILE // 2, 0.005  # that alike light is averaged over; scatter of unblocked light that is left
    n = len(sites.edge)
    E, whole, near, rays = np.empty((n, 3)), np.empty(n), np.empty(n, bool), np.empty(n)

    def shine(which: np.ndarray, count: int, label: str) -> None:
        for k in range(0, len(which), AT_ONCE // count):
            report(label, k / len(which))
            rows = which[k : k + AT_ONCE // count]
            E[rows], whole[rows], near[rows] = light.direct(sites.places.at(rows), count)
            rays[rows] = count

    shine(np.arange(n), rays_at_first, "direct light")
    per = 1 / np.maximum(whole, 1e-300)
    span = sites.each(spans, luminance(E) * per)
    shine(np.flatnonzero(span * whole > differ * luminance(sites.bounced + E)), rays_at_borders, "borders of shadows")
    # Shares of unblocked light are those of independent rays: stratified ones vary less.
    per = 1 / np.maximum(whole, 1e-300)
    share = np.minimum(luminance(E) * per, 1.0)
    variance = share * (1 - share) / (rays - 1)
    guide = sites.mean(np.stack([share, variance, variance], axis=1), 1)
    values = np.concatenate([E * per[:, None], variance[:, None]], axis=1)
    smooth = sites.mean(values, pixels, 8 * guide[:, 2], guide[:, :1])  # over sites of a like share, by its noise
    # Pixels have different points on lamps: unblocked light is noisy too, and has no borders of shadows.
    beside, square, _ = sites.mean(np.stack([whole, whole**2, whole], axis=1), 1).T
    scatter = np.maximum(square - beside**2, 0.0)
    scatter[scatter < (even_share * beside) ** 2] = 0.0
    whole, even = sites.mean(np.stack([whole, scatter], axis=1), pixels, scatter, beside[:, None]).T
    return smooth[:, :3] * whole[:, None], smooth[:, 3] * whole**2 + luminance(smooth[:, :3]) ** 2 * even, near


def _gathered(
    sites: PixelSites, light: PixelLight, solver: Solver, lit: LitScene, view: PictureView,
    direct: np.ndarray, noise: np.ndarray, near_lamps: np.ndarray, report: Report,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return light (n, 3) [W/m2] of sites beside the bounced light of vertices, and the variance of its luminance."""
    nearest, farthest = 1.0, 3.0  # edges of the face: bounced light of paths alone, of vertices alone
    rays, around_pixel, smooth_pixels = 4, 2, 4  # of distances; pixels whose distances and bounced light are averaged
    n, places = len(sites.edge), sites.places
    reach, close = 2 * farthest * sites.edge, np.zeros((n, 2))
    for k in range(0, n, AT_ONCE):
        report("distances", k / n)
        part = slice(k, k + AT_ONCE)
        close[part, 0] = light.closeness(places.at(part), reach[part], rays)
    distance = 1 / np.maximum(sites.mean(close, around_pixel)[:, 0], 1e-300)
    share = np.clip((farthest - distance / sites.edge) / (farthest - nearest), 0.0, 1.0)
    share[near_lamps] = 1.0
    blur = 0.2 * np.minimum(distance, reach)  # [m], over which gathered light is averaged
    pixel = length(places.turn(0) - view.camera.eye()) * (2 * math.tan(view.camera.fov / 2) / view.height)
    averaged = np.clip(math.pi * (2 * blur / pixel) ** 2, 1, (2 * smooth_pixels + 1) ** 2)
    averaged[near_lamps] = 1.0
    sets = _sets(averaged, share > 0)
    ending, total, squares = _ending(solver, lit), np.zeros((n, 3)), np.zeros(n)
    parts = [(np.flatnonzero((share > 0) & (near_lamps != bounced)), bounced) for bounced in (True, False)]
    most = int(sets.max(initial=1))
    for j in range(most):
        for rows, bounced in ((rows[sets[rows] > j], bounced) for rows, bounced in parts):
            for k in range(0, len(rows), AT_ONCE >> LOG2_SET):
                which = rows[k : k + (AT_ONCE >> LOG2_SET)]
                E = light.gathered(places.at(which), j, 1, ending, bounced)[0]
                total[which] += E
                squares[which] += luminance(E) ** 2
                report(f"bounced light{_error_text(direct + sites.bounced, noise)}", (j + k / len(rows)) / most)
    E = total / sets[:, None]
    variance = np.maximum(squares / sets - luminance(E) ** 2, 0.0) / (sets - 1)
    added = np.concatenate([share[:, None] * (E - sites.bounced), (share**2 * variance)[:, None]], axis=1)
    # Light straight from lamps has borders: it is not averaged, nor is other light with it.
    far_pixels = sites.pixels.copy()
    far_pixels[(far_pixels >= 0) & near_lamps[far_pixels]] = -1
    far = sites._replace(pixels=far_pixels)
    smooth = far.mean(added, smooth_pixels, 2 * blur**2)
    of = np.stack([luminance(smooth[:, :3]) ** 2, smooth[:, 3], np.zeros(n)], axis=1)
    square, noisy, _ = far.mean(of, smooth_pixels).T
    smooth[:, :3] *= np.maximum(1 - noisy / np.maximum(square, 1e-300), 0)[:, None]
    added[~near_lamps] = smooth[~near_lamps]
    direct, noise = np.where(near_lamps[:, None], 0.0, direct), np.where(near_lamps, 0.0, noise)
    return direct + added[:, :3], noise + added[:, 3]


def _sets(averaged: np.ndarray, traced: np.ndarray) -> np.ndarray:
    """Return the sets (n,) int of paths per site: the more, the fewer sites (n,) are averaged around it.

    All together trace a limited number of paths.
    """
    most_paths, for_mean = 1 << 23, 64
    wanted, sets = SETS[1], np.full(len(averaged), SETS[0])
    while wanted > SETS[0]:
        sets = np.clip(np.ceil(for_mean * wanted / SETS[1] / averaged), SETS[0], wanted).astype(np.int64)
        if int(sets[traced].sum()) << LOG2_SET <= most_paths:
            break
        wanted //= 2
    return sets


def _ending(solver: Solver, lit: LitScene) -> InKnownLight:
    """Return the light in which paths end: that of the frame."""
    area = math.pi * solver.setting.radius**2
    return in_known_light(solver.model, lit.at, solver.irradiance, area, longest_edges(solver.model))


def longest_edges(model: Model) -> np.ndarray:
    """Return the longest edge (F,) [m] of all faces."""
    corners = model.object_receivers.positions[model.surfaces.corner_front]
    return length(corners - np.roll(corners, 1, axis=1)).max(axis=1)


def _whole_paths(sites: PixelSites, light: PixelLight, paths: int, report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Return the light (n, 3) [W/m2] of whole paths at sites, and the variance of its luminance."""
    n, sets = len(sites.edge), max(-(-paths >> LOG2_SET), 2)
    mean, squares, text = np.zeros((n, 3)), np.zeros(n), ""
    for j in range(sets):
        before = luminance(mean)
        for k in range(0, n, AT_ONCE >> LOG2_SET):
            report(f"whole paths{text}", (j + k / n) / sets)
            rows = slice(k, k + (AT_ONCE >> LOG2_SET))
            E = light.gathered(sites.places.at(rows), j, 1, WHOLE, False)[0]
            mean[rows] += (E - mean[rows]) / (j + 1)
            Y = luminance(E)
            squares[rows] += (Y - before[rows]) * (Y - luminance(mean[rows]))
        text = _error_text(mean, squares / ((j + 1) * max(j, 1))) if j else ""
    return mean, squares / (sets * (sets - 1))


def _error_text(E: np.ndarray, variance: np.ndarray) -> str:
    """Return the relative l1 noise of pixels as text."""
    noise = math.sqrt(2 / math.pi) * np.sqrt(variance).sum() / max(luminance(E).sum(), 1e-300)
    return f", noise {100 * noise:.2g} %"
