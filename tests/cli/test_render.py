"""Pictures without a window: vertex colours and ray casting."""

from dataclasses import replace

import numpy as np
import pytest

from app.draw.colour_map import sequential_colours
from app.draw.draw_mesh import draw_meshes
from app.draw.false_colour import Display, Scale
from app.draw.shot import Shot
from app.draw.shot import picture as picture_of
from app.draw.tonemap import BACKGROUND, UNLIT, to_display
from app.draw.vertex_colours import colours
from app.session.picture import metadata_of
from app.settings import Settings, make_solver
from gi_core.display.dilation import Drawn
from gi_core.geometry.error import luminance
from gi_core.geometry.surfaces import flatten
from gi_core.scene import Camera, Material, Mesh, Mobile, Paint, Pose, Scene, Texture
from gi_core.scene.types import Gloss
from tests.support.gl_drawing import gl_picture
from tests.support.scene_builders import complete, merge, quad
from tests.support.viewer_support import room

SMALL = Settings(photons=4000, radius=0.06, size=(96, 72))


def card(two_sided: bool = False, emission=(0.0, 0.0, 0.0)) -> Scene:
    """A white card at z = 0 with its front towards +z, and a camera 2 m away on that side."""
    material = Material("card", (0.5, 0.4, 0.3), emission, two_sided)
    mesh = quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0), (2, 2))
    return Scene(mesh, (material,), camera=Camera((0, 0, 2.0), (0, 0, 0), 60.0))


def shot_of(scene: Scene, settings: Settings, irradiance) -> Shot:
    """A scene with a given irradiance (R, 3) instead of a traced one."""
    solver = make_solver(scene, settings)
    E = np.broadcast_to(np.asarray(irradiance, float), solver.irradiance.shape).copy()
    solver.frame = solver.frame._replace(irradiance=E)
    return Shot(solver, settings)


def centre(picture: np.ndarray) -> list[int]:
    return picture[picture.shape[0] // 2, picture.shape[1] // 2].tolist()


def behind(scene: Scene) -> Scene:
    return replace(scene, camera=Camera((0, 0, -2.0), (0, 0, 0), 60.0))


def bytes_of(display) -> list[int]:
    return np.round(np.array(display) * 255).astype(int).tolist()


# Vertex colours -------------------------------------------------------------------------------------


def test_draw_vertices_split_only_where_light_or_paint_differs():
    """Two coplanar quads of one paint share their edge; of two paints they do not; triangles stay in order."""
    halves = [quad((x, 0, 0), (1, 0, 0), (0, 1, 0), material=m) for x, m in ((0, 0), (1, 1))]
    red, blue = Material("red", (0.5, 0, 0)), Material("blue", (0, 0, 0.5))
    welded = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]], float),
        np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]], np.int32),
        np.array([0, 0, 1, 1], np.int32),
    )
    same = draw_meshes(flatten(Scene(welded, (red, red)))[0])[0]
    split = draw_meshes(flatten(Scene(welded, (red, blue)))[0])[0]
    assert (len(same.positions), len(split.positions)) == (6, 8)
    for draw in (same, split):
        np.testing.assert_array_equal(draw.positions[draw.triangles], welded.vertices[welded.faces])
    np.testing.assert_array_equal(split.reflectance[split.triangles][2:], np.broadcast_to([0, 0, 0.5], (2, 3, 3)))
    assert len(draw_meshes(flatten(Scene(merge(*halves), (red, blue)))[0])[0].positions) == 8


def test_colours_are_rho_E_over_pi_plus_emission_on_the_front_only():
    scene = card(two_sided=True, emission=(1.0, 2.0, 3.0))
    surfaces, receivers = flatten(scene)
    (draw,) = draw_meshes(surfaces)
    E = np.arange(3.0 * len(receivers.areas)).reshape(-1, 3)
    front, back = colours(draw, E)
    rho = np.array([0.5, 0.4, 0.3])
    np.testing.assert_allclose(front, E[draw.front] * rho / np.pi + [1, 2, 3], rtol=1e-6)
    np.testing.assert_allclose(back, E[draw.back] * rho / np.pi, rtol=1e-6)
    assert front.dtype == back.dtype == np.float32 and (draw.front != draw.back).all()
    white, _ = colours(draw, E, with_reflectance=False)
    np.testing.assert_allclose(white, E[draw.front] / np.pi, rtol=1e-6)


