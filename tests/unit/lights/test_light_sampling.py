"""Lamps chosen by their possible light on a mobile: correct densities, and lamps with much light preferred."""

import math

import numpy as np
import pytest

from gi_core.gather import mobile
from gi_core.gather.mobile import MobileGather, steady
from gi_core.gather.reference import reference_irradiance
from gi_core.lights.area import BY_FLUX, aimed, area_lights
from gi_core.lights.lamps import at_levels
from gi_core.lights.next_event import points_on_lamps
from gi_core.lights.photometric import flux_of
from gi_core.model import Model
from gi_core.scene.types import Mesh, Mobile, PhotometricLight, Pose, Scene
from tests.support.closed_form import lambert_polygon
from tests.support.scene_builders import box, grey, lamp, merge, quad

CENTRE, RADIUS = np.array([0.5, 0.5, 0.3]), 0.2


def room(*lamps) -> Model:
    """Return a black room with lamps in it, Le 1, 2, ... and a box."""
    walls = merge(box((0, 0, 0), (1, 1, 1), 1, 0, inward=True), *lamps)
    things = (Mobile("box", box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), 2), Pose(tuple(CENTRE))),)
    materials = grey(0.0), *(lamp(float(k)) for k in range(1, 1 + len(lamps)))
    return Model(Scene(walls, materials, things, up=(0, 0, 1)), 1)


def downward(x: float, y: float, z: float, size: float, material: int, divisions: int = 1):
    return quad((x, y, z), (0, size, 0), (size, 0, 0), (divisions, divisions), material)


def areas(lights) -> np.ndarray:
    a, b, c = lights.corners.reshape(-1, 3, 3).swapaxes(0, 1)
    return 0.5 * np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1))


def test_emissive_faces_lie_along_a_curve():
    model = room(downward(0.1, 0.1, 0.9, 0.4, 1, 16), downward(0.6, 0.6, 0.8, 0.2, 2, 4))
    lights, emission = area_lights(model.surfaces), model.surfaces.emission
    lit = np.flatnonzero(lights.of_face >= 0)
    assert np.array_equal(lit, np.flatnonzero(emission.max(axis=1) > 0))
    assert np.array_equal(lights.radiance[lights.of_face[lit]], emission[lit])
    faces = model.surfaces.vertices[0][model.surfaces.faces[0][lit]].reshape(-1, 9)
    assert np.array_equal(lights.corners[lights.of_face[lit]], faces)
    assert np.allclose(np.diff(lights.cdf, prepend=0), areas(lights) * lights.density, rtol=1e-9)
    assert lights.cdf[-1] == 1.0
    # Of 512 faces of one lamp, 32 consecutive ones form a square, not a band from side to side.
    middle = lights.corners.reshape(-1, 3, 3).mean(axis=1)[lights.radiance[:, 0] == 1]
    assert len(middle) == 512
    assert np.median([np.ptp(middle[k : k + 32], axis=0).max() for k in range(0, 512, 32)]) < 0.5 * 0.4


def test_choice_is_a_density_and_prefers_lamps_facing_the_mobile():
    """One lamp faces the mobile, one faces away, one is far away; radiance is proportional to area."""
    near, away = downward(0.3, 0.3, 0.95, 0.4, 1, 3), quad((0.3, 0.3, 0.9), (0.4, 0, 0), (0, 0.4, 0), (3, 3), 2)
    far = downward(20.0, 20.0, 0.95, 0.4, 3, 3)
    model = room(near, away, far)
    plain = area_lights(model.surfaces)
    lights = aimed(plain, CENTRE, RADIUS)
    share = np.diff(lights.cdf, prepend=0)
    assert np.allclose(share, lights.density * areas(lights), rtol=1e-9) and lights.cdf[-1] == 1.0
    total = [share[plain.radiance[:, 0] == Le].sum() for Le in (1, 2, 3)]
    assert total[1] == pytest.approx(BY_FLUX * 2 / 6) and total[2] == pytest.approx(BY_FLUX * 3 / 6, rel=0.2)
    assert sum(total) == pytest.approx(1.0)
    points = points_on_lamps(0, 10, 0, np.arange(1024)[None], lights)
    counted = np.bincount(points.face[0], minlength=len(share)) / 1024
    assert np.allclose(counted, share, atol=2 / 1024)


