"""Rays to lamps in sharp gloss: the same light as rays drawn from the lobe alone, with less noise."""

from dataclasses import replace

import numpy as np
import pytest

from app.draw import fine_mesh, reflected, visible
from app.draw.bare_lights import bare_lights
from app.draw.shot import Shot, layers
from app.settings import Settings, make_solver
from gi_core.bsdf.models import lobe
from gi_core.geometry.error import luminance
from gi_core.gloss.reflectors import reflectors
from gi_core.scene.types import Camera, Gloss, Material, Mobile, PointLight, Scene
from tests.support.scene_builders import box, merge, quad, sphere
from tests.window.test_reflections import kind_of

SETTINGS = Settings(size=(60, 40), photons=2000, radius=0.2, exposure=0.0, light="photons")
MIRROR = Gloss((1.0, 1.0, 1.0), 0.0, 1.0)
ROUGH = {
    "GGX of alpha 0.1": Material("ball", (0, 0, 0), gloss=Gloss((0.9, 0.7, 0.3), 0.1, 0.9)),
    "brushed Ward": Material("ball", brdf=(lobe("ward", {"kd": 0.0, "ks": 0.9, "ax": 0.05, "ay": 0.25}),), scaled=True),
    "Phong": Material("ball", brdf=(lobe("phong", {"kd": (0.3, 0.1, 0.1), "ks": 0.3, "n": 60.0}),), scaled=True),
}


def shot_of(ball: Material, *more, lights=(), size=SETTINGS.size) -> Shot:
    """A ball before a mirror, under a lamp that a board hides in part: lamps nearby, small and half seen."""
    materials = (
        Material("wall", (0.3, 0.3, 0.3)),
        Material("lamp", emission=(60.0, 50.0, 40.0)),
        Material("mirror", (0, 0, 0), gloss=MIRROR),
        Material("board", (0.1, 0.1, 0.1)),
        ball,
    )
    static = merge(
        box((-1, -1, 0), (1, 1, 1.6), 4, 0, inward=True),
        quad((-0.1, -0.6, 1.59), (0, 0.2, 0), (0.2, 0, 0), (2, 2), 1),
        quad((0.4, -0.5, 0.7), (0, 0.02, 0), (0.1, 0, -0.1), (1, 3), 1),
        quad((-0.9, 0.98, 0.1), (1.8, 0, 0), (0, 0, 1.3), (2, 2), 2),
        quad((0.0, -0.6, 1.3), (0, 0.2, 0), (0.3, 0, 0), (1, 1), 3),
        *more,
    )
    mobile = Mobile("ball", sphere((0, 0, 0.7), 0.3, 3, 4))
    camera = Camera((0.1, -0.9, 1.0), (0, 0.2, 0.7), 60.0)
    scene = Scene(static, materials, (mobile,), lights, camera=camera, up=(0, 0, 1), name="ball")
    shot = Shot(make_solver(scene, SETTINGS), replace(SETTINGS, size=size))
    shot.solver.solve()
    assert len(reflectors(shot.solver.model)[1]) == 1, "the ball is sharp enough for reflections"
    return shot


