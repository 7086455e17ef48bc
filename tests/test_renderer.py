"""The renderer, pixel by pixel, in a context without a window; and picking, which must see what is drawn."""

from __future__ import annotations

import numpy as np
import pytest
import viewer_support as support

from app.camera import Bounds, from_camera
from app.picking import Picker
from app.tonemap import TONE_MAPS, to_display
from app.vertex_colours import DrawMesh, colours, draw_meshes
from gi_core.pose import axis_angle, rotation
from gi_core.scene import Camera, Material, Mesh, Mobile, Pose, Scene, Texture
from gi_core.scene.texture_filter import lookup
from gi_core.surfaces import flatten

SIZE = (120, 80)
EYE = from_camera(Camera((0, 0, 2), (0, 0, 0), 40.0), (0, 1, 0), Bounds((-1, -1, -1), (1, 1, 1)))
IDENTITY = np.eye(4)


@pytest.fixture(scope="module")
def ctx():
    context = support.standalone_context()
    yield context
    context.release()


@pytest.fixture
def draw(ctx):
    """Return a function that draws objects and reads the picture back."""
    from app.renderer import Look, Renderer

    made = []

    def picture(objects, models=None, samples=1, camera=EYE, **look):
        renderer = Renderer(ctx, samples)
        made.append(renderer)
        renderer.set_scene(tuple(mesh for mesh, _, _ in objects))
        for o, (_, front, back) in enumerate(objects):
            renderer.set_colours(o, front, back)
        renderer.resize(*SIZE)
        models = tuple(models or [IDENTITY] * len(objects))
        aspect = SIZE[0] / SIZE[1]
        renderer.draw(Look(camera.projection(aspect) @ camera.view(), models, **look))
        return renderer.pixels().copy()

    yield picture
    assert ctx.error == "GL_NO_ERROR"
    for renderer in made:
        renderer.release()


def square(front, back=None, half=0.4, z=0.0):
    """Return a square that faces the eye, with one radiance a side; no back: one-sided."""
    v, f = support.quad((-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z))
    n = len(v)
    sided = np.full(n, -1 if back is None else 1, np.int32)
    mesh = DrawMesh(v.astype(np.float32), f, np.zeros(n, np.int32), sided, np.zeros((n, 3)), np.zeros((n, 3)))
    return mesh, np.tile(np.float32(front), (n, 1)), np.tile(np.float32(back or (0, 0, 0)), (n, 1))


def middle(picture):
    return picture[SIZE[1] // 2, SIZE[0] // 2].astype(int)


def background():
    from app.renderer import BACKGROUND

    return np.round(255 * np.array(BACKGROUND)).astype(int)


HALF_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])


@pytest.mark.gl
@pytest.mark.parametrize("tone_map", TONE_MAPS)
@pytest.mark.parametrize("exposure", [-3.0, 0.0, 2.5])
def test_pixels_are_those_of_the_picture_without_a_window(draw, tone_map, exposure):
    """One arithmetic in two languages: a step of 8-bit rounding apart at most, from black over 1e-4 to burnt out."""
    for radiance in [(0, 0, 0), (1e-4, 2e-3, 0.03), (0.2, 0.5, 0.9), (3.0, 0.4, 40.0)]:
        got = middle(draw([square(radiance)], tone_map=tone_map, exposure=exposure))
        expected = to_display(np.array(radiance, float), exposure, tone_map).astype(int)
        assert np.abs(got - expected).max() <= 1, (radiance, got, expected)


@pytest.mark.gl
def test_each_side_has_its_own_light(draw):
    two_sided = square((0.5, 0.1, 0.1), (0.1, 0.1, 0.5))
    front = middle(draw([two_sided], tone_map="clip"))
    back = middle(draw([two_sided], [HALF_TURN], tone_map="clip"))
    assert np.array_equal(front, to_display(np.array([0.5, 0.1, 0.1]), 0, "clip"))
    assert np.array_equal(back, to_display(np.array([0.1, 0.1, 0.5]), 0, "clip"))


@pytest.mark.gl
def test_backs_of_one_sided_faces_are_culled_or_grey_at_any_exposure(draw):
    from app.renderer import UNLIT

    one_sided = square((0.5, 0.5, 0.5))
    assert np.array_equal(middle(draw([one_sided], [HALF_TURN], cull=True)), background())
    grey = np.round(255 * np.array(UNLIT)).astype(int)
    for exposure in (0.0, 9.0):
        assert np.array_equal(middle(draw([one_sided], [HALF_TURN], cull=False, exposure=exposure)), grey)


