"""Bright faces of luminaires, in pictures by ray casting and by OpenGL."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.draw import shot as shots
from app.draw.bare_lights import LightFaces, light_faces
from app.draw.shot import Shot, layers
from app.settings import ILLUMINANCE, LUMINANCE, Settings
from gi_core.lights.photometric import share_ahead
from gi_core.model import Model
from gi_core.scene import Camera
from gi_core.scene.types import PhotometricLight
from gi_core.solver import Solver
from tests.support import gl_drawing
from tests.support import viewer_support as support
from tests.support.gl_drawing import gl_picture
from tests.support.photometry import candela, luminaire
from tests.support.scene_builders import solve

SIZE = (120, 90)
EYE = Camera((0.5, 0.5, 0.95), (0.5, 0.5, 0.0), 60.0)


def panel(**changes) -> PhotometricLight:
    """A panel that faces the eye: constant luminance."""
    gammas, planes = np.linspace(0.0, 90.0, 91), np.array([0.0, 360.0])
    table = np.tile(np.cos(np.radians(gammas)), (2, 1))
    light = PhotometricLight(
        "panel", (0.5, 0.5, 0.3), (0, 0, 1), (1, 0, 0), (0.3, 0.2, 0.1), gammas, planes, table, (0.2, 0.1)
    )
    return light._replace(**changes)


def lit_by(*lights) -> Solver:
    room = support.room()
    return solve(replace(room, lights=lights, mobiles=(), camera=EYE), photons=3000, radius=0.06)


def test_share_ahead_is_that_of_the_intensity():
    rng = np.random.default_rng(3)
    d = rng.normal(size=(400_000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    light = luminaire(direction=(0, 0, -1.0), c0=(1.0, 0, 0))
    cd = candela(light, d)
    assert share_ahead(light) == pytest.approx(cd[d[:, 2] < 0].sum() / cd.sum(), abs=4e-3)
    assert share_ahead(panel()) == 1.0
    up = panel(gammas_degrees=np.array([90.0, 120.0, 180.0]), intensity=np.ones((2, 3)))
    assert share_ahead(up) == 0.0


def test_each_bright_side_has_its_mean_luminance():
    lamp, both = panel(), panel(name="both", gammas_degrees=np.linspace(0, 180, 91), intensity=np.ones((2, 91)))
    model = Model(replace(support.room(), lights=(lamp, both, panel(size=(0.0, 0.0)))))
    levels = model.emitters.lamps.changed(model.emitters.lamps.full(), {"both": (1.0, 0.5, 0.0)}, "")
    faces = light_faces(model, levels)
    assert faces.corners.shape == (3, 4, 3), "one of the panel, two of the other, none of a point"
    area, flux = 0.2 * 0.1, np.array(lamp.flux)
    assert faces.radiance[0] == pytest.approx(flux / (math.pi * area))
    assert faces.radiance[1] == pytest.approx(0.5 * flux * [1.0, 0.5, 0.0] / (math.pi * area), rel=1e-3)
    a, b, c, _ = np.moveaxis(faces.corners, 1, 0)
    assert np.cross(b - a, c - b) == pytest.approx(area * np.array([[0, 0, 1], [0, 0, 1], [0, 0, -1]]))
    dark = model.emitters.lamps.changed(levels, {"both": 0.0, "panel": 0.0}, "")
    assert not light_faces(model, dark).radiance.any()


def bare(picture, shot: Shot) -> np.ndarray:
    """Return a picture of the same light without bright faces."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (shots, gl_drawing):
            patch.setattr(module, "light_faces", lambda *_: LightFaces(np.zeros((0, 4, 3)), np.zeros((0, 3))))
        return picture(shot)


@pytest.mark.gl
@pytest.mark.parametrize("show", ["radiance", LUMINANCE])
def test_pictures_show_the_face_where_nothing_hides_it(ctx, show):
    settings = Settings(size=SIZE, tone_map="clip", exposure=-3.0, white_balance=False, show=show)
    shot, found = Shot(lit_by(panel()), settings), []
    pictures = Shot.take, lambda shot: gl_picture(shot, ctx)
    for picture in pictures:
        a, b = picture(shot).astype(int), bare(picture, shot).astype(int)
        changed = (a != b).any(axis=2)
        width, height = (np.ptp(np.flatnonzero(changed.any(axis=k))) + 1 for k in (0, 1))
        per_metre = SIZE[1] / (2 * 0.65 * math.tan(math.radians(30)))
        assert (width, height) == pytest.approx((0.2 * per_metre, 0.1 * per_metre), abs=1.5)
        assert changed.sum() > 0.9 * width * height
        found.append(a[42:48, 52:68])
    assert np.abs(found[0] - found[1]).max() <= 1
    for light in (panel(direction=(0, 0, -1.0)), panel(position=(0.5, 0.5, -0.1))):  # seen from behind; behind a wall
        shot = Shot(lit_by(light), settings)
        assert all(np.array_equal(picture(shot), bare(picture, shot)) for picture in pictures)


@pytest.mark.gl
def test_illuminance_leaves_the_face_out(ctx):
    shot = Shot(lit_by(panel()), Settings(size=SIZE, show=ILLUMINANCE, exposure=0.0))
    for picture in (Shot.take, lambda shot: gl_picture(shot, ctx)):
        assert np.array_equal(picture(shot), bare(picture, shot))


def test_layers_have_its_radiance_and_no_irradiance_there():
    found = layers(Shot(lit_by(panel()), Settings(size=SIZE)))
    middle = tuple(n // 2 for n in reversed(SIZE))
    assert found.colour[middle] == pytest.approx(np.array(panel().flux) / (math.pi * 0.02), rel=1e-5)
    assert not found.irradiance[middle].any() and not found.albedo[middle].any() and found.coverage[middle] == 1
    assert found.irradiance[10, 10].all()