def test_one_sided_backs_are_black_and_split_corners_keep_colour():
    surfaces, receivers = flatten(card())
    (draw,) = draw_meshes(surfaces)
    _, back = colours(draw, np.ones((len(receivers.areas), 3)))
    assert (draw.back == -1).all() and not back.any()


# Pictures -------------------------------------------------------------------------------------------


def test_front_seen_and_its_colour_exact():
    """rho E / pi at every vertex interpolates to itself: the centre pixel is the tone-mapped value."""
    shot = shot_of(card(), replace(SMALL, exposure=0.5), [np.pi, np.pi, np.pi])
    picture = shot.take()
    assert centre(picture) == to_display(np.array([0.5, 0.4, 0.3]), 0.5, "agx").tolist()
    assert picture[0, 0].tolist() == bytes_of(BACKGROUND)


def test_false_colours_of_a_known_irradiance_are_those_of_the_map():
    """E = 30 on a scale from 0 to 40: three quarters up the map, at any exposure and reflectance; then logarithmic."""
    for ends, position in (((0.0, 40.0), 0.75), ((3.0, 300.0), 0.5), ((40.0, 80.0), 0.0)):
        settings = replace(SMALL, show="illuminance", illuminance_range=ends, exposure=3.0)
        expected = bytes_of(sequential_colours(np.array([position]))[0])
        np.testing.assert_allclose(centre(shot_of(card(), settings, 30.0).take()), expected, atol=1)


def test_false_colours_of_luminance_are_those_of_the_radiance_seen():
    """L = rho E / pi + Le of a card, in closed form: at any exposure and white balance."""
    rho, Le, E = np.array([0.5, 0.4, 0.3]), np.array([2.0, 1.0, 0.5]), np.array([30.0, 20.0, 60.0])
    L = float(luminance(rho * E / np.pi + Le))
    for ends, position in (((0.0, 10.0), L / 10), ((0.1, 100.0), np.log(L / 0.1) / np.log(1000))):
        settings = replace(SMALL, show="luminance", luminance_range=ends, exposure=-3.0)
        expected = bytes_of(sequential_colours(np.array([position]))[0])
        shot = shot_of(card(emission=tuple(Le.tolist())), settings, E)
        np.testing.assert_allclose(centre(shot.take()), expected, atol=1)
    assert metadata_of(shot)["false_colours"] == "Radiance in W/m²/sr, 0.1 to 100, logarithmic, viridis"
    fitted = shot_of(card(), replace(SMALL, show="luminance"), E)
    fitted.take()
    assert fitted.scale.quantity == "luminance" and 0.9 * fitted.scale.high <= luminance(rho * E / np.pi) * 1.3


def test_false_colours_belong_to_interpolated_values():
    """E = 80 x + 40 across large triangles: each pixel has the colour of its own value."""
    scene, settings = card(), replace(SMALL, size=(65, 65), show="illuminance", illuminance_range=(0.0, 80.0))
    solver = make_solver(scene, settings)
    E = 80 * solver.receivers.positions[:, :1] + 40
    solver.frame = solver.frame._replace(irradiance=np.repeat(E, 3, axis=1))
    row = Shot(solver, settings).take()[32].astype(float)
    t = (2 * (np.arange(65) + 0.5) / 65 - 1) * 2.0 * np.tan(np.radians(30)) + 0.5
    inside = (t > 0.03) & (t < 0.97)
    np.testing.assert_allclose(row[inside], 255 * sequential_colours(t[inside]), atol=3)


