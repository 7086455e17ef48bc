"""Delta lights and the sky in sharp gloss: closed forms, lights that shrink, OpenGL against traced rays."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.draw.shot import Shot, layers
from app.draw.tonemap import srgb_decode
from app.settings import Settings, make_solver
from gi_core.geometry.error import luminance
from gi_core.gloss.lobe_rays import unoccluded, without_surface
from gi_core.scene.types import (
    Camera,
    DirectionalLight,
    Gloss,
    Material,
    Mobile,
    PhotometricLight,
    PointLight,
    Pose,
    Scene,
    SkyLight,
    SpotLight,
)
from tests.support.gl_drawing import gl_picture
from tests.support.scene_builders import merge, quad, sphere
from tests.window.test_reflections import kind_of

SETTINGS = Settings(size=(180, 120), photons=2000, radius=0.2, exposure=0.0, tone_map="clip", light="photons")
METAL = Gloss((0.9, 0.6, 0.3), 0.1, 0.9)
CAMERA = Camera((0, -1.2, 1.0), (0, 0, 0), 50.0)
LARGE = 40.0  # radiance of a highlight
NIGHT = SkyLight("night", (1e-9, 1e-9, 1e-9))  # in place of the picture's background


def shot_of(scene: Scene, **changes) -> Shot:
    settings = replace(SETTINGS, **changes)
    shot = Shot(make_solver(scene, settings), settings)
    shot.solver.solve()
    return shot


def radiance(picture: np.ndarray) -> np.ndarray:
    return srgb_decode(picture / 255)


def scene(*lights, more=(), mobiles=(), gloss: Gloss = METAL) -> Scene:
    """A plate of metal and lights above it."""
    plate = quad((-0.6, -0.6, 0), (1.2, 0, 0), (0, 1.2, 0), (12, 12), 0)
    materials = Material("metal", (0, 0, 0), gloss=gloss), Material("lamp", emission=(500.0, 500.0, 500.0))
    materials += (Material("black", (0, 0, 0)),)
    return Scene(merge(plate, *more), materials, mobiles, (*lights, NIGHT), camera=CAMERA, up=(0, 0, 1), name="plate")


def test_a_lamp_that_shrinks_becomes_a_point_light():
    """A small square that faces the plate's middle, against a point light of its intensity there."""
    at, half = np.array([0.0, 0.6, 0.5]), 0.02
    u, towards = np.array([1.0, 0, 0]), -at / np.linalg.norm(at)
    v = np.cross(towards, u)
    square = quad(at - half * (u + v), 2 * half * u, 2 * half * v, (1, 1), 1)
    bulb = PointLight("bulb", tuple(at), (4 * math.pi * 500.0 * (2 * half) ** 2,) * 3)
    shots = [shot_of(each, size=(540, 360)) for each in (scene(more=(square,)), scene(bulb))]
    a, b = (layers(shot).colour[kind_of(shots[1]) == 0] for shot in shots)
    np.testing.assert_allclose(b.sum(axis=0), a.sum(axis=0), rtol=0.05)
    assert luminance(b).max() > 20 * luminance(b).mean()


def test_a_mirror_shows_no_light_without_a_surface():
    shot = shot_of(scene(PointLight("bulb", (0.0, 0.6, 0.5), (10.0,) * 3), gloss=Gloss((1, 1, 1), 0.0, 1.0)))
    assert radiance(shot.take())[kind_of(shot) == 0].max() == 0


LIGHTS = {
    "point": PointLight("bulb", (0.1, 0.6, 0.5), (40.0, 40.0, 40.0)),
    "spot": SpotLight("spot", (0.1, 0.6, 0.5), (-0.1, -0.6, -0.5), (4.0, 4.0, 4.0), 10.0, 30.0),
    "sun": DirectionalLight("sun", (0.0, -0.7, -0.7), (3.0, 3.0, 3.0)),
}


