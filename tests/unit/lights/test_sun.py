"""The sun is a disc: photons, paths and fixed points against the penumbra of a half plane."""

import math

import numpy as np
import pytest

from gi_core.gather.reference import reference_irradiance
from gi_core.lights.emission import build_emitters, emit
from gi_core.lights.next_event import DELTA, light_points
from gi_core.model import Model
from gi_core.scene import DirectionalLight, Scene
from gi_core.scene.types import SUN_DEGREES
from tests.support.scene_builders import BLACK, floor, merge, plane_scene, quad
from tests.support.significance import z_test

UP = (0.0, 0.0, 1.0)
HEIGHT = 2.0  # m of the half plane over the floor


def half_plane(degrees: float = SUN_DEGREES, tilt=(0.0, 0.0, -1.0)) -> Scene:
    """Return a floor under a plate that covers x > 0, HEIGHT above it, and a sun of irradiance 10."""
    plate = quad((0, -6, HEIGHT), (0, 12, 0), (6, 0, 0), (1, 1), 0)
    sun = DirectionalLight("sun", tilt, (10.0, 10.0, 10.0), degrees)
    return Scene(merge(floor(2.0, 20), plate), (BLACK._replace(two_sided=True),), (), (sun,), up=UP, name="penumbra")


def visible(x: np.ndarray) -> np.ndarray:
    """Return the share of the disc (n,) that places x [m] before the rim's shadow see: its area beside a chord."""
    chord = np.clip(x / (HEIGHT * math.tan(math.radians(SUN_DEGREES / 2))), -1, 1)
    return (np.arccos(chord) - chord * np.sqrt(1 - chord**2)) / math.pi


def across(n: int) -> np.ndarray:
    """Return n places on the floor across the penumbra, 9.25 mm wide per metre of height."""
    x = (np.arange(n) + 0.5) / n * 1.2 - 0.6
    return np.stack([0.00925 * HEIGHT * x, np.linspace(-0.3, 0.3, n), np.zeros(n)], axis=1)


def test_paths_see_a_penumbra_of_the_disc():
    places = across(24)
    E, error = reference_irradiance(half_plane(), places, np.tile(UP, (24, 1)), 4000, 1)
    share = visible(places[:, 0])
    assert (share > 0).sum() == 22 and (E[share == 0] == 0).all()
    z_test(E[:, 0], 10 * share, np.maximum(error[:, 0], 1e-4), "penumbra")


def test_photons_fall_into_the_penumbra():
    """Photons on strips of 1.5 mm, which a sharp shadow would leave full or empty."""
    model = Model(half_plane())
    photons = emit(build_emitters(model.scene, model.surfaces, np.zeros(3), 3.0), 3, 0, 1_000_000)
    rim = photons.origin + photons.direction * ((HEIGHT - photons.origin[:, 2]) / photons.direction[:, 2])[:, None]
    ground = photons.origin - photons.direction * (photons.origin[:, 2] / photons.direction[:, 2])[:, None]
    near = np.abs(ground[:, 1]) < 2.0
    strips = np.linspace(-0.012, 0.012, 17)
    fall, pass_by = (np.histogram(ground[rows, 0], strips)[0] for rows in (near, near & (rim[:, 0] < 0)))
    inner = visible(np.linspace(strips[:-1], strips[1:], 101)).mean(axis=0)
    assert fall.min() > 100
    z_test(pass_by / fall, inner, np.sqrt(np.maximum(inner * (1 - inner), 1e-9) / fall), "share of photons that pass")


@pytest.mark.parametrize("degrees", [0.0, SUN_DEGREES, 20.0, 90.0])
@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.4, 0.2, -1.0)])
def test_irradiance_stays_whatever_the_disc(degrees, direction):
    """That of a plane that faces it is stated; of others, while all of the disc is above them, it is the cosine's."""
    scene = plane_scene(DirectionalLight("sun", direction, (3.0, 2.0, 1.0), degrees))
    model = Model(scene)
    d = np.array(direction) / np.linalg.norm(direction)
    expected = 3.0 * -d[2]
    photons = emit(model.emitters, 1, 0, 100_000)
    sun = scene.lights[0]
    half = math.radians(degrees / 2)
    cosines = photons.direction.astype(float) @ d
    assert cosines.min() >= math.cos(half) - 1e-6
    spread = (1 - cosines).mean()
    assert spread == pytest.approx((1 - math.cos(half)) / 2, rel=0.01, abs=1e-7), "even over the disc"
    flux = photons.flux[:, 0].mean() * model.emitters.unit_flux
    area = math.pi * model.emitters.parameters[0, 6] ** 2
    assert flux / area * (photons.direction @ -np.array(UP)).mean() == pytest.approx(expected, rel=0.005)
    E, error = reference_irradiance(scene, np.zeros((1, 3)), np.array([UP]), 4000, 1)
    z_test(E[0, 0], expected, max(error[0, 0], 1e-6), "paths")
    points = light_points(model.lights, np.ones(1), 3)
    assert len(points.kind) == (1 if degrees == 0 else 64) and (points.kind == DELTA).all()
    fixed = (points.value[:, 0] * points.place[:, 2]).sum()
    assert fixed == pytest.approx(expected, rel=1e-6 if degrees < 1 else 0.01)
    assert sun.disc_degrees == degrees