def drawn(
    shot: Shot, rays: int = reflected.RAYS_PER_PIXEL_RAY, lamp_rays: int = reflected.LAMP_RAYS, wanted: float = 0.0
) -> np.ndarray:
    """Return the luminance (h, w) [W/m2/sr] of a picture.

    lamp_rays 0: by rays from lobes alone; wanted: noise of pixels that have no further rays, 0: all have all.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reflected, "PIXEL_NOISE", wanted)
        patch.setattr(reflected, "MOST_RAYS", 1 << 40)
        patch.setattr(reflected, "RAYS_PER_PIXEL_RAY", rays)
        patch.setattr(reflected, "LAMP_RAYS", lamp_rays)
        return luminance(layers(shot).colour)


def noise(picture: np.ndarray, truth: np.ndarray) -> float:
    """Return the root mean square of the difference over the mean."""
    return float(np.sqrt(((picture - truth) ** 2).mean()) / truth.mean())


@pytest.mark.parametrize("name", ROUGH)
def test_rays_to_lamps_bring_the_same_light_with_less_noise(name):
    """512 rays from the lobe alone have the mean of 128 beside 64 to lamps: measured within 0.1 %.

    At the number of rays of pictures, the noise is 0.44 to 0.51 of that without rays to lamps.
    """
    shot = shot_of(ROUGH[name], size=(36, 24))
    truth = drawn(shot, 128, 64)
    assert drawn(shot, 512, 0).sum() == pytest.approx(truth.sum(), rel=0.004)
    assert noise(drawn(shot), truth) < 0.7 * noise(drawn(shot, lamp_rays=0), truth)


def test_a_rough_ball_has_as_many_rays_in_a_mirror_as_seen_directly():
    """One ray in place of 32 has 5 times the noise in the mirror."""
    shot = shot_of(ROUGH["GGX of alpha 0.1"])
    in_mirror = kind_of(shot) == 2
    truth, now, single = (drawn(shot, *rays)[in_mirror] for rays in ((512, 256), (32, 16), (1, 1)))
    assert in_mirror.sum() > 300
    assert noise(now, truth) < 0.4 * noise(single, truth)


def counted(shot: Shot, most: int = reflected.MOST_RAYS, wanted=reflected.PIXEL_NOISE) -> tuple[np.ndarray, int]:
    """Return the picture of drawn(), and the number of rays from lobes."""
    count, draw = 0, reflected.draw_lobe

    def counting(views, numbers):
        nonlocal count
        count += len(numbers)
        return draw(views, numbers)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reflected, "draw_lobe", counting)
        patch.setattr(reflected, "MOST_RAYS", most)
        patch.setattr(reflected, "PIXEL_NOISE", wanted)
        return luminance(layers(shot).colour), count


def test_pixels_have_as_many_rays_as_their_noise_asks_for():
    """Fewer rays, with noise near that of all. The truth has 16 times as many."""
    shot = shot_of(ROUGH["GGX of alpha 0.1"])
    truth, full = drawn(shot, 512, 256), drawn(shot)
    some, few = counted(shot)
    _, all_rays = counted(shot, 1 << 40, 0.0)
    rough, rougher = counted(shot, wanted=8.0)
    assert rougher < 0.5 * few < 0.4 * all_rays
    assert noise(rough, truth) > noise(some, truth)
    assert noise(some, truth) < 1.5 * noise(full, truth)
    assert some.sum() == pytest.approx(truth.sum(), rel=0.01), "pixels of little noise are those without much light"


def test_rays_of_a_picture_are_bounded():
    """With every pixel asking for more, further rays stay within their bound: a picture ends in time."""
    shot = shot_of(ROUGH["GGX of alpha 0.1"])
    _, least = counted(shot, 0)
    _, bounded = counted(shot, 10_000, 1e-3)
    _, free = counted(shot, 1 << 40, 1e-3)
    assert least < bounded < least + 4 * 10_000 < free, "each ray is followed by three more at most"


def test_a_picture_does_not_depend_on_the_number_of_threads(monkeypatch):
    """Its strips are drawn by several threads, each with the rays of its own gloss."""
    shot = shot_of(ROUGH["GGX of alpha 0.1"])
    monkeypatch.setattr(visible, "RAYS_PER_BATCH", 4 * 3 * shot.settings.size[0])
    pictures = []
    for threads in (1, 3):
        monkeypatch.setattr(shot.solver.model.accelerator, "threads", threads)
        reached: list[float] = []
        pictures.append((shot.take(reached.append), layers(shot).colour))
        assert reached == sorted(reached) and len(reached) > 2
    for one, several in zip(*pictures, strict=True):
        np.testing.assert_array_equal(one, several)


def test_reflections_of_faces_in_fine_pieces_are_those_of_whole_faces(monkeypatch):
    """Pieces have other numbers than faces of the model, which rays to lamps look up."""
    shot = shot_of(ROUGH["GGX of alpha 0.1"])
    whole, of_ball = drawn(shot), kind_of(shot) == 4
    monkeypatch.setattr(fine_mesh, "takes_fine_points", lambda solver: True)
    shot.refine()
    assert len(shot.lit.meshes[0].triangles) > len(shot.solver.model.surfaces.faces[0])
    assert drawn(shot)[of_ball].sum() == pytest.approx(whole[of_ball].sum(), rel=0.05)


def test_reflections_and_highlights_stay_where_a_triangle_is_far_away():
    """Rays left sharp faces at a share of the size of everything: 9 m off with a triangle at 448 km."""
    pictures = []
    for far in (0.0, 448e3):
        stray = quad((far - 0.9, -0.9, 0.01), (0.01, 0, 0), (0, 0.01, 0), (1, 1), 0)
        light = PointLight("bulb", (0.5, -0.5, 1.2), (2.0, 2.0, 2.0))
        shot = shot_of(ROUGH["GGX of alpha 0.1"], stray, lights=(light,))
        pictures.append(drawn(shot, 16))
        lights = bare_lights(shot.lit)
        pictures.append(lights.strength[1])
    near, strength, there, strength_there = pictures
    assert noise(there, near) < 0.02
    assert (strength > 0).any() and np.mean((strength > 0) != (strength_there > 0)) < 0.01
