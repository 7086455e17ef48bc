"""Skies of ISO 15469: published values, photons, paths and fixed points against integrals, and closed forms."""

import math

import numpy as np
import pytest

from app.rest.calculation_surface import surface_steps
from app.rest.surface_grid import level_of
from gi_core.files.load import load_scene
from gi_core.gather.reference import reference_irradiance
from gi_core.lights.emission import build_emitters, emit
from gi_core.lights.next_event import light_points
from gi_core.lights.sky import patches, relative_luminance, sky_of
from gi_core.model import Model
from gi_core.scene import CalculationSurface, Scene, SkyLight
from gi_core.scene.types import DAYLIGHT_FACTOR, OVERCAST_SKY, SUNLESS_SKIES
from tests.support.scene_builders import plane_scene
from tests.support.toml_rooms import room_file, table

UP = np.array([0.0, 0.0, 1.0])
TO_SUN = (0.4, 0.7, 0.5)
TYPES = range(1, OVERCAST_SKY + 1)
NORMALS = np.array([(0, 0, 1), (1, 0, 0), (-1, 0, 0), (0.5, 0.7, 0.5), (0, -0.6, 0.8)])


def scene(cie: int) -> Scene:
    return plane_scene(SkyLight("sky", (1.0, 2.0, 3.0), cie, None if cie in SUNLESS_SKIES else TO_SUN))


def integrals(cie: int) -> np.ndarray:
    """Return E on planes of NORMALS over that of open ground, by 700 x 1,400 directions of equal solid angle."""
    z, turn = (np.arange(700) + 0.5) / 700, 2 * math.pi * (np.arange(1400) + 0.5) / 1400
    r = np.sqrt(1 - z * z)
    d = np.stack(np.broadcast_arrays(r[:, None] * np.cos(turn), r[:, None] * np.sin(turn), z[:, None]), axis=2)
    sun = np.array(TO_SUN) / np.linalg.norm(TO_SUN)
    L = relative_luminance(cie, z[:, None], np.arccos(np.clip(d @ sun, -1, 1)))
    E = np.array([(L * np.maximum(d @ (n / np.linalg.norm(n)), 0)).mean() for n in NORMALS])
    return E / E[0]


@pytest.mark.parametrize("cie, expected", [(1, 0.8325846), (12, 0.4544524)])
def test_published_values(cie, expected):
    """Over the zenith: altitude 45 degrees, sun at 60 degrees on the other side; colour-science 0.4.7 has them."""
    seen, zenith = math.radians(75), math.radians(30)
    whole = relative_luminance(cie, np.array([math.sqrt(0.5), 1.0]), np.array([seen, zenith]))
    assert whole[0] / whole[1] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("cie", TYPES)
def test_photons_paths_and_fixed_points_bring_the_light_of_the_distribution(cie):
    given, truth = scene(cie), math.pi * integrals(cie)
    n = NORMALS / np.linalg.norm(NORMALS, axis=1)[:, None]
    model = Model(given)
    photons = emit(build_emitters(given, model.surfaces, np.zeros(3), 3.0), 5, 0, 40_000)
    flux = photons.flux[:, 0] * model.emitters.unit_flux / model.emitters.total_flux.sum()
    arriving = np.maximum(-(photons.direction @ n.T), 0)
    E, error = arriving.mean(axis=0), arriving.std(axis=0) / 200
    assert flux.std() < 1e-6 * flux.mean()
    whole = 2 * math.pi * patches(given.lights[0], UP).mean()
    assert np.abs(E * whole - truth).max() < 4.5 * error.max() * whole, "80 comparisons in all: below 1e-3 by chance"
    points = light_points(model.lights, np.ones(1), 3)
    fixed = (points.value[:, 0, None] * np.maximum(points.place @ n.T, 0)).sum(axis=0)
    assert fixed[0] == pytest.approx(math.pi, rel=0.02) and fixed == pytest.approx(truth, abs=0.15)
    assert points.value[:, 1] == pytest.approx(2 * points.value[:, 0])
    places = np.tile([0.0, 0.0, 5.0], (len(n), 1))
    light, noise = reference_irradiance(given, places, n, 4096, 2, model=model)
    assert (np.abs(light[:, 0] - truth) < 5 * noise[:, 0] + 2e-3).all()


