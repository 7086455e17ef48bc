"""Sharp gloss in pictures: closed forms, OpenGL against traced rays, moves and cameras."""

from dataclasses import replace

import numpy as np
import pytest

from app.draw import gl_mirrors, visible
from app.draw.camera import from_camera
from app.draw.colour_map import sequential_colours
from app.draw.lit_scene import metered
from app.draw.shot import Shot
from app.draw.tonemap import srgb_decode
from app.settings import Settings, make_solver
from gi_core.geometry.error import luminance
from gi_core.scene.types import Camera, Gloss, Material, Mobile, Pose, Scene
from tests.support.gl_drawing import gl_picture
from tests.support.scene_builders import box, merge, quad, sphere

SETTINGS = Settings(size=(240, 160), photons=4000, radius=0.2, exposure=-1.0, tone_map="clip", light="photons")
WALLS = box((-1, -1, 0), (1, 1, 1.6), 6, 0, inward=True)
MIRROR = Gloss((0.9, 0.9, 0.9), 0.0, 0.9)


def shot_of(scene: Scene, settings: Settings = SETTINGS) -> Shot:
    shot = Shot(make_solver(scene, settings), settings)
    shot.solver.solve()
    return shot


def scene(gloss: Gloss = MIRROR) -> Scene:
    """A room with a lamp and a mirror on the wall behind, a ball of some gloss and a red one in front."""
    materials = (
        Material("wall", (0.6, 0.6, 0.6)),
        Material("lamp", emission=(9.0, 8.0, 7.0)),
        Material("mirror", (0, 0, 0), gloss=MIRROR),
        Material("ball", (0, 0, 0), gloss=gloss),
        Material("red", (0.6, 0.05, 0.05)),
    )
    static = merge(
        WALLS,
        quad((-0.3, -0.3, 1.59), (0, 0.6, 0), (0.6, 0, 0), (2, 2), 1),
        quad((-0.9, 0.985, 0.1), (1.1, 0, 0), (0, 0, 1.3), (3, 3), 2),
    )
    balls = (
        Mobile("ball", sphere((0, 0, 0), 0.25, 3, 3), Pose((0.5, 0.3, 0.4))),
        Mobile("red", sphere((0, 0, 0), 0.2, 3, 4), Pose((-0.4, -0.3, 0.5))),
    )
    camera = Camera((0.2, -0.95, 0.8), (-0.1, 0.6, 0.65), 60.0)
    return Scene(static, materials, balls, camera=camera, up=(0, 0, 1), name="mirrors")


def faces_seen(shot: Shot) -> np.ndarray:
    """Return the face (h, w) that all rays of a pixel see, -1 along edges."""
    lit, view = shot.lit, shot.view
    strips: list[visible.Strip] = []
    visible.draw_strips(strips.append, lit, visible.place(lit.meshes, lit.at), view)
    strips.sort(key=lambda strip: strip.rows.start)
    rays = np.concatenate([s.face for s in strips]).reshape(view.height, view.width, -1)
    return np.where((rays == rays[..., :1]).all(axis=2), rays[..., 0], -1)


def kind_of(shot: Shot) -> np.ndarray:
    """Return the material (h, w) that is seen, -1 along edges."""
    s, faces = shot.solver.scene, faces_seen(shot)
    worn = np.concatenate([m.face_material for m in (s.static, *(m.mesh for m in s.mobiles))])
    return np.where(faces < 0, -1, worn[faces])


def furnace(alpha: float, **settings) -> Shot:
    """Black walls of equal radiance, and a ball that reflects, in 60 x 40 pixels."""
    gloss = Gloss((0.8, 0.5, 0.2), alpha, 0.8)
    materials = (Material("wall", (0, 0, 0), (0.5, 0.5, 0.5)), Material("ball", (0, 0, 0), gloss=gloss))
    ball, camera = Mobile("ball", sphere((0, 0, 0), 0.3, 3, 1)), Camera((0, -0.9, 0), (0, 0, 0), 40.0)
    room = box((-1, -1, -1), (1, 1, 1), 2, 0, inward=True)
    scene = Scene(room, materials, (ball,), camera=camera, up=(0, 0, 1), name="furnace")
    return shot_of(scene, replace(SETTINGS, size=(60, 40), **settings))