def test_each_share_is_the_formula():
    """Radiance times area times the best cosine to a point of the sphere, searched for here, over distance squared."""
    chance = np.random.default_rng(1)
    lamps = downward(0.1, 0.1, 0.9, 0.7, 1, 4), downward(0.0, 0.0, 0.35, 1.0, 2, 5), downward(0.0, 0.0, 0.05, 0.3, 3, 2)
    plain = area_lights(room(*lamps).surfaces)
    points = chance.standard_normal((20_000, 3))
    points = CENTRE + RADIUS * points / np.sqrt((points**2).sum(axis=1))[:, None]
    size, expected = areas(plain), []
    for corners, n, Le, a in zip(
        plain.corners.reshape(-1, 3, 3), plain.normal, plain.radiance[:, 0], size, strict=True
    ):
        middle = corners.mean(axis=0)
        way, d2 = points - middle, ((CENTRE - middle) ** 2).sum()
        best = 1.0 if d2 < RADIUS**2 else max(0.0, (way @ n / np.sqrt((way**2).sum(axis=1))).max())
        expected.append(Le * a * best / (d2 + RADIUS**2 + a))
    flux, expected = plain.radiance[:, 0] * size, np.array(expected)
    expected = (1 - BY_FLUX) * expected / expected.sum() + BY_FLUX * flux / flux.sum()
    share = np.diff(aimed(plain, CENTRE, RADIUS).cdf, prepend=0)
    assert 0 < (expected < 2 * BY_FLUX * flux / flux.sum()).sum() < len(expected), "some look away"
    assert np.allclose(share, expected, rtol=0.01)


def test_each_share_of_a_luminaire_is_its_intensity_towards_the_mobile():
    """An uplight over the mobile and two downlights, a spot among them; searched for here in the table itself."""
    gammas, planes = np.linspace(0.0, 180.0, 19), np.array([0.0, 90.0, 180.0, 270.0, 360.0])
    down, narrow = np.maximum(np.cos(np.radians(gammas)), 0.0), np.exp(-((gammas / 20.0) ** 2))
    lights = tuple(
        PhotometricLight(
            name, place, direction, (1.0, 0.0, 0.0), (1.0, 1.0, 1.0), gammas, planes, np.tile(row, (5, 1)), (0.2, 0.1)
        )
        for name, place, row, direction in (
            ("up", (0.5, 0.5, 0.9), down, (0.0, 0.0, 1.0)),
            ("down", (0.5, 0.5, 0.95), down, (0.0, 0.0, -1.0)),
            ("beam", (0.8, 0.2, 0.9), narrow, (0.0, 0.0, -1.0)),
        )
    )
    scene = room().scene
    model = Model(Scene(scene.static, scene.materials, scene.mobiles, lights, up=(0, 0, 1)), 1)
    share = np.diff(aimed(model.lights.area, CENTRE, RADIUS).cdf, prepend=0).reshape(3, 2).sum(axis=1)
    chance, expected = np.random.default_rng(2), []
    points = chance.standard_normal((20_000, 3))
    points = CENTRE + RADIUS * points / np.sqrt((points**2).sum(axis=1))[:, None]
    for light, row in zip(lights, (down, down, narrow), strict=True):
        way = points - light.position
        gamma = np.degrees(np.arccos(way @ light.direction / np.sqrt((way**2).sum(axis=1))))
        best = np.interp(gamma, gammas, row).max() / flux_of(gammas, planes, np.tile(row, (5, 1)))
        expected.append(best / (((CENTRE - light.position) ** 2).sum() + RADIUS**2 + 0.01))
    expected = np.array(expected) / np.sum(expected)
    assert share[0] == pytest.approx(BY_FLUX / 3, rel=1e-6), "the uplight has its share of flux alone"
    assert np.allclose(share, (1 - BY_FLUX) * expected + BY_FLUX / 3, rtol=0.05)


def test_choice_is_by_flux_if_no_lamp_faces_the_mobile():
    plain = area_lights(room(quad((0.3, 0.3, 0.9), (0.4, 0, 0), (0, 0.4, 0), (2, 2), 1)).surfaces)
    assert np.allclose(aimed(plain, CENTRE, RADIUS).cdf, plain.cdf, rtol=1e-12)


def test_light_equals_the_closed_form_for_any_choice_of_lamps():
    """A lamp close over the box, met by bounces as well, and a brighter one far off: shares must add up to 1."""
    model = room(downward(0.35, 0.35, 0.5, 0.3, 1, 2), downward(0.0, 0.0, 0.99, 0.1, 2, 2))
    at = model.transforms(model.start_poses())
    gathers = [MobileGather(model, seed) for seed in range(8)]
    found = np.mean([g.irradiance(at, np.zeros((model.first_probe, 3)), 1024)[:, 0] for g in gathers], axis=0)
    positions, normals = gathers[0]._positions + CENTRE, gathers[0]._normals
    up = np.flatnonzero(normals[:, 2] > 0.5)
    close = np.array([[0.35, 0.35, 0.5], [0.35, 0.65, 0.5], [0.65, 0.65, 0.5], [0.65, 0.35, 0.5]])
    far = np.array([[0.0, 0.0, 0.99], [0.0, 0.1, 0.99], [0.1, 0.1, 0.99], [0.1, 0.0, 0.99]])
    expected = [
        sum(lambert_polygon(Le, p, positions[k], normals[k]) for Le, p in ((1.0, close), (2.0, far))) for k in up
    ]
    assert len(up) >= 9 and np.allclose(found[up], expected, rtol=0.01)


