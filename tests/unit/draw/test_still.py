"""Light per pixel of `render --still` and `--truth`: closed forms, whole paths, and its own noise."""

from dataclasses import replace

import numpy as np
import pytest

from app.draw.shot import Shot, layers
from app.draw.tonemap import to_display
from app.draw.visible import pixel_rays
from app.settings import Settings, make_solver
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance
from gi_core.scene.types import Camera, DirectionalLight, Gloss, Material, Pane, PointLight
from gi_core.solver import Solver
from tests.support.closed_form import parallel_rectangle
from tests.support.scene_builders import box, complete, floor, grey, lamp_over_floor, merge, plane_scene, quad
from tests.support.significance import z_test
from tests.support.viewer_support import room

SETTINGS = Settings(photons=20_000, radius=0.08, size=(64, 48), exposure=0.0)
ABOVE = Camera((0.0, -0.5, 1.6), (0.0, 0.0, 0.0), 50.0)


def shot_of(solver: Solver, paths: int | None, settings: Settings = SETTINGS):
    """The layers of a picture; paths: of Shot."""
    shot = Shot(solver, settings, paths)
    shot.refine()
    return layers(shot)


def solved(scene, settings: Settings = SETTINGS, threads: int | None = None) -> Solver:
    return complete(make_solver(scene, settings, threads=threads))


def known(scene, paths: int = 2048) -> Solver:
    """A solver of a scene without mobiles whose light at vertices is that of whole paths."""
    solver = solved(scene)
    points, normals = solver.model.evaluation_points
    E, _ = reference_irradiance(scene, points, normals, paths, 3, model=solver.model)
    solver.frame = solver.frame._replace(irradiance=E)
    return solver


def places_on_floor(solver: Solver, settings: Settings = SETTINGS) -> np.ndarray:
    """Where the rays of each pixel meet the plane z = 0, (h, w, 4, 3)."""
    view = Shot(solver, settings).view
    o, d = (a.astype(float) for a in pixel_rays(view, 0, view.height))
    return (o - d * (o[:, 2:] / d[:, 2:])).reshape(view.height, view.width, 4, 3)


def block_on_floor():
    """A grey block on a coarse grey floor under a point light, in front of a wall."""
    wall = quad((-1.5, 1.0, 0), (3, 0, 0), (0, 0, 1.5), (6, 3))
    block = box((-0.3, -0.2, 0.0), (0.3, 0.2, 0.5), 2)
    light = PointLight("bulb", (0.8, -1.2, 1.6), (9.0, 9.0, 9.0))
    scene = plane_scene(light, reflectance=0.7, size=3.0, divisions=8)
    static, camera = merge(floor(3.0, 8), wall, block), Camera((0.9, -1.5, 0.9), (0.1, -0.2, 0.1), 45.0)
    return replace(scene, static=static, camera=camera, materials=(grey(0.7),))


