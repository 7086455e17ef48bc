"""Panes in pictures by ray casting and by OpenGL."""

from dataclasses import replace

import numpy as np
import pytest

from app.draw.shot import Shot, layers
from app.draw.tonemap import BACKGROUND, to_display
from app.settings import ILLUMINANCE, Settings
from gi_core.scene.types import Camera, Material, Mobile, Pane, PointLight, Pose, Scene, SkyLight
from tests.support.gl_drawing import gl_picture
from tests.support.scene_builders import box, grey, merge, quad, solve

SIZE = (120, 90)


def scene(panes: bool) -> Scene:
    """A grey room with a tinted pane before a wall, and a box of glass that moves."""
    glass = Material("glass").as_pane(Pane()), Material("tinted").as_pane(Pane((0.9, 0.5, 0.1)))
    room = box((0, 0, 0), (1, 1, 1), 4, 0, inward=True)
    static = merge(room, quad((0.1, 0.8, 0.1), (0.5, 0, 0), (0, 0, 0.6), (2, 2), 2)) if panes else room
    mobiles = (Mobile("case", box((-0.1, -0.1, 0), (0.1, 0.1, 0.2), 1, 1), Pose((0.7, 0.5, 0.0))),) if panes else ()
    lights = (PointLight("bulb", (0.5, 0.4, 0.9), (4.0, 4.0, 4.0)),)
    eye = Camera((0.5, 0.05, 0.5), (0.5, 1.0, 0.4), 70.0)
    return Scene(static, (grey(0.5), *glass), mobiles, lights, camera=eye, up=(0, 0, 1), name="glazed")


def shot_of(scene: Scene, **settings) -> Shot:
    solver = solve(scene, photons=20_000, radius=0.1)
    return Shot(solver, Settings(size=SIZE, exposure=0.0, **settings))


@pytest.mark.parametrize("tone_map", ["agx", "clip"])
def test_both_pictures_show_the_same_panes(tone_map):
    shot = shot_of(scene(True), tone_map=tone_map)
    traced, drawn = shot.take().astype(int), gl_picture(shot).astype(int)
    apart = np.abs(traced - drawn).max(axis=2)
    assert np.percentile(apart, 97) <= 3, "edges differ, see raycast.py"
    plain = gl_picture(shot_of(scene(False), tone_map=tone_map)).astype(int)
    assert (np.abs(drawn - plain).max(axis=2) > 20).mean() > 0.1, "the tinted pane shows"


@pytest.mark.parametrize("show", ["radiance", ILLUMINANCE])
def test_both_pictures_show_the_sky_above_the_horizon_and_through_panes(show):
    """A pane in front of the right half of an open view, over a floor that is nearer than the horizon."""
    glass, sky = Material("tinted").as_pane(Pane((0.9, 0.5, 0.1))), SkyLight("sky", (1.0, 2.0, 4.0))
    static = merge(quad((-1, 1, -1), (2, 0, 0), (0, 1, 0), (2, 2)), quad((0, 2, -1), (3, 0, 0), (0, 0, 4), (2, 2), 1))
    eye = Camera((0.0, -1.0, 0.0), (0.0, 2.0, 0.0), 60.0)
    open_view = Scene(static, (grey(0.5), glass), (), (sky,), camera=eye, up=(0, 0, 1))
    shot = shot_of(open_view, tone_map="clip", white_balance=False, show=show)
    traced, drawn = shot.take().astype(int), gl_picture(shot).astype(int)
    assert np.abs(traced - drawn).max(axis=2)[:40].max() <= 2
    left, right, below = traced[20, 30], traced[20, 90], traced[47, 10]
    assert (below == np.round(255 * np.array(BACKGROUND))).all()
    if show == ILLUMINANCE:
        assert (left == below).all()
    else:
        assert (left == to_display(np.array(sky.radiance), 0.0, "clip")).all() and right[0] < left[0]


def test_both_pictures_show_the_same_clear_sky():
    sky = SkyLight("sky", (0.1, 0.2, 0.3), 12, (0.4, 0.8, 0.3))
    floor, eye = quad((-1, 1, -1), (2, 0, 0), (0, 1, 0), (2, 2)), Camera((0.0, -1.0, 0.0), (0.0, 2.0, 0.6), 80.0)
    open_view = Scene(floor, (grey(0.5),), (), (sky,), camera=eye, up=(0, 0, 1))
    shot = shot_of(open_view, tone_map="clip", white_balance=False)
    traced, drawn = shot.take().astype(int), gl_picture(shot).astype(int)
    apart = np.abs(traced - drawn).max(axis=2)[:40]
    assert apart.max() <= 12 and np.percentile(apart, 95) <= 2, "rounding at the edges of patches"
    assert np.ptp(traced[:40, :, 1]) > 60


def test_light_behind_a_pane_is_multiplied_in_the_layers():
    shot, bare = shot_of(scene(True)), shot_of(scene(True))
    through = layers(shot).colour
    for mesh in ("_meshes", "_pictured"):
        clear = (
            m._replace(pane=None if m.pane is None else m.pane * (0, 0, 0, 1) + (1, 1, 1, 0)) for m in bare._meshes
        )
        setattr(bare, mesh, tuple(clear))
    row, column = 45, 40  # in the tinted pane
    ratio = through[row, column] / layers(bare).colour[row, column]
    assert ratio[0] > ratio[1] > ratio[2]
    assert 0.75 < ratio[0] < 0.95 and 0.05 < ratio[2] < 0.35


def test_false_colours_look_through_panes():
    traced, drawn = ((f(shot_of(scene(True), show=ILLUMINANCE))) for f in (lambda s: layers(s).irradiance, layers))
    assert np.isfinite(traced).all() and drawn.coverage.min() > 0.99
    behind = layers(shot_of(replace(scene(True), mobiles=()))).irradiance[45, 40]
    assert traced[45, 40] == pytest.approx(behind, rel=0.3)
