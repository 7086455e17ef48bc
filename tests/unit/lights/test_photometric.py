"""Luminaires: directions drawn in proportion to their candela table, and light on a plane by the inverse square law."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

from gi_core.base.jit import allocating
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.surfaces import flatten
from gi_core.lights import photometric
from gi_core.lights.emission import build_emitters, emit
from gi_core.lights.photometric import axes, density, flux_of, tables_of
from gi_core.scene.types import PhotometricLight
from tests.support import closed_form, photometry
from tests.support import scene_builders as build
from tests.support.photometry import GAMMAS, PLANES, candela, luminaire, uneven
from tests.support.significance import chi_square, z_test

PHOTONS = 1 << 17
NARROW = PhotometricLight(
    "beam", (0, 0, 0), (0, 0, -1), (1, 0, 0), (1.0,) * 3, np.array([0.0, 0.5, 1.0, 4.0]), np.array([0.0, 360.0]),
    np.array([[9000.0, 8000.0, 500.0, 0.0]] * 2),
)  # fmt: skip


@allocating
def densities(tables, start, axis, c0, directions):
    out = np.empty(len(directions))
    for k in range(len(directions)):
        out[k] = density(tables, start, axis, c0, directions[k, 0], directions[k, 1], directions[k, 2])
    return out


def density_of(light: PhotometricLight, directions: np.ndarray) -> np.ndarray:
    tables, (start,) = tables_of((light,))
    return densities(tables, start, *axes(light), directions)


def directions(gamma, plane, light) -> np.ndarray:
    """Return unit directions (n, 3) of angles in degrees."""
    axis, c0 = axes(light)
    g, c = np.radians(gamma)[..., None], np.radians(plane)[..., None]
    return np.sin(g) * (np.cos(c) * c0 + np.sin(c) * np.cross(c0, axis)) + np.cos(g) * axis


def emitted(light: PhotometricLight, count: int, seed: int = 0):
    """Return origins and directions (count, 3) of photons."""
    scene = build.plane_scene(light)
    origin, direction, *_ = emit(build_emitters(scene, flatten(scene)[0], np.zeros(3), 1.0), seed, 0, count)
    return origin.astype(float), direction.astype(float)


def test_density_is_the_candela_table_over_its_flux():
    light = luminaire()
    rng = np.random.default_rng(0)
    d = rng.normal(size=(4000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    assert density_of(light, d) * photometry.table_flux(light) == pytest.approx(candela(light, d), rel=1e-9)
    # At the table's own angles the density is the candela number that the file has there.
    g, c = (a.ravel() for a in np.meshgrid(GAMMAS[1:-1], PLANES[:-1]))
    at_knots = density_of(light, directions(g, c, light)) * photometry.table_flux(light)
    assert at_knots == pytest.approx(uneven()[:-1, 1:-1].ravel(), rel=1e-6, abs=1e-6)


def test_flux_is_the_integral_of_the_table():
    light = luminaire()
    total = 0.0
    for i in range(len(GAMMAS) - 1):
        for j in range(len(PLANES) - 1):
            corners = uneven()[j : j + 2, i : i + 2]

            def value(c, g, corners=corners, i=i, j=j):
                u, w = (g - GAMMAS[i]) / (GAMMAS[i + 1] - GAMMAS[i]), (c - PLANES[j]) / (PLANES[j + 1] - PLANES[j])
                at = (1 - w) * ((1 - u) * corners[0, 0] + u * corners[0, 1]) + w * (
                    (1 - u) * corners[1, 0] + u * corners[1, 1]
                )
                return at * math.sin(math.radians(g)) * math.radians(1) ** 2

            total += dblquad(value, GAMMAS[i], GAMMAS[i + 1], PLANES[j], PLANES[j + 1])[0]
    assert photometry.table_flux(light) == pytest.approx(total, rel=1e-9)
    # Closed forms: 4 pi I of an even source, pi I of a cosine.
    assert flux_of(np.array([0.0, 180.0]), np.array([0.0, 360.0]), np.full((2, 2), 3.0)) == pytest.approx(12 * math.pi)
    fine = np.linspace(0, 90, 901)
    cosine = np.tile(np.cos(np.radians(fine)), (2, 1))
    assert flux_of(fine, np.array([0.0, 360.0]), cosine) == pytest.approx(math.pi, rel=1e-6)


@pytest.mark.parametrize("light", [luminaire(), NARROW], ids=lambda light: light.name)
def test_photons_follow_the_density(light):
    """Chi-square of draws against the integral of the table over cells that do not coincide with the table's."""
    _, d = emitted(light, PHOTONS)
    axis, c0 = axes(light)
    x, y, z = d @ c0, d @ np.cross(c0, axis), d @ axis
    most = light.gammas_degrees[-1]
    gamma, plane = np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x)) % 360
    g, c = np.linspace(0, most, 24), np.linspace(0, 360, 17)
    found = np.histogram2d(np.minimum(gamma, most), plane, (g, c))[0]
    parts = 40  # of a cell per side: midpoints
    fine_g, fine_c = (np.linspace(e[0], e[-1], parts * (len(e) - 1) + 1) for e in (g, c))
    mid_g, mid_c = (0.5 * (e[1:] + e[:-1]) for e in (fine_g, fine_c))
    gg, cc = np.meshgrid(mid_g, mid_c, indexing="ij")
    solid = np.cos(np.radians(fine_g[:-1])) - np.cos(np.radians(fine_g[1:]))
    share = candela(light, directions(gg.ravel(), cc.ravel(), light)).reshape(gg.shape) * solid[:, None]
    expected = share.reshape(len(g) - 1, parts, len(c) - 1, parts).sum(axis=(1, 3))
    assert found.sum() == PHOTONS
    assert found[expected < 1e-6 * expected.sum()].sum() == 0
    rows = expected > 1e-4 * expected.sum()
    chi_square(found[rows], expected[rows] / expected[rows].sum() * found[rows].sum(), light.name)


