"""Exposure, tone maps, sRGB and the meter: numbers on which shader and picture must agree.

White balance: lamps of one colour become neutral, in the picture and in the shader alike.
"""

from dataclasses import replace

import numpy as np
import pytest

from app.draw.camera import from_camera, scene_bounds
from app.draw.draw_mesh import draw_meshes
from app.draw.lit_scene import LitScene, metered
from app.draw.tonemap import NEUTRAL, TONE_MAPS, gains_for, meter, srgb_encode, to_display, view_weights
from app.settings import TONE_MAPS as NAMES
from gi_core.display.dilation import Drawn
from gi_core.geometry.error import luminance
from gi_core.model import Model
from tests.support.viewer_support import room

GREYS = np.linspace(0, 50, 2001)[:, None] * np.ones(3)


def test_settings_list_all_tone_maps():
    assert set(NAMES) == set(TONE_MAPS)


def test_srgb_reference_values():
    """IEC 61966-2-1: linear 0.18 -> 0.4614, 0.5 -> 0.7354, and the linear toe 12.92 c."""
    np.testing.assert_allclose(
        srgb_encode(np.array([0.0, 0.002, 0.18, 0.5, 1.0])), [0, 0.02584, 0.4614, 0.7354, 1], atol=5e-5
    )


def test_known_values_of_each_curve():
    """Narkowicz: f(1) = 2.54 / 3.16 = 0.8038; Reinhard: 1 / 2; clip: 1."""
    white = np.ones((1, 3))
    assert TONE_MAPS["aces"](white / 0.6)[0, 0] == pytest.approx(2.54 / 3.16)
    assert TONE_MAPS["reinhard"](white)[0, 0] == pytest.approx(0.5)
    assert TONE_MAPS["clip"](white)[0, 0] == 1.0


def test_published_values_of_agx_and_neutral():
    """AgX: a grey of 0.18 becomes 0.2145, the grey at sRGB 56 stays within 8 of it. Neutral: colours below 0.76 less
    0.04 are kept, white at 1 becomes 1 - 0.24^2 / 0.44."""
    grey = TONE_MAPS["agx"](np.full((1, 3), 0.18))
    assert np.ptp(grey) < 1e-3 and grey[0, 0] == pytest.approx(0.2145, abs=1e-3)
    dark = np.full((1, 3), 0.0395)
    assert to_display(dark, 0.0, "clip")[0, 0] == 56 and 48 <= to_display(dark, 0.0, "agx")[0, 0] <= 64
    np.testing.assert_allclose(TONE_MAPS["neutral"](np.array([[0.5, 0.3, 0.2]])), [[0.46, 0.26, 0.16]])
    np.testing.assert_allclose(TONE_MAPS["neutral"](np.ones((1, 3))), 1 - 0.24**2 / 0.44, rtol=1e-6)


@pytest.mark.parametrize("name", TONE_MAPS)
def test_every_curve_rises_from_black_and_stays_in_range(name):
    mapped = TONE_MAPS[name](GREYS)
    assert mapped[0].max() == 0.0
    assert (np.diff(mapped[:, 0]) >= 0).all() and mapped.min() >= 0 and mapped.max() <= 1


def test_reinhard_keeps_hue_while_nothing_clips():
    colour = np.array([[0.5, 0.2, 0.1]])
    mapped = TONE_MAPS["reinhard"](colour)
    np.testing.assert_allclose(mapped / mapped[0, 0], colour / colour[0, 0])


@pytest.mark.parametrize("name", TONE_MAPS)
def test_one_stop_doubles_the_light(name):
    colour = np.array([[0.1, 0.2, 0.05]])
    assert (to_display(colour, 1.0, name) == to_display(2 * colour, 0.0, name)).all()


def test_negative_and_huge_light_give_bytes():
    assert to_display(np.array([[-1.0, 0.0, 1e6]]), 10.0, "clip").tolist() == [[0, 0, 255]]