@pytest.mark.gl
def test_an_unlit_surface_shows_black_against_the_background(draw):
    assert np.array_equal(middle(draw([square((0, 0, 0))])), (0, 0, 0))
    assert background().min() > 20


@pytest.mark.gl
def test_colours_run_linearly_between_vertices(draw):
    """Gouraud, in linear light: half way between 0 and 1 is the display value of 0.5, not half the display value."""
    mesh, front, back = square((0, 0, 0))
    front[mesh.positions[:, 0] > 0] = 1.0
    got = middle(draw([(mesh, front, back)], tone_map="clip"))
    assert abs(got[0] - int(to_display(np.full(3, 0.5), 0, "clip")[0])) <= 2


@pytest.mark.gl
def test_many_samples_soften_edges_and_nothing_else(draw):
    turned = IDENTITY.copy()
    turned[:3, :3] = rotation(Pose(quaternion=axis_angle((0, 0, 1), 20)))
    plain = draw([square((0.7, 0.7, 0.7))], [turned], samples=1)
    soft = draw([square((0.7, 0.7, 0.7))], [turned], samples=4)
    assert len(np.unique(plain[..., 0])) == 2 and len(np.unique(soft[..., 0])) > 2
    assert np.array_equal(middle(plain), middle(soft))
    assert soft.min() >= background().min()  # nothing extrapolates beyond a triangle


@pytest.mark.gl
def test_depth_decides_not_order(draw):
    near, far = square((0.9, 0, 0), half=0.1, z=0.3), square((0, 0.9, 0))
    for objects in ([near, far], [far, near]):
        assert middle(draw(objects))[0] > 150


@pytest.mark.gl
def test_a_mobile_is_drawn_at_its_pose(draw):
    shifted = IDENTITY.copy()
    shifted[:3, 3] = (0.5, 0.2, 0.0)
    picture = draw([square((0.8, 0.8, 0.8), half=0.05)], [shifted])
    v, u = np.argwhere(picture[..., 0] > 128).mean(axis=0)
    at = EYE.project((0.5, 0.2, 0.0), SIZE[0] / SIZE[1])
    assert (u + 0.5) / SIZE[0] == pytest.approx(at[0], abs=0.01)
    assert (v + 0.5) / SIZE[1] == pytest.approx(at[1], abs=0.01)


@pytest.mark.gl
def test_the_outline_is_outside_the_object(draw):
    bare = draw([square((0.3, 0.3, 0.3))])
    outlined = draw([square((0.3, 0.3, 0.3))], outlined=0)
    changed = (bare != outlined).any(axis=2)
    inside = (bare != background().astype(np.uint8)).any(axis=2)
    assert changed.any() and not (changed & inside).any()


@pytest.mark.gl
def test_resizing_releases_and_an_empty_object_draws_nothing(ctx):
    from app.renderer import Look, Renderer

    empty = DrawMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros(0, np.int32),
                     np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 3)))  # fmt: skip
    renderer = Renderer(ctx)
    renderer.set_scene((empty,))
    renderer.set_colours(0, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32))
    for k in range(20):
        renderer.resize(50 + k, 40)
        renderer.draw(Look(IDENTITY, (IDENTITY,)))
        assert ctx.error == "GL_NO_ERROR"
    assert renderer.pixels().shape == (40, 69, 3)
    assert (renderer.pixels() == background()).all()
    renderer.resize(0, 0)
    assert renderer.size == (1, 1)
    renderer.release()
    assert ctx.error == "GL_NO_ERROR"


PIXELS = np.random.default_rng(5).integers(0, 256, (4, 4, 3), dtype=np.uint8)


def poster(texture, uv=((0, 1), (1, 1), (1, 0), (0, 0)), tint=(1.0, 1.0, 1.0), emission=(0.0, 0.0, 0.0)):
    """Return a square that faces the eye and shows an image upright; E / pi is 1 on its front, 1/2 on its back."""
    mesh, front, back = square(tint, tuple(0.5 * c for c in tint), half=0.5)
    n = len(front)
    mesh = mesh._replace(
        emission=np.tile(emission, (n, 1)),
        textures=(texture,),
        texture=np.zeros(n, np.int32),
        uv=np.array(uv, np.float32)[[0, 3, 1, 2]],  # the order of `support.quad`
        texel=np.ones((n, 3)),
    )
    return mesh, front, back