@pytest.mark.parametrize("width", [45, 75])  # no room for a legend
def test_isolines_lie_where_the_light_has_their_value(width):
    """Irradiance x + 1/2 on a card: lines at 0.3 and 0.8, as wide in large pictures as in small ones."""
    lined = replace(SMALL, show="illuminance", illuminance_range=(0.0, 1.0), isolines=(0.3, 0.8), size=(width, width))
    plain = replace(lined, isolines=None)
    rows = []
    for settings in (plain, lined):
        solver = make_solver(card(), settings)
        x = solver.receivers.positions[:, 0] + 0.5
        solver.frame = solver.frame._replace(irradiance=np.repeat(x[:, None], 3, axis=1))
        rows.append(Shot(solver, settings).take()[width // 2].astype(float))  # without the legend
    t = (2 * (np.arange(width) + 0.5) / width - 1) * 2.0 * np.tan(np.radians(30)) + 0.5
    on_card = (t > 0.03) & (t < 0.97)
    apart = np.abs(rows[1] - rows[0]).max(axis=1) / 255 * on_card
    for value, colour in ((0.3, 255), (0.8, 0)):  # white on dark colours, black on light ones
        near = np.abs(t - value) < 0.12
        middle = np.average(t[near], weights=apart[near])
        assert middle == pytest.approx(value, abs=0.3 * (t[1] - t[0]))
        peak = np.flatnonzero(near)[apart[near].argmax()]
        assert np.abs(rows[1][peak] - colour).mean() < 120
        full = np.abs(colour - rows[0][peak]).max() / 255 * 0.85
        assert apart[near].sum() / full == pytest.approx(1.5, abs=0.45), "pixels, at any size of the picture"
    assert apart[(np.abs(t - 0.3) > 0.12) & (np.abs(t - 0.8) > 0.12)].max() == 0


def test_the_scale_of_false_colours_fits_the_visible_surface_and_stays():
    """A bright mobile behind the card does not count; later pictures keep the first one's scale."""
    hidden = Mobile("m", quad((-0.3, -0.3, 0), (0.6, 0, 0), (0, 0.6, 0)), Pose((0, 0, -0.5)))
    scene = replace(card(), mobiles=(hidden,), units="photometric")
    settings = replace(SMALL, show="illuminance", size=(640, 480))
    shot = shot_of(scene, settings, 430.0)
    E = shot.solver.irradiance.copy()
    E[shot.solver.surfaces.receiver_range(1)] = 9000.0
    shot.solver.frame = shot.solver.frame._replace(irradiance=E)
    picture = shot.take()
    assert shot.scale == Scale(0.0, 500.0, False)
    assert metadata_of(shot)["false_colours"] == "Illuminance in lx, 0 to 500, linear, viridis"
    top, bottom = (sequential_colours(np.array([t]))[0] * 255 for t in (1.0, 0.0))
    corner = picture[300:, 500:].reshape(-1, 3).astype(float)
    assert all(np.abs(corner - c).max(axis=1).min() < 4 for c in (top, bottom)), "the legend has both ends"
    shot.solver.frame = shot.solver.frame._replace(irradiance=E / 10)
    shot.take()
    assert shot.scale == Scale(0.0, 500.0, False)


def test_gouraud_is_linear_across_a_triangle():
    """Irradiance proportional to x + 1/2 gives a picture proportional to it (clip, in linear values)."""
    scene, settings = card(), replace(SMALL, exposure=0.0, tone_map="clip", size=(65, 65), show="irradiance")
    solver = make_solver(scene, settings)
    x = solver.receivers.positions[:, 0] + 0.5
    solver.frame = solver.frame._replace(irradiance=np.pi * np.repeat(x[:, None], 3, axis=1))
    row = Shot(solver, settings).take()[32, :, 0].astype(float) / 255
    linear = np.where(row <= 0.04045, row / 12.92, ((row + 0.055) / 1.055) ** 2.4)
    half_width = 2.0 * np.tan(np.radians(30))
    expected = (2 * (np.arange(65) + 0.5) / 65 - 1) * half_width + 0.5
    inside = (expected > 0.03) & (expected < 0.97)
    np.testing.assert_allclose(linear[inside], expected[inside], atol=0.006)


def test_a_vertex_of_small_weight_hardly_counts():
    """A card of light 1 with a dark vertex in the middle: visible at equal weights, invisible at weight 0."""
    scene, settings = card(), replace(SMALL, exposure=0.0, size=(65, 65), show="irradiance")
    shot = shot_of(scene, settings, np.pi)
    (mesh,), drawn = shot.lit.meshes, shot.lit.drawn
    (middle,) = set(mesh.front[(mesh.positions[:, :2] == 0).all(axis=1)])
    E, weights = drawn.irradiance.copy(), np.ones(len(drawn.irradiance), np.float32)
    E[middle], weights[middle] = 0.0, 1e-3
    lit = [replace(shot.lit, drawn=Drawn(E, w)) for w in (None, weights)]
    dipped, even = (picture_of(part, shot.view, Display(0.0, "clip"))[28, :, 0] for part in lit)
    inside = slice(24, 42)
    assert dipped[inside].min() < 180 and even[inside].min() > 250


def test_backs_of_one_sided_faces_are_culled_or_shown_unlit():
    scene = behind(card())
    assert centre(shot_of(scene, SMALL, 1.0).take()) == bytes_of(BACKGROUND)
    assert centre(shot_of(scene, replace(SMALL, cull=False), 1.0).take()) == bytes_of(UNLIT)


def test_backs_of_two_sided_faces_show_their_own_light():
    scene = behind(card(two_sided=True, emission=(5.0, 5.0, 5.0)))
    shot = shot_of(scene, replace(SMALL, exposure=0.0), [np.pi, np.pi, np.pi])
    assert centre(shot.take()) == to_display(np.array([0.5, 0.4, 0.3]), 0.0, "agx").tolist()


def test_rays_continue_behind_culled_backs():
    """Three backs in a row, then a front: only the colour of the front reaches the pixel."""
    backs = [quad((-0.5, -0.5, z), (0, 1, 0), (1, 0, 0)) for z in (0.1, 0.2, 0.2001)]
    scene = replace(card(), static=merge(*backs, card().static))
    shot = shot_of(scene, replace(SMALL, exposure=0.0), [np.pi, np.pi, np.pi])
    assert centre(shot.take()) == to_display(np.array([0.5, 0.4, 0.3]), 0.0, "agx").tolist()


def test_mobiles_are_drawn_at_their_poses():
    """A mobile card before the static one hides it; rotated by 180 degrees its culled back hides nothing."""
    mobile = Mobile("m", quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0), material=1), Pose((0, 0, 0.5)))
    scene = replace(card(), mobiles=(mobile,), materials=(*card().materials, Material("red", (0.9, 0, 0))))
    shot = shot_of(scene, replace(SMALL, exposure=0.0), [np.pi, np.pi, np.pi])
    assert centre(shot.take()) == to_display(np.array([0.9, 0, 0]), 0.0, "agx").tolist()
    shot.solver.poses["m"] = Pose((0, 0, 0.5), (0.0, 0.0, 1.0, 0.0))
    assert centre(shot.take()) == to_display(np.array([0.5, 0.4, 0.3]), 0.0, "agx").tolist()