@pytest.mark.parametrize("alpha", [0.0, 0.1])
def test_a_sharp_ball_in_a_furnace_shows_its_albedo(alpha):
    """A ball that reflects shows its directional albedo, traced and by OpenGL."""
    shot = furnace(alpha, exposure=0.0)
    (reflector,) = shot.lit.meshes[1].reflectors
    expected = 0.5 * reflector.lobe.albedo[-1]
    radiance = srgb_decode(shot.take()[18:22, 28:32] / 255).mean(axis=(0, 1))
    np.testing.assert_allclose(radiance, expected, rtol=0.02, atol=0.003)


@pytest.mark.gl
def test_false_colours_of_luminance_show_sharp_gloss():
    """The ball of the furnace reflects 0.5 times its albedo, a closed form: traced, by OpenGL, at any exposure."""
    shot = furnace(0.0, exposure=2.0, show="luminance", luminance_range=(0.0, 1.0))
    (reflector,) = shot.lit.meshes[1].reflectors
    expected = 255 * sequential_colours(luminance(0.5 * reflector.lobe.albedo[-1][None]))[0]
    for picture in (shot.take(), gl_picture(shot)):
        np.testing.assert_allclose(picture[18:22, 28:32].mean(axis=(0, 1)), expected, atol=4)


@pytest.mark.gl
@pytest.mark.parametrize("alpha", [0.0, 0.05])
def test_the_opengl_picture_is_that_of_traced_rays(alpha):
    """A planar mirror within 3 %, a ball within 12 % of the reflected light, both without bias."""
    shot = shot_of(scene(Gloss((0.9, 0.7, 0.3), alpha)))
    kinds = kind_of(shot)
    traced, drawn = (srgb_decode(picture / 255) for picture in (shot.take(), gl_picture(shot)))
    for material, most in ((2, 0.03), (3, 0.12)):
        seen = kinds == material
        assert seen.sum() > 1000
        apart = np.abs(traced - drawn)[seen].sum() / traced[seen].sum()
        bias = (drawn - traced)[seen].sum() / traced[seen].sum()
        assert apart < most and abs(bias) < 0.04, f"{material}: {apart:.3f}, {bias:+.3f}"


@pytest.mark.gl
def test_a_triangle_far_away_leaves_the_picture():
    """The near plane was a share of the distance to everything, planes and probes of the size of everything."""
    near = scene(Gloss((0.9, 0.7, 0.3), 0.05))
    far = replace(near, static=merge(near.static, quad((448e3, 0, 1), (1, 0, 0), (0, 1, 0), (1, 1), 0)))
    alone, beside = (gl_picture(shot_of(s)).astype(int) for s in (near, far))
    assert np.abs(alone - beside).mean() < 0.1


@pytest.mark.gl
@pytest.mark.parametrize("exposure", [-5.0, 0.0])
def test_lamps_thinner_than_a_pixel_are_as_bright_as_in_traced_rays(exposure):
    """Averaged otherwise than samples of a pixel, looks into a probe made them 120 to 150 % too bright."""
    given = scene(Gloss(alpha=0.0))
    strips = [quad((-0.8, y, 1.58), (0, 0.012, 0), (1.6, 0, 0), (1, 8), 1) for y in np.linspace(-0.8, 0.8, 9)]
    dark, bright = Material("dark", (0.03, 0.03, 0.03)), Material("lamp", emission=(400.0, 400.0, 400.0))
    materials = dark, bright, *given.materials[2:]
    given = replace(given, static=merge(WALLS, *strips), materials=materials)
    shot = shot_of(given, replace(SETTINGS, exposure=exposure))
    seen = kind_of(shot) == 3
    traced, drawn = (srgb_decode(picture / 255)[seen] for picture in (shot.take(), gl_picture(shot)))
    bias = drawn.sum() / traced.sum() - 1
    assert seen.sum() > 1000 and abs(bias) < 0.15, f"{bias:+.3f}"