def inside(picture, step=5):
    """Return pixels (n, 3) of a poster and where they are in it (n, 2), 0..1 from its top left corner."""
    aspect = SIZE[0] / SIZE[1]
    (left, top), (right, bottom) = (EYE.project(p, aspect)[:2] for p in ((-0.5, 0.5, 0.0), (0.5, -0.5, 0.0)))
    y, x = (k.reshape(-1) for k in np.mgrid[0 : SIZE[1] : step, 0 : SIZE[0] : step])
    u = ((x + 0.5) / SIZE[0] - left) / (right - left)
    v = ((y + 0.5) / SIZE[1] - top) / (bottom - top)
    within = (np.abs(u - 0.5) < 0.48) & (np.abs(v - 0.5) < 0.48)
    assert within.sum() > 50
    return picture[y[within], x[within]].astype(int), np.stack([u, v], axis=1)[within]


def exact(texture, uv):
    """Return the linear colour (n, 3) of a texture as `render` sees it from near."""
    return lookup(texture, uv, *(np.full((2, len(uv), 2), 1e-6)))


@pytest.mark.gl
def test_a_texture_colours_each_pixel(draw):
    """At each pixel: the texture there times the tint times E / pi, plus what the front emits by itself."""
    tint, glow = np.array([0.9, 0.5, 1.0]), np.array([0.05, 0.0, 0.1])
    texture = Texture(PIXELS, ("clamp", "clamp"))
    shown = [poster(texture, tint=tuple(tint), emission=tuple(glow))]
    pixels, at = inside(draw(shown, tone_map="clip"))
    assert np.abs(pixels - to_display(tint * exact(texture, at) + glow, 0.0, "clip").astype(int)).max() <= 3
    pixels, at = inside(draw(shown, [HALF_TURN], tone_map="clip"))
    rho = exact(texture, [1, 0] + [-1, 1] * at)
    assert np.abs(pixels - to_display(0.5 * tint * rho, 0.0, "clip").astype(int)).max() <= 3


@pytest.mark.gl
def test_without_reflectance_there_is_no_texture(draw):
    pixels, _ = inside(draw([poster(Texture(PIXELS))], tone_map="clip", textured=False))
    assert (pixels == 255).all()


@pytest.mark.gl
@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_beyond_its_edges_a_texture_is_wrapped(draw, wrap):
    """Coordinates from -1 to 2, the image three times each way: again, mirrored, or its last column and row."""
    texture = Texture(PIXELS, (wrap, "repeat"))
    uv = 3 * np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float) - 1
    pixels, at = inside(draw([poster(texture, uv)], tone_map="clip"), step=3)
    assert np.abs(pixels - to_display(exact(texture, 3 * at - 1), 0.0, "clip").astype(int)).max() <= 4