@pytest.mark.parametrize("paths", [0, 32])
def test_the_bits_of_a_picture_do_not_depend_on_threads(paths):
    one, two = (shot_of(solved(room(), threads=n), paths) for n in (1, 2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)
    assert one.variance.any()


def test_a_square_lamp_lights_the_pixels_of_a_floor_as_its_closed_form_says():
    solver = known(replace(lamp_over_floor(10.0, 0.6, 1.0), camera=ABOVE))
    x, y, _ = np.moveaxis(places_on_floor(solver), -1, 0)
    expected = parallel_rectangle(10.0, -0.3, 0.3, -0.3, 0.3, 1.0, x, y).mean(axis=2)
    on = ((np.abs(x) < 0.9) & (np.abs(y) < 0.9)).all(axis=2)
    off = shot_of(solver, 0).irradiance[..., 0][on] / expected[on] - 1  # the lamp's back is culled
    assert np.abs(off).max() < 0.03 and abs(off.mean()) < 0.003


def test_a_lamp_near_by_leaves_the_light_of_another():
    """Places near to a lamp have 16 sets of points on it, and one of those on others, such as a bulb."""
    scene, height = lamp_over_floor(1.0, 0.6, 0.15), 0.14
    bulb = PointLight("bulb", (1.5, 0.0, height), (800.0,) * 3)
    solver = known(replace(scene, lights=(bulb,), camera=ABOVE._replace(position=(0.0, -0.8, 0.1))), 64)
    x, y, _ = np.moveaxis(places_on_floor(solver), -1, 0)
    away = np.sqrt((x - 1.5) ** 2 + y**2 + height**2)
    expected = parallel_rectangle(1.0, -0.3, 0.3, -0.3, 0.3, 0.15, x, y) + 800 / (4 * np.pi) * height / away**3
    under = ((np.abs(x) < 0.2) & (np.abs(y) < 0.2)).all(axis=2)
    off = shot_of(solver, 0).irradiance[..., 0][under] / expected.mean(axis=2)[under] - 1
    assert under.sum() > 50 and np.abs(off).max() < 0.05 and abs(off.mean()) < 0.01


def test_the_error_bar_of_whole_paths_covers_their_error():
    """Pixels are independent, so z has the variance 1: 64 sets, so Student's t is nearly normal."""
    scene = replace(lamp_over_floor(10.0, 0.6, 1.0), camera=ABOVE)
    scene = replace(scene, materials=(grey(0.999), scene.materials[1]))  # the picture shows radiance rho E / pi
    solver = solved(scene)
    x, y, _ = np.moveaxis(places_on_floor(solver), -1, 0)
    on = ((np.abs(x) < 0.9) & (np.abs(y) < 0.9)).all(axis=2)
    expected = parallel_rectangle(10.0, -0.3, 0.3, -0.3, 0.3, 1.0, x, y).mean(axis=2)[on] * 0.999 / np.pi
    got = shot_of(solver, 512)
    z = (got.colour[on][:, 0] - expected) / np.sqrt(got.variance[on][:, 0])
    n = on.sum()
    z_test((z**2).mean(), 1.0, 2 * np.sqrt(2 / n))
    assert n > 500


def test_a_half_plane_before_the_sun_has_a_sharp_border_at_pixels():
    """Vertices are 0.25 m apart; the border is within a pixel of its place."""
    roof = quad((0.0, -2.0, 0.5), (0, 4, 0), (2, 0, 0), (1, 1))
    scene = plane_scene(DirectionalLight("sun", (0.0, 0.0, -1.0), (5.0, 5.0, 5.0), 0.0))
    scene = replace(scene, static=merge(floor(2.0, 8), roof), camera=Camera((-1.0, 0.0, 1.2), (0.0, 0.0, 0.0), 40.0))
    scene = replace(scene, materials=(grey(0.0, two_sided=True),))
    solver = known(scene, 64)
    x = places_on_floor(solver)[..., 0]
    picture = shot_of(solver, 0).irradiance[..., 0]
    lit, dark = (x < 0).all(axis=2), ((x > 0) & (x < 0.5)).all(axis=2)
    assert lit.sum() > 300 and dark.sum() > 300
    np.testing.assert_allclose(picture[lit], 5.0, rtol=1e-5)
    np.testing.assert_allclose(picture[dark], 0.0, atol=1e-6)


def test_light_beside_a_block_is_nearer_to_whole_paths_than_light_at_vertices():
    solver = known(block_on_floor())
    truth = luminance(shot_of(solver, 1024).irradiance)
    shots = (luminance(shot_of(solver, paths).irradiance) for paths in (None, 0))
    vertices, still = (np.abs(light - truth).sum() / truth.sum() for light in shots)
    assert still < 0.02 and still < 0.6 * vertices, (still, vertices)


def test_a_room_by_pixels_is_that_of_whole_paths_but_for_noise():
    solver = known(replace(room(), mobiles=(), probes=()))
    still, truth = shot_of(solver, 0), shot_of(solver, 512)
    light, true = luminance(still.colour), luminance(truth.colour)
    noise = np.sqrt(2 / np.pi) * np.sqrt(truth.variance.mean(axis=2)).sum() / true.sum()
    assert np.abs(light - true).sum() / true.sum() < 0.03 + noise
    assert abs(light.sum() / true.sum() - 1) < 0.01


def test_a_pane_and_a_mirror_show_light_by_pixels_behind_them():
    """Behind a clear pane, all light has the pane's transmittance; a mirror shows what render shows in it."""
    plain = block_on_floor()
    glass = Material("glass", (0.0,) * 3, two_sided=True, pane=Pane((0.5, 0.8, 0.9)))
    front = quad((0.2, -1.35, 0.2), (1.4, 0.2, 0), (0, 0, 1.2), (2, 2), 1)
    glazed = replace(plain, static=merge(plain.static, front), materials=(*plain.materials, glass))
    bare, behind = (shot_of(solved(scene), 0) for scene in (plain, glazed))
    seen = behind.coverage[..., 0] > 0
    ratio = behind.colour[seen].sum(axis=0) / bare.colour[seen].sum(axis=0)
    assert 0.3 < ratio[0] < 0.7 and ratio[0] < ratio[1] < ratio[2] < 1.05
    mirror = Material("mirror", (0.0,) * 3, gloss=Gloss((0.9,) * 3, 0.0))
    pool = quad((-0.2, -0.9, 0.001), (0.8, 0, 0), (0, 0.5, 0), (2, 2), 1)
    mirrored = replace(plain, static=merge(plain.static, pool), materials=(*plain.materials, mirror))
    solver = solved(mirrored)
    vertices, still = (shot_of(solver, paths) for paths in (None, 0))
    black = luminance(vertices.albedo) < 0.05
    inside = black & (luminance(vertices.colour) > 0.01)
    assert inside.sum() > 100
    np.testing.assert_allclose(still.colour[inside].mean(axis=0), vertices.colour[inside].mean(axis=0), rtol=0.02)


def test_pictures_by_pixels_are_those_of_the_layers():
    """The tone map of a picture file and the layers of an .exr have the same light."""
    solver = solved(room())
    shot = Shot(solver, replace(SETTINGS, exposure=-3.0), 0)
    pixels, colour = shot.take(), layers(shot).colour
    shown = to_display(colour, -3.0, shot.settings.tone_map, shot.gains).astype(int)
    on = colour.max(axis=2) > 0
    # Edges are means before the tone map in layers, after it in a picture.
    assert (np.abs(pixels - shown).max(axis=2)[on] <= 2).mean() > 0.8