@pytest.mark.gl
@pytest.mark.parametrize("name", LIGHTS)
def test_opengl_shows_the_highlights_of_traced_rays(name):
    """On a plate and a ball in front of it, whose shadow lies on the plate: vertices carry what arrives.

    The bias is 2.0 % for the spot and 0.7 % for the others, with 512 rays as with 32.
    """
    ball = Mobile("ball", sphere((0, 0, 0), 0.12, 3, 0), Pose((0.25, 0.1, 0.3)))
    shot = shot_of(scene(LIGHTS[name], mobiles=(ball,)), exposure=-math.log2(LARGE))
    metal, (traced, drawn) = kind_of(shot) == 0, (radiance(p) for p in (shot.take(), gl_picture(shot)))
    lit = traced[metal].sum()
    assert lit > 20 and np.abs(traced - drawn)[metal].sum() < 0.1 * lit
    assert abs((traced - drawn)[metal].sum()) < 0.025 * lit


@pytest.mark.gl
def test_a_shadow_takes_the_highlight_away():
    """A board between lamp and plate, beside the eye's view: nothing is left, traced or drawn."""
    board = quad((-0.5, 0.1, 0.38), (1.0, 0, 0), (0, 0.5, -0.33), (1, 1), 2)
    shots = [shot_of(scene(LIGHTS["point"], more=more), exposure=-math.log2(LARGE)) for more in ((), (board,))]
    for picture in (Shot.take, gl_picture):
        free, hidden = (radiance(picture(s))[kind_of(s) == 0].sum() for s in shots)
        assert free > 20 and hidden < 0.02 * free


def test_luminaires_with_a_size_shine_as_points():
    """The halves of a rectangle bring what its flux at one point brings, from a distance; tables are joined."""
    gammas, planes = np.array([0.0, 30.0, 60.0, 90.0]), np.array([0.0, 120.0, 360.0])
    table = np.array([[8.0, 6.0, 2.0, 0.0], [5.0, 4.0, 3.0, 0.0], [8.0, 6.0, 2.0, 0.0]])
    given = (0.0, 0.0, 1.0), (0.0, 0.2, -1.0), (1.0, 0.0, 0.0)
    large = PhotometricLight("large", *given, (20.0, 10.0, 5.0), gammas, planes, table, (0.06, 0.03))
    small = PhotometricLight("small", *given, (20.0, 10.0, 5.0), gammas, planes, table)
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 3)) * (1, 1, 0.1)
    found = []
    for lights in ((large,), (small,), (LIGHTS["sun"], small, large)):
        solver = make_solver(replace(scene(), lights=lights), SETTINGS)
        some = without_surface(solver.model.lights_at(solver.levels))
        found.append(unoccluded(points, some, 2.0).strength @ some.value)
    np.testing.assert_allclose(found[0], found[1], rtol=0.05)
    np.testing.assert_allclose(found[2] - LIGHTS["sun"].irradiance, found[0] + found[1], rtol=3e-5)


@pytest.mark.gl
@pytest.mark.parametrize("alpha", [0.0, 0.1])
def test_sharp_gloss_reflects_the_sky(alpha):
    """A ball under a dome: the upper half of what it shows is the albedo times the sky, traced and by OpenGL."""
    gloss = Gloss((0.8, 0.5, 0.2), alpha, 0.8)
    black = quad((-4, -4, -1), (8, 0, 0), (0, 8, 0), (2, 2), 2)
    ball = Mobile("ball", sphere((0, 0, 0), 0.3, 3, 0), Pose((0.0, 0.0, 0.0)))
    given = replace(scene(gloss=gloss), lights=(SkyLight("sky", (0.5, 0.5, 0.5)),))
    from_above = Camera((0, -0.4, 1.2), (0, 0, 0.0), 40.0)
    shot = shot_of(replace(given, static=black, mobiles=(ball,), camera=from_above))
    (reflector,) = shot.lit.meshes[1].reflectors
    expected = 0.5 * reflector.lobe.albedo[-1]
    for picture in (shot.take(), gl_picture(shot)):
        seen = radiance(picture)[56:64, 86:94].mean(axis=(0, 1))
        np.testing.assert_allclose(seen, expected, rtol=0.03, atol=0.003)