@pytest.mark.gl
def test_from_afar_a_texture_shows_its_mean(draw):
    """Sixty-four checks a pixel: not black or white, but what they reflect together."""
    checks = (255 * (np.indices((64, 64)).sum(axis=0) % 2)).astype(np.uint8)[..., None].repeat(3, axis=2)
    uv = 10 * np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float)
    drawn = draw([poster(Texture(checks), uv)], tone_map="clip")
    middle_part = drawn[SIZE[1] // 2 - 10 : SIZE[1] // 2 + 10, SIZE[0] // 2 - 10 : SIZE[0] // 2 + 10].astype(int)
    assert np.abs(middle_part - int(to_display(np.full(3, 0.5), 0.0, "clip")[0])).max() <= 2


@pytest.mark.gl
def test_textures_and_plain_faces_side_by_side(draw):
    """Two textures, a plain square and a one-sided textured one, in one object and in several."""
    red, blue = (Texture(np.full((2, 2, 3), c, np.uint8)) for c in ((255, 0, 0), (0, 0, 255)))
    places = [(-0.6, 0, 0), (0, 0, 0), (0.6, 0, 0)]
    models = []
    for at in places:
        M = np.diag([0.4, 0.4, 0.4, 1.0])
        M[:3, 3] = at
        models.append(M)
    drawn = draw([poster(red), square((0, 1, 0)), poster(blue)], models, tone_map="clip")
    for at, channel in zip(places, range(3), strict=True):
        u, v = EYE.project(at, SIZE[0] / SIZE[1])
        pixel = drawn[int(v * SIZE[1]), int(u * SIZE[0])].astype(int)
        assert pixel[channel] > 240 and pixel.sum() - pixel[channel] < 10

    def column(k, kind):
        (mesh, front, back), shift = kind, np.float32([0.4 * k - 0.4, 0, 0])
        return mesh._replace(positions=mesh.positions * np.float32([0.4, 0.4, 1]) + shift), front, back

    parts = [column(k, kind) for k, kind in enumerate((poster(red), square((0, 1, 0), (0, 1, 0)), poster(blue)))]
    n = len(parts[0][1])
    together = DrawMesh(
        *(np.concatenate([getattr(m, name) for m, _, _ in parts]) for name in ("positions",)),
        np.concatenate([m.triangles + n * k for k, (m, _, _) in enumerate(parts)]).astype(np.int32),
        *(np.concatenate([getattr(m, name) for m, _, _ in parts]) for name in ("front", "back")),
        *(np.concatenate([getattr(m, name) for m, _, _ in parts]) for name in ("reflectance", "emission")),
        (red, blue),
        np.repeat([0, -1, 1], n).astype(np.int32),
        np.zeros((3 * n, 2), np.float32),
        np.ones((3 * n, 3)),
    )
    colours_of = [np.concatenate([part[side] for part in parts]) for side in (1, 2)]
    one = draw([(together, *colours_of)], tone_map="clip")
    for k in range(3):
        u, v = EYE.project((0.4 * k - 0.4, 0, 0), SIZE[0] / SIZE[1])
        pixel = one[int(v * SIZE[1]), int(u * SIZE[0])].astype(int)
        assert pixel[k] > 240 and pixel.sum() - pixel[k] < 10


@pytest.mark.gl
def test_textures_are_given_back_and_shared(ctx):
    from app.gl_textures import GLTextures

    a, b = Texture(PIXELS), Texture(PIXELS[:2])
    textures = GLTextures(ctx)
    textures.keep([a, b, a])
    first = textures.of(a)
    textures.keep([a])
    assert textures.of(a) is first
    with pytest.raises(KeyError):
        textures.of(b)
    textures.keep([])
    assert ctx.error == "GL_NO_ERROR"


def picking_scene(two_sided=False) -> Scene:
    """A closed one-sided box seen from outside, with a mobile ball-like box within."""
    walls = support.mesh(support.box((-1, -1, -1), (1, 1, 1), 0, 12, inward=True))
    inner = support.mesh(support.box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2), 1, 3))
    pose = Pose((0.3, 0.1, -0.2), axis_angle((0.3, 1, 0.2), 35))
    materials = (Material("wall", two_sided=two_sided), Material("block"))
    return Scene(walls, materials, (Mobile("block", inner, pose),))


@pytest.mark.parametrize("cull", [True, False])
@pytest.mark.parametrize("two_sided", [True, False])
def test_picking_meets_what_a_loop_over_all_triangles_meets(cull, two_sided):
    scene = picking_scene(two_sided)
    surfaces, _ = flatten(scene)
    poses = [m.pose for m in scene.mobiles]
    picker = Picker(surfaces)
    rng = np.random.default_rng(1)
    met = set()
    for _ in range(25):
        origin = rng.normal(size=3)
        origin *= 3 / np.linalg.norm(origin)
        direction = rng.normal(size=3) * 0.25 - origin / 3
        direction /= np.linalg.norm(direction)
        hit = picker.pick(origin, direction, poses, cull)
        expected = pick_naively(surfaces, origin, direction, poses, cull)
        assert (hit is None) == (expected is None)
        if hit is not None:
            assert hit.object == expected[1] and hit.distance == pytest.approx(expected[0])
            assert np.allclose(hit.point, origin + hit.distance * direction)
            met.add(hit.object)
    assert met == ({0, 1} if cull and not two_sided else {0}), "through a culled wall the mobile can be grabbed"


def pick_naively(surfaces, origin, direction, poses, cull):
    best = None
    for o in range(surfaces.objects):
        vertices = surfaces.vertices[o]
        if o:
            vertices = vertices @ rotation(poses[o - 1]).T + poses[o - 1].position
        for f, face in enumerate(surfaces.faces[o]):
            a, b, c = vertices[face]
            A = np.stack([a - b, a - c, direction], axis=1)
            if abs(np.linalg.det(A)) < 1e-12:
                continue
            beta, gamma, t = np.linalg.solve(A, a - origin)
            back = np.cross(b - a, c - a) @ direction > 0
            if cull and back and not surfaces.two_sided[surfaces.first_face[o] + f]:
                continue
            if beta >= 0 and gamma >= 0 and beta + gamma <= 1 and t > 0 and (best is None or t < best[0]):
                best = (t, o)
    return best