@pytest.mark.parametrize("cie", TYPES)
def test_patches_bring_pi_to_open_ground(cie):
    shape = patches(scene(cie).lights[0], UP)
    z = (np.arange(len(shape)) + 0.5) / len(shape)
    assert 2 * (shape.mean(axis=1) * z).mean() == pytest.approx(1.0, rel=1e-12) and (shape >= 0).all()


def test_skies_add_up():
    lights = SkyLight("a", (1.0, 0.0, 2.0), 16), SkyLight("b", (3.0, 0.0, 0.0), 12, TO_SUN)
    both = sky_of(plane_scene(*lights))
    d = np.random.default_rng(1).normal(size=(200, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    assert both.seen(d) == pytest.approx(sum(sky_of(plane_scene(light)).seen(d) for light in lights))
    assert (both.seen(d)[d[:, 2] <= 0] == 0).all() and both.seen(d)[d[:, 2] > 0, 0].all()


def room(folder, opening: dict, *more: str) -> Scene:
    """A black room of 6 x 4 x 3 m with an opening."""
    sky = table("light", type="sky", name="uniform", radiance=(1, 1, 1))
    walls = {"openings": [opening], "max_edge": 1.0}
    return load_scene(room_file(folder, (6, 4, 3), sky, *more, reflectance=0, units="radiometric", room=walls))


def factor_at(scene: Scene, place, height: float, noise: float = 0.01):
    """Return the daylight factor at a point, and its standard error."""
    model = Model(scene)
    point = CalculationSurface("p", "", place, (1e-3, 1e-3), height, points=(1, 1), quantity=DAYLIGHT_FACTOR)
    levels = model.emitters.lamps.full()
    *_, light = surface_steps(model, point, level_of(model), model.start_poses(), levels, 1, noise)
    return light.values[0] / 100, light.errors[0] / 100


def of_window(b: float, h: float, d: float) -> float:
    """Sky component of the overcast sky at the foot of a corner of an unglazed window, b wide, h high, d away.

    T. Seshadri, Equations of sky components with a CIE standard overcast sky, 1960.
    """
    x, y = b / d, h / d
    s = math.sqrt(1 + y * y)
    even = 3 / (14 * math.pi) * (math.atan(x) - math.atan(x / s) / s)
    corner = math.asin(x * y / (math.sqrt(1 + x * x) * s))
    return even + 2 / (7 * math.pi) * (corner - x * y / ((1 + y * y) * math.sqrt(1 + x * x + y * y)))


def test_the_daylight_factor_through_a_vertical_window(tmp_path):
    """Whatever else shines. The window of 1.6 x 1.2 m has its sill at 0.9 m; 1.5 and 3 m away, 0.4 m to one side."""
    opening = {"wall": "right", "position": (-0.8, 0.9), "size": (1.6, 1.2)}
    lamp = table("light", type="point", position=(0, 0, 2), flux=(9, 9, 9))
    scene, lit = room(tmp_path, opening), room(tmp_path, opening, lamp)
    for d in (1.5, 3.0):
        corners = sum(of_window(b, 1.35, d) - of_window(b, 0.15, d) for b in (0.4, 1.2))
        for of in (scene, lit):
            value, error = factor_at(of, (3 - d, 0.4), 0.75)
            assert abs(value - corners) < 4 * error and error < 0.05 * value


def test_the_daylight_factor_through_a_horizontal_opening(tmp_path):
    """A square rooflight of 1.2 m, 2.25 m above the point, by an integral over it of L cos^2 / d^2."""
    scene = room(tmp_path, {"wall": "ceiling", "position": (-0.6, -0.6), "size": (1.2, 1.2)})
    x = ((np.arange(600) + 0.5) / 600 - 0.5) * 1.2
    d2 = x[:, None] ** 2 + x * x + 2.25**2
    sine = 2.25 / np.sqrt(d2)
    truth = ((1 + 2 * sine) / 3 * sine * sine / d2).mean() * 1.44 / (7 * math.pi / 9)
    value, error = factor_at(scene, (0.0, 0.0), 0.75)
    assert abs(value - truth) < 4 * error and error < 0.02 * value


def test_the_factor_of_open_ground_is_one():
    value, error = factor_at(plane_scene(SkyLight("sky", (3.0, 1.0, 2.0), 12, TO_SUN)), (0.1, 0.2), 0.5, 0.003)
    assert value == pytest.approx(1.0, abs=max(4 * error, 1e-3))