@pytest.mark.gl
def test_the_vertex_shader_shows_gloss_as_its_twin_does():
    """A ball of alpha 0.3 has light at vertices; half floats and edges of triangles alone differ."""
    shot = shot_of(scene(Gloss((0.9, 0.7, 0.3), 0.3)))
    seen = kind_of(shot) == 3
    twin, drawn = (srgb_decode(picture / 255)[seen] for picture in (shot.take(), gl_picture(shot)))
    assert seen.sum() > 1000 and np.abs(twin - drawn).sum() < 0.02 * twin.sum()


@pytest.mark.gl
@pytest.mark.parametrize("way", ["list", "all_rays"])
def test_the_window_shows_single_rays_as_pictures_of_render_do(way):
    room = scene(Gloss((0.9, 0.7, 0.3), 0.3))
    shot, cells = (shot_of(room, replace(SETTINGS, gloss=one)) for one in (way, "quadtree"))
    seen = kind_of(shot) == 3
    twin, drawn, other = (srgb_decode(p / 255)[seen] for p in (shot.take(), gl_picture(shot), gl_picture(cells)))
    assert seen.sum() > 1000 and np.abs(twin - drawn).sum() < 0.02 * twin.sum()
    assert np.abs(other - drawn).sum() > np.abs(twin - drawn).sum(), "cells differ from their rays"


@pytest.mark.gl
@pytest.mark.parametrize("alpha, most", [(0.0, 0.06), (0.05, 0.08)])
def test_a_ball_shows_a_mirror_and_what_it_reflects(alpha, most):
    """Seen from the mirror: as a diffuse surface of its albedo, the mirror in the ball made 10 and 12 % of error."""
    room = scene(Gloss((0.9, 0.9, 0.9), alpha, 0.9))
    ball, red_ball = room.mobiles
    poses = ball._replace(pose=Pose((0.3, -0.2, 0.45))), red_ball._replace(pose=Pose((-0.5, 0.1, 0.4)))
    shot = shot_of(replace(room, mobiles=poses, camera=Camera((-0.35, 0.9, 0.8), (0.4, -0.3, 0.45), 50.0)))
    seen = kind_of(shot) == 3
    traced, drawn = (srgb_decode(picture / 255)[seen] for picture in (shot.take(), gl_picture(shot)))
    assert seen.sum() > 1000 and np.abs(traced - drawn).sum() < most * traced.sum()


def red(picture: np.ndarray) -> np.ndarray:
    r, g = picture[..., 0].astype(int), picture[..., 1].astype(int)
    return r > 2 * g + 20


@pytest.mark.gl
def test_a_mirror_shows_a_mobile_at_its_new_pose_in_the_same_frame():
    shot = shot_of(scene())
    pictures = []
    for x in (-0.4, 0.1):
        shot.solver.move("red", Pose((x, -0.3, 0.5)))
        in_mirror = kind_of(shot) == 2
        traced, drawn = (red(picture) & in_mirror for picture in (shot.take(), gl_picture(shot)))
        assert traced.sum() > 40 and (traced ^ drawn).sum() < 0.15 * traced.sum()
        pictures.append(drawn)
    first, second = pictures
    assert (first & second).sum() < 0.3 * first.sum()


@pytest.mark.gl
def test_a_renderer_follows_moves_light_and_camera():
    """One renderer: probes are kept while light and poses rest, and a picture equals that of a new renderer."""
    from tests.support.gl_drawing import drawn, look_of, upload

    shot = shot_of(scene(Gloss((0.9, 0.7, 0.3), 0.05)))
    with drawn(shot) as kept:
        cameras = Camera((0.2, -0.95, 0.8), (-0.1, 0.6, 0.65), 60.0), Camera((-0.6, -0.8, 1.2), (0.3, 0.4, 0.4), 50.0)
        for pose in (Pose((-0.4, -0.3, 0.5)), Pose((0.2, -0.2, 0.3))):
            shot.solver.move("red", pose)
            upload(kept, shot)
            for camera in cameras:
                shot.camera = turned(camera, shot)
                kept.draw(look_of(shot))
                np.testing.assert_array_equal(kept.pixels(), gl_picture(shot, kept.ctx))


def turned(camera: Camera, shot: Shot):
    return from_camera(camera, shot.solver.scene.up, shot.camera.bounds, shot.camera.bounds)