def test_picking_along_axes_and_in_an_empty_scene():
    scene = picking_scene()
    picker = Picker(flatten(scene)[0])
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        assert picker.pick(-3 * axis + 0.013, axis, [scene.mobiles[0].pose], True).distance > 2
    nothing = Scene(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int32)), ())
    assert Picker(flatten(nothing)[0]).pick(np.zeros(3), np.array([0, 0, 1.0]), [], True) is None


@pytest.mark.gl
def test_picking_sees_what_is_drawn(draw):
    """At pixel centres away from edges, the picked object's colour is the colour on the screen."""
    scene = picking_scene()
    surfaces, receivers = flatten(scene)
    meshes = draw_meshes(surfaces)
    paint = [np.float32((0.9, 0, 0)), np.float32((0, 0, 0.9))]
    objects = [
        (m, np.tile(c, (len(m.positions), 1)), np.zeros((len(m.positions), 3)))
        for m, c in zip(meshes, paint, strict=True)
    ]
    model = IDENTITY.copy()
    pose = scene.mobiles[0].pose
    model[:3, :3], model[:3, 3] = rotation(pose), pose.position
    camera = from_camera(Camera((2.5, 1.5, 3.5), (0, 0, 0), 40.0), (0, 1, 0), Bounds((-1, -1, -1), (1, 1, 1)))
    picture = draw(objects, [IDENTITY, model], camera=camera, tone_map="clip")
    picker = Picker(surfaces)
    wrong = 0
    for y in range(1, SIZE[1], 5):
        for x in range(1, SIZE[0], 5):
            ray = camera.ray((x + 0.5) / SIZE[0], (y + 0.5) / SIZE[1], SIZE[0] / SIZE[1])
            hit = picker.pick(*ray, [pose], True)
            seen = picture[y, x].astype(int)
            drawn = None if np.array_equal(seen, background()) else int(seen[2] > seen[0])
            wrong += drawn != (None if hit is None else hit.object)
    assert wrong <= 2, "only where an edge runs through the pixel's centre"


def test_colours_of_a_frame_are_taken_from_the_receivers():
    surfaces, receivers = flatten(support.room(2))
    E = np.arange(3.0 * len(receivers.areas)).reshape(-1, 3)
    mesh = draw_meshes(surfaces)[1]
    front, _ = colours(mesh, E)
    assert np.allclose(front, mesh.reflectance * E[mesh.front] / np.pi + mesh.emission)


@pytest.mark.gl
@pytest.mark.parametrize("samples", [1, 4])
def test_a_split_shows_one_layer_left_and_the_other_right(ctx, samples):
    """A square across the middle, red in one layer and blue in the other, ready for the display."""
    from app.renderer import Look, Renderer

    mesh, front, back = square((0.8, 0.1, 0.1))
    renderer = Renderer(ctx, samples)
    renderer.set_scene((mesh,))
    renderer.set_colours(0, front, back)
    renderer.set_colours(0, np.tile(np.float32((0.1, 0.2, 0.9)), (4, 1)), back, 1)
    renderer.resize(*SIZE)
    to_clip = EYE.projection(SIZE[0] / SIZE[1]) @ EYE.view()
    seen = {}
    for split in (None, 0.4, 0.0, 1.0):
        renderer.draw(Look(to_clip, (IDENTITY,), exposure=3.0, as_is=True, split=split))
        seen[split] = renderer.pixels()[SIZE[1] // 2].astype(int)
    left, right = np.round(255 * np.array([[0.8, 0.1, 0.1], [0.1, 0.2, 0.9]]))
    at = round(0.4 * SIZE[0])
    inside = np.flatnonzero((np.abs(seen[None] - left) <= 1).all(axis=1))
    assert len(inside) > 20 and inside[0] < at < inside[-1], "as it is: exposure and tone map are not asked"
    for x in inside:
        assert seen[0.4][x] == pytest.approx(left if x < at else right, abs=1)
    assert seen[0.0][inside] == pytest.approx(np.tile(right, (len(inside), 1)), abs=1)
    assert (seen[1.0] == seen[None]).all()
    assert (seen[0.4][[0, -1]] == background()).all(), "both parts are cleared"
    renderer.release()
    assert ctx.error == "GL_NO_ERROR"