def test_every_pixel_inside_a_closed_room_is_hit():
    """Seen from inside, no ray may pass between two adjacent triangles."""
    scene = replace(room(), camera=Camera((0.5, 0.5, 0.9), (0.5, 0.4, 0.0), 90.0))
    shot = shot_of(scene, replace(SMALL, exposure=0.0), 1.0)
    assert not (shot.take() == bytes_of(BACKGROUND)).all(axis=2).any()


def test_ray_cast_picture_equals_the_opengl_picture():
    """Same colours, camera, sides, tone map: all but edge pixels agree (measured: 0.24 % are 8 steps of 255 apart)."""
    solver = complete(make_solver(room(), SMALL))
    shown = replace(SMALL, show="irradiance"), replace(SMALL, show="illuminance", illuminance_range=(0.0, 20.0))
    shown = *shown, replace(SMALL, show="luminance", luminance_range=(0.01, 20.0))
    for settings in (SMALL, replace(SMALL, cull=False, tone_map="reinhard"), *shown):
        shot = Shot(solver, replace(settings, size=(192, 144)))
        ours = shot.take()
        drawn = gl_picture(shot).astype(int)
        apart = np.abs(ours.astype(int) - drawn).max(axis=2)
        assert (apart > 8).mean() < 0.01 and apart.mean() < 1.0, f"{(apart > 8).mean():.3%}, mean {apart.mean():.2f}"