def test_draws_invert_the_distribution():
    """The share of light below a drawn gamma is the number that drew it, to rounding."""
    light = luminaire()
    tables, (start,) = tables_of((light,))
    for u in (0.0, 1e-9, 0.013, 0.31, 0.5, 0.77, 0.9999, 1 - 1e-12):
        gamma, plane = photometric.drawn(tables, start, u, 0.4)
        cut = np.append(GAMMAS[np.radians(GAMMAS) < gamma], math.degrees(gamma))
        if len(cut) > 1 and cut[-1] - cut[-2] > 1e-3:
            rows = np.stack([np.interp(cut, GAMMAS, row) for row in uneven()])
            assert flux_of(cut, PLANES, rows) / photometry.table_flux(light) == pytest.approx(u, abs=1e-9)
        assert 0 <= plane <= 2 * math.pi


@pytest.mark.parametrize("size", [(0.0, 0.0), (0.2, 0.5)])
def test_light_on_a_plane(size):
    """E = I(gamma, C) cos / d^2 under a point; under a rectangle, its mean over the rectangle."""
    light = luminaire(position=(0.1, 0.0, 0.7), flux=(100.0, 200.0, 50.0), size=size)
    points = np.array([(x, y, 0.0) for x in (-0.6, 0.0, 0.3) for y in (-0.4, 0.1, 0.8)])
    scene = build.plane_scene(light, reflectance=0.0)
    E, error = reference_irradiance(scene, points, np.tile([0.0, 0, 1], (9, 1)), 20_000, 1)
    axis, c0 = axes(light)
    u, v = ((np.arange(60) + 0.5) / 60 - 0.5 for _ in range(2))
    at = np.array(light.position) + np.add.outer(u, 0 * v).ravel()[:, None] * size[0] * c0
    at = at + np.add.outer(0 * u, v).ravel()[:, None] * size[1] * np.cross(c0, axis)
    expected = []
    for p in points:
        way = p - at
        d = np.sqrt((way * way).sum(axis=1))
        intensity = candela(light, way / d[:, None]) / photometry.table_flux(light) * light.flux[1]
        expected.append((intensity * -way[:, 2] / d**3).mean())
    expected = np.array(expected)
    z_test(E[:, 1], expected, np.hypot(error[:, 1], 1e-3 * expected), f"size {size}")
    assert E[:, 0] == pytest.approx(E[:, 1] / 2) and E[:, 2] == pytest.approx(E[:, 1] / 4)
    if size[0] == 0:
        assert error.max() < 1e-9 * expected.max()


@pytest.mark.parametrize(("height", "ratio"), [(1.0, 1.33), (3.0, 1.037), (5.0, 1.013)])
def test_a_panel_as_a_point_is_too_bright_near_by(height, ratio):
    """Below a diffuse square panel of 1 m; docs/stability.md has the ratios, by Lambert's form factor."""
    gammas = np.linspace(0.0, 90.0, 181)
    table = np.tile(np.cos(np.radians(gammas)), (2, 1))
    panel = PhotometricLight(
        "panel",
        (0, 0, height),
        (0, 0, -1),
        (1, 0, 0),
        (math.pi,) * 3,
        gammas,
        np.array([0.0, 360.0]),
        table,
        (1.0, 1.0),
    )
    at = np.zeros((1, 3)), np.array([[0.0, 0, 1]])
    truth = closed_form.parallel_rectangle(1.0, -0.5, 0.5, -0.5, 0.5, height, 0.0, 0.0)
    E, error = reference_irradiance(build.plane_scene(panel), *at, 20_000, 4)
    z_test(E[0, 0], truth, math.hypot(error[0, 0], 1e-4 * truth), f"panel at {height} m")
    point, _ = reference_irradiance(build.plane_scene(panel._replace(size=(0.0, 0.0))), *at, 2, 4)
    assert point[0, 0] / truth == pytest.approx(ratio, abs=0.005)


def test_photons_start_evenly_on_the_rectangle():
    light = luminaire(size=(0.2, 0.5), position=(1.0, 2.0, 3.0))
    origin, _ = emitted(light, 1 << 14)
    axis, c0 = axes(light)
    way = origin - np.array(light.position)
    assert np.abs(way @ axis).max() < 1e-6
    along, across = way @ c0 / 0.2 + 0.5, way @ np.cross(c0, axis) / 0.5 + 0.5
    found = np.histogram2d(along, across, 8, ((0, 1), (0, 1)))[0]
    assert found.sum() == 1 << 14
    assert np.abs(found / found.mean() - 1).max() < 0.1


def test_lights_of_one_table_share_it():
    one = luminaire("one")
    tables, starts = tables_of((one, one._replace(name="two"), luminaire("three", intensity=uneven(2))))
    assert starts[0] == starts[1] == 0 < starts[2] and len(tables) == 2 * starts[2]