def test_bounces_hit_a_lamp_of_one_face():
    """Bounces hit a lamp close over the box; by gathering and by the reference's paths."""
    corners = np.array([[0.35, 0.35, 0.43], [0.35, 0.65, 0.43], [0.65, 0.65, 0.43]])
    model = room(Mesh(corners, np.array([[0, 1, 2]], np.int32), np.array([1], np.int32)))
    at, gather = model.transforms(model.start_poses()), MobileGather(model, 0)
    found = gather.irradiance(at, np.zeros((model.first_probe, 3)), 16384)[:, 0]
    positions, normals = gather._positions + CENTRE, gather._normals
    up = np.flatnonzero(normals[:, 2] > 0.5)
    expected = np.array([lambert_polygon(1.0, corners, positions[k], normals[k]) for k in up])
    assert np.allclose(found[up], expected, rtol=0.02)
    paths, _ = reference_irradiance(model.scene, positions[up], normals[up], 20_000, 1, model=model)
    assert np.allclose(paths[:, 0], expected, rtol=0.03)


def test_the_choice_stays_while_a_mobile_moves_a_little():
    """Ten steps of a tenth of the radius change it once; it is a function of the position alone."""
    moved = [CENTRE + [0.05 + 0.1 * RADIUS * k, 0.0, 0.0] for k in range(10)]
    places = [steady(at, RADIUS) for at in moved]
    assert len({p.tobytes() for p in places}) == 2
    assert np.abs(np.array(places) - moved).max() <= 0.5 * RADIUS + 1e-12
    model = room(downward(0.1, 0.1, 0.95, 0.3, 1, 6), downward(0.6, 0.6, 0.95, 0.3, 2, 6))
    gather, dark = MobileGather(model, 0), np.zeros((model.first_probe, 3))
    there, beside_it, here = (
        model.transforms({"box": Pose(p)}) for p in ((0.2, 0.2, 0.2), (0.201, 0.2, 0.2), (0.7, 0.8, 0.5))
    )
    gather.irradiance(here, dark, 8)
    assert np.array_equal(gather.irradiance(there, dark, 8), MobileGather(model, 0).irradiance(there, dark, 8))
    chosen = gather._aimed[1]
    gather.irradiance(beside_it, dark, 8)
    assert gather._aimed[1] is chosen, "not chosen again"


def test_few_rays_find_more_of_the_light(monkeypatch):
    """The brightest lamp faces away."""
    away = quad((0.5, 0.1, 0.9), (0.4, 0, 0), (0, 0.8, 0), (8, 8), 2)
    model = room(downward(0.1, 0.1, 0.95, 0.3, 1, 6), away)
    at, dark = model.transforms(model.start_poses()), np.zeros((model.first_probe, 3))
    truth = MobileGather(model, 99).irradiance(at, dark, 4096)

    def off() -> float:
        found = (MobileGather(model, seed).irradiance(at, dark, 8) for seed in range(8))
        return np.mean([np.abs(E - truth).mean() for E in found])

    better = off()
    monkeypatch.setattr(mobile, "aimed", lambda lights, centre, radius: lights)
    assert better < 0.6 * off() and not math.isnan(better)


def test_a_lamp_too_small_for_the_sum_of_shares_leaves_no_nan():
    """The lamp's share is below 1e-16 of the others: their cumulative sum does not hold its size."""
    model = room(downward(0.1, 0.1, 0.9, 0.4, 1), downward(0.6, 0.6, 0.8, 1e-9, 2))
    assert (model.lights.area.density > 0).all()
    dimmed = at_levels(model.lights, np.full((model.lights.lamps, 3), 0.5)).area
    assert np.isfinite(dimmed.density).all() and dimmed.cdf[-1] == 1.0
    assert np.allclose(np.diff(dimmed.cdf, prepend=0), areas(dimmed) * dimmed.density, rtol=1e-9)
    lit = dimmed.of_face[dimmed.of_face >= 0]
    assert sorted(lit) == list(range(len(dimmed.cdf)))