@pytest.mark.gl
def test_ray_cast_isolines_are_those_of_the_opengl_picture():
    """Where one picture has a line, the other has one within a pixel. OpenGL differentiates over blocks of 2 x 2."""
    from scipy.ndimage import maximum_filter

    solver = complete(make_solver(room(), SMALL))
    lined = replace(SMALL, show="illuminance", illuminance_range=(0.0, 20.0), isolines=(1.0, 2.0, 5.0), size=(192, 144))
    pictures = [[], []]
    for settings in (lined, replace(lined, isolines=None)):
        shot = Shot(solver, settings)
        for kind, picture in zip(pictures, (shot.take(), gl_picture(shot)), strict=True):
            kind.append(picture.astype(int))
    ours, theirs = (np.abs(with_lines - plain).max(axis=2) for with_lines, plain in pictures)
    for one, other in ((ours, theirs), (theirs, ours)):
        drawn = one > 90
        assert drawn.sum() > 300
        alone = drawn & (maximum_filter(other, 3) < 60)  # a line may be fainter in the other picture, not absent
        assert alone.sum() < 0.01 * drawn.sum()  # measured: 5 of 1,777, 0 of 1,626


def checkered_room(repeats: float = 6.0) -> Scene:
    """The room with an image on every surface but the lamp and the block, mirrored on the red wall."""
    scene = room()
    y, x = np.mgrid[:32, :32]
    pixels = np.stack([60 + 5 * x, 80 + 4 * y, np.where((x // 8 + y // 8) % 2, 220, 40)], axis=2).astype(np.uint8)
    mesh = scene.static
    rho = np.array([m.reflectance for m in scene.materials])
    corners = mesh.vertices[mesh.faces]
    uv = np.where(np.abs(np.ptp(corners[:, :, 0], axis=1, keepdims=True)[..., None]) < 1e-9,
                  corners[..., [2, 1]], corners[..., [0, 2]] + corners[..., [1]])  # fmt: skip
    paint = Paint(
        (Texture(pixels), Texture(pixels, ("mirror", "clamp"))),
        np.array([0, 1, 0, -1], np.int32)[mesh.face_material],
        (repeats * uv).astype(np.float32),
        np.repeat(rho[mesh.face_material][:, None], 3, axis=1).astype(np.float32),
    )
    return replace(scene, static=mesh._replace(paint=paint))


@pytest.mark.parametrize("show", ["radiance", "irradiance"])
def test_a_textured_picture_equals_the_opengl_picture(show):
    """Texture by texture, near and far, mirrored and clamped; rays soften the texels' edges, GL does not.

    Of blocks of 4 x 4 pixels the means agree (measured: 0.6 of 255 apart, 0.7 % more than 10).
    """
    settings = replace(SMALL, size=(384, 288), exposure=1.0, show=show)
    solver = make_solver(checkered_room(1.5), settings)
    solver.frame = solver.frame._replace(irradiance=np.full(solver.irradiance.shape, 2.0))
    shot = Shot(solver, settings)
    ours, drawn = shot.take().astype(int), gl_picture(shot).astype(int)
    blocks = [p.reshape(72, 4, 96, 4, 3).mean(axis=(1, 3)) for p in (ours, drawn)]
    apart = np.abs(blocks[0] - blocks[1]).max(axis=2)
    assert (apart > 10).mean() < 0.03 and apart.mean() < 1.5, f"{(apart > 10).mean():.3%}, mean {apart.mean():.2f}"
    plain = Shot(make_solver(room(), settings), settings)
    plain.solver.frame = plain.solver.frame._replace(irradiance=solver.irradiance)
    differs = np.abs(ours - plain.take().astype(int)).max(axis=2) > 24
    assert differs.mean() > 0.3 if show == "radiance" else not differs.any()


def test_a_far_texture_does_not_speckle():
    """Black and white checks far smaller than a pixel, over the whole room: neighbours look alike."""
    settings = replace(SMALL, exposure=0.0, tone_map="clip", size=(96, 72))
    scene = card()
    checks = (255 * (np.indices((64, 64)).sum(axis=0) % 2)).astype(np.uint8)[..., None].repeat(3, axis=2)
    corners = scene.static.vertices[scene.static.faces][..., :2]
    n = len(corners)
    paint = Paint((Texture(checks),), np.zeros(n, np.int32), (40 * corners).astype(np.float32), np.ones((n, 3, 3)))
    shot = shot_of(replace(scene, static=scene.static._replace(paint=paint)), settings, [np.pi] * 3)
    picture = shot.take()[26:46, 38:58].astype(int)
    assert np.abs(picture - int(to_display(np.full(3, 0.5), 0.0, "clip")[0])).max() <= 3


def test_the_meter_sees_textures_by_their_mean():
    """A dark image on everything needs a longer exposure; the meter must not see the white underneath it."""
    dark = checkered_room()
    pixels = np.full((4, 4, 3), 64, np.uint8)  # linear 0.0513
    paint = dark.static.paint
    paint = paint._replace(textures=(Texture(pixels),) * 2, corner_colour=np.ones_like(paint.corner_colour))
    grey = Material("grey", (0.0513, 0.0513, 0.0513))
    plain = replace(room(), materials=(grey, grey, grey, room().materials[3]))
    dark = replace(plain, static=dark.static._replace(paint=paint))
    exposures = [shot_of(s, SMALL, 1.0).metered() for s in (dark, plain)]
    assert exposures[0] == pytest.approx(exposures[1], abs=0.02)
    assert exposures[0] > shot_of(room(), SMALL, 1.0).metered() + 2


def test_draw_vertices_split_at_texture_seams_share_light():
    """Two quads with one edge in common: other coordinates on either side split its vertices, not its receivers."""
    mesh = quad((0, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1))
    uv = mesh.vertices[mesh.faces][..., :2].astype(np.float32)
    seam = uv.copy()
    seam[2:] += 5.0
    n = len(mesh.faces)
    for given, vertices in ((uv, 6), (seam, 8)):
        paint = Paint((Texture(np.zeros((2, 2, 3), np.uint8)),), np.zeros(n, np.int32), given, np.ones((n, 3, 3)))
        surfaces, receivers = flatten(Scene(mesh._replace(paint=paint), (Material("m"),)))
        (draw,) = draw_meshes(surfaces)
        assert len(draw.positions) == vertices and len(receivers.areas) == 6
        np.testing.assert_array_equal(draw.uv[draw.triangles], given)
        np.testing.assert_array_equal(draw.front[draw.triangles], surfaces.corner_front)


def test_scenes_without_textures_carry_none():
    for mesh in draw_meshes(flatten(room())[0]):
        assert mesh.textures == () and mesh.texture is None and mesh.uv is None and mesh.texel is None


def test_a_glossy_picture_equals_the_opengl_picture():
    """Plastic walls and a golden mobile: the vertex shader and gi_core/gloss/light.py do the same arithmetic."""
    scene = room()
    gold = Material("gold", (0.0,) * 3, gloss=Gloss((0.9, 0.7, 0.3), 0.2))
    plastic = [m._replace(gloss=Gloss(alpha=0.3)) for m in scene.materials[:3]]
    block = scene.mobiles[0]
    golden = block._replace(mesh=block.mesh._replace(face_material=np.full(len(block.mesh.faces), 4, np.int32)))
    scene = replace(scene, materials=(*plastic, scene.materials[3], gold), mobiles=(golden,))
    settings = replace(SMALL, size=(240, 180), exposure=1.0)
    shot = Shot(make_solver(scene, settings), settings)
    shot.solver.solve()
    pictures = []
    for way in ("list", "all_rays", "quadtree"):
        shot.solver.configure(gloss=way)
        shot.solver.move_all(shot.solver.poses)
        ours, drawn = shot.take().astype(int), gl_picture(shot).astype(int)
        apart = np.abs(ours - drawn).max(axis=2)
        assert apart.mean() < 1.5 and (apart > 16).mean() < 0.03, f"{way} {apart.mean():.2f}, {(apart > 16).mean():.3%}"
        pictures.append(ours)
    listed, opened, summed = pictures
    assert 0 < np.abs(opened - listed).mean() < np.abs(summed - listed).mean() < 1.0
    shot.solver.frame = shot.solver.frame._replace(gloss=None)
    shines = np.abs(ours - shot.take().astype(int)).max(axis=2) > 8
    assert shines.mean() > 0.05, f"{shines.mean():.3%}"