@pytest.mark.gl
def test_a_scene_without_sharp_gloss_draws_nothing_more():
    from tests.support.gl_drawing import drawn

    satin = scene(Gloss(alpha=0.3))
    satin = replace(satin, materials=(*satin.materials[:2], satin.materials[3], *satin.materials[3:]))
    shot = shot_of(satin)
    assert not any(mesh.reflectors for mesh in shot.lit.meshes)
    with drawn(shot) as drawing:
        assert not drawing._mirrors and not any("SHARP" in key for key in drawing._programs.made)
        assert not drawing._mirrors._planes and not drawing._mirrors._cubes


def test_metering_sees_gloss():
    """Gold in a dark room, seen from near by: the meter must not expose for the walls alone."""
    gold, dark = Material("gold", (0, 0, 0), gloss=Gloss((0.9, 0.7, 0.3), 0.5)), Material("dark", (0.02, 0.02, 0.02))
    shot = shot_of(replace(scene(), materials=(dark, scene().materials[1], gold, gold, dark)))
    shot.exposure = shot.metered()
    golden = shot.take()[np.isin(kind_of(shot), (2, 3))]
    assert 40 < np.median(golden) < 250
    assert shot.exposure < metered(replace(shot.lit, gloss=None), shot.camera, shot.solver.scene_size) - 1.0


def hollow_room(alpha: float) -> Scene:
    """A lacquered room inside a larger shell of the same lacquer, with a red ball and a lamp.

    The shell has the largest planes, and no camera inside sees them. Six planes of the room are in view or reflected.
    """
    materials = (
        Material("lacquer", (0.3, 0.3, 0.35), gloss=Gloss((0.2, 0.2, 0.2), alpha, 1.0), two_sided=True),
        Material("lamp", emission=(9.0, 8.0, 7.0)),
        Material("red", (0.6, 0.05, 0.05)),
    )
    shell = box((-1.5, -1.5, -0.5), (1.5, 1.5, 2.1), 6, 0)
    static = merge(
        box((-1, -1, 0), (1, 1, 1.6), 8, 0, inward=True),
        shell,
        quad((-0.3, 0.1, 1.59), (0, 0.6, 0), (0.6, 0, 0), (2, 2), 1),
    )
    ball = Mobile("red", sphere((0, 0, 0), 0.25, 3, 2), Pose((-0.3, 0.2, 0.4)))
    camera = Camera((0.5, -0.9, 1.3), (-0.1, 0.4, 0.5), 90.0)
    return Scene(static, materials, (ball,), camera=camera, up=(0, 0, 1), name="hollow")


@pytest.mark.gl
@pytest.mark.parametrize("alpha, most", [(0.0, 0.08), (0.08, 0.14)])
def test_a_room_of_gloss_with_hidden_planes_is_that_of_traced_rays(alpha, most):
    """Walls behind walls took all planes, and the probe of the room left the room out: 42 to 46 % of error."""
    shot = shot_of(hollow_room(alpha), replace(SETTINGS, size=(120, 80)))
    walls = kind_of(shot) == 0
    traced, drawn = (srgb_decode(picture / 255)[walls] for picture in (shot.take(), gl_picture(shot)))
    apart, bias = np.abs(traced - drawn).sum() / traced.sum(), (drawn - traced).sum() / traced.sum()
    assert walls.sum() > 5_000 and apart < most and abs(bias) < 0.04, f"{apart:.3f}, {bias:+.3f}"


@pytest.mark.gl
def test_a_view_has_few_planes_and_the_largest_ones():
    from tests.support.gl_drawing import drawn

    shot = shot_of(hollow_room(0.0))
    with drawn(shot) as drawing:
        seen = drawing._mirrors._seen
        equations = {r.plane.number: r.plane.equation for r in shot.lit.meshes[0].reflectors if r.plane is not None}
        assert len(equations) == 12 and len(seen) == gl_mirrors.PLANES_SHOWN
        hidden = [n for n, e in equations.items() if abs(e[3]) in (1.5, 0.5, 2.1)]
        assert len(hidden) == 6 and not seen & set(hidden)