def test_meter_puts_the_median_at_mid_grey_and_lets_the_lamp_burn_out():
    """A room at luminance 3 with a lamp of luminance 1000 on one hundredth of the area."""
    radiance = np.concatenate([np.full((99, 3), 3.0), np.full((1, 3), 1000.0)])
    assert 3.0 * 2 ** meter(radiance) == pytest.approx(0.18)


def test_meter_ignores_unlit_vertices():
    radiance = np.concatenate([np.full((10, 3), 2.0), np.zeros((500, 3))])
    assert 2.0 * 2 ** meter(radiance) == pytest.approx(0.18)


def test_meter_keeps_a_spot_lit_stage_from_burning_out():
    """One fifth of the area is 100 times brighter than the rest: the median alone would saturate it."""
    radiance = np.concatenate([np.full((80, 3), 0.01), np.full((20, 3), 1.0)])
    assert 1.0 * 2 ** meter(radiance) <= 2.0 + 1e-9


def test_meter_weights_and_empty_scenes():
    radiance = np.array([[1.0] * 3, [4.0] * 3])
    assert 4.0 * 2 ** meter(radiance, np.array([1.0, 9.0])) == pytest.approx(0.18)
    assert meter(np.zeros((0, 3))) == 0.0
    assert meter(np.zeros((5, 3))) == 0.0
    assert meter(radiance, np.zeros(2)) == 0.0


@pytest.mark.parametrize("glow", [0.01, 100.0])
def test_lamps_in_view_are_not_metered(glow):
    """A wall that shines, by a hundredth of its reflected light or a hundred times as much."""
    scene, exposures = room(4), []
    for emission in (0.0, glow):
        red = scene.materials[1]._replace(emission=(emission,) * 3)
        model = Model(replace(scene, materials=(scene.materials[0], red, *scene.materials[2:])))
        meshes, E = draw_meshes(model.surfaces), np.ones((len(model.object_receivers.areas), 3))
        camera = from_camera(scene.camera, scene.up, scene_bounds(model, model.start_poses()))
        lit = LitScene(model, model.start_poses(), model.emitters.lamps.full(), meshes, Drawn(E, None))
        exposures.append(metered(lit, camera, 1.0))
    assert exposures[1] == pytest.approx(exposures[0], abs=0.1)


def test_view_weights_count_visible_front_faces():
    positions = np.array([[0, 0, -5.0], [0, 0, -5.0], [0, 0, 5.0], [50, 0, -5.0]])
    normals = np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, -1.0], [0, 0, 1.0]])
    weights = view_weights(positions, normals, np.ones(4), (0, 0, 0), (0, 0, -1), 45.0)
    assert weights[0] == pytest.approx(1 / 25) and weights[1:].tolist() == [0, 0, 0]


def test_a_warm_lamp_becomes_neutral_and_keeps_its_luminance():
    flux = np.array([20.0, 13.0, 5.0])
    gains = np.array(gains_for(flux))
    balanced = gains * flux
    assert balanced == pytest.approx([balanced[0]] * 3)
    assert luminance(balanced) == pytest.approx(luminance(flux))
    grey = to_display(0.02 * flux[None], 0.0, "clip", tuple(gains.tolist()))[0]
    assert len(set(grey.tolist())) == 1 and 0 < grey[0] < 255


def test_neutral_light_and_darkness_have_no_gains():
    assert gains_for(np.full(3, 7.0)) == pytest.approx(NEUTRAL)
    assert gains_for(np.zeros(3)) == NEUTRAL


def test_light_of_one_colour_keeps_it():
    gains = np.array(gains_for(np.array([1.0, 0.0, 0.0])))
    assert np.isfinite(gains).all() and gains.max() / gains.min() <= 4.0 / 0.2126 + 1e-9
    assert np.argmax(gains * [1.0, 0.0, 0.0]) == 0
