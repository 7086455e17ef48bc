"""The renderer, pixel by pixel, in a context without a window."""

import numpy as np
import pytest
from PIL import Image

from app.draw.draw_mesh import DrawMesh, draw_meshes
from app.draw.false_colour import Scale, false_colours
from app.draw.picture_files import screenshot, write_png
from app.draw.renderer import Look, Renderer
from app.draw.shot import Shot
from app.draw.tonemap import TONE_MAPS, to_display
from app.draw.vertex_colours import colours
from app.settings import Settings, make_solver
from gi_core.geometry.surfaces import flatten
from gi_core.scene import Pose
from gi_core.scene.pose import axis_angle, rotation
from tests.support import viewer_support as support
from tests.support.gl_drawing import EYE, HALF_TURN, IDENTITY, SIZE, background, middle, square
from tests.support.scene_builders import complete


@pytest.mark.gl
@pytest.mark.parametrize("tone_map", TONE_MAPS)
@pytest.mark.parametrize("exposure", [-3.0, 0.0, 2.5])
def test_pixels_are_those_of_the_picture_without_a_window(draw, tone_map, exposure):
    """One arithmetic in two languages: they differ by at most one 8-bit step, from black over 1e-4 to saturation."""
    for radiance in [(0, 0, 0), (1e-4, 2e-3, 0.03), (0.2, 0.5, 0.9), (3.0, 0.4, 40.0)]:
        got = middle(draw([square(radiance)], tone_map=tone_map, exposure=exposure))
        expected = to_display(np.array(radiance, float), exposure, tone_map).astype(int)
        assert np.abs(got - expected).max() <= 1, (radiance, got, expected)


@pytest.mark.gl
@pytest.mark.parametrize(
    "scale",
    [Scale(0.0, 3.0, False), Scale(0.5, 2.0, False), Scale(0.01, 10.0, True), Scale(0.0, 2.0, False, (), "luminance")],
)
def test_false_colours_are_those_of_the_picture_without_a_window(draw, scale):
    for radiance in [(0, 0, 0), (1e-4, 2e-3, 0.03), (0.2, 0.5, 0.9), (0.3, 0.3, 0.3), (3.0, 0.4, 40.0)]:
        got = middle(draw([square(radiance)], exposure=2.0, scale=scale))
        expected = false_colours(np.array([radiance], float), scale)[0].astype(int)
        assert np.abs(got - expected).max() <= 1, (radiance, got, expected)


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
def test_vertices_of_small_weight_hardly_count(ctx):
    """A square, dark on the left; each side has separate weights."""
    mesh, front, back = square((0, 0, 0), (0, 0, 0))
    left = mesh.positions[:, 0] < 0
    front[~left], back[~left] = 0.25, 0.25
    weights = np.ones((4, 2), np.float32)
    weights[left, 1] = 1e-3
    renderer = Renderer(ctx)
    renderer.set_scene((mesh,))
    renderer.set_colours(0, front, back, weights=weights)
    renderer.resize(*SIZE)
    for model, radiance in ((IDENTITY, 0.125), (HALF_TURN, 0.25)):
        renderer.draw(Look(EYE.projection(SIZE[0] / SIZE[1]) @ EYE.view(), (model,), tone_map="clip"))
        assert middle(renderer.pixels()) == pytest.approx(to_display(np.full(3, radiance), 0, "clip"), abs=2)


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
def test_the_outline_is_outside_the_object(draw):
    bare = draw([square((0.3, 0.3, 0.3))])
    outlined = draw([square((0.3, 0.3, 0.3))], outlined=(0,))
    changed = (bare != outlined).any(axis=2)
    inside = (bare != background().astype(np.uint8)).any(axis=2)
    assert changed.any() and not (changed & inside).any()


@pytest.mark.gl
@pytest.mark.parametrize("faces", [[0], [0, 1]])
def test_the_outline_of_a_surface_is_round_its_visible_part(draw, faces):
    """Faces of the static part, behind an object: the line is on the object and beside the faces, never on them."""
    scene = [square((0.3, 0.3, 0.3), half=0.5), square((0.9, 0.1, 0.1), half=0.2, z=0.3)]
    bare = draw(scene, tone_map="clip")
    outlined = draw(scene, surface=np.array(faces), tone_map="clip")
    changed = (bare != outlined).any(axis=2)
    grey = (bare[..., 0] == bare[..., 1]) & (bare[..., 0] > 100)
    red = (bare[..., 0] > 100) & ~grey
    if len(faces) == 2:
        assert changed.any() and not (changed & grey).any()
    else:
        assert (changed & grey).any(), "along the diagonal, on the other triangle"
    assert (changed & red).any() and (changed & ~grey & ~red).any()
    culled = draw([square((0.3, 0.3, 0.3))], [HALF_TURN], surface=np.array(faces), cull=True)
    assert (culled == background()).all()


@pytest.mark.gl
def test_resizing_frees_the_last_size_and_an_empty_object_draws_nothing(ctx, monkeypatch):
    freed, free = [], ctx.gc
    monkeypatch.setattr(ctx, "gc", lambda: freed.append(free()))
    empty = DrawMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros(0, np.int32),
                     np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 3)))  # fmt: skip
    renderer = Renderer(ctx)
    renderer.set_scene((empty,))
    renderer.set_colours(0, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32))
    for k in range(20):
        renderer.resize(50 + k, 40)
        renderer.draw(Look(IDENTITY, (IDENTITY,)))
        assert ctx.error == "GL_NO_ERROR" and not ctx.objects
    assert sum(freed) >= 19 * 8, "two or three framebuffers, and five or six images of them"
    assert renderer.pixels().shape == (40, 69, 3)
    assert (renderer.pixels() == background()).all()
    renderer.resize(0, 0)
    assert renderer.size == (1, 1)
    assert ctx.error == "GL_NO_ERROR"


def test_vertex_colours_come_from_the_receivers():
    surfaces, receivers = flatten(support.room(2))
    E = np.arange(3.0 * len(receivers.areas)).reshape(-1, 3)
    mesh = draw_meshes(surfaces)[1]
    front, _ = colours(mesh, E)
    assert np.allclose(front, mesh.reflectance * E[mesh.front] / np.pi + mesh.emission)


@pytest.mark.gl
def test_geometry_is_uploaded_once(ctx):
    """Other emission is no other geometry; a moved vertex is."""
    mesh, *_ = square((0.8, 0.1, 0.1))
    renderer = Renderer(ctx)
    renderer.set_scene((mesh,))
    (drawn,) = renderer._objects
    renderer.set_scene((mesh._replace(emission=mesh.emission + 1.0),))
    assert renderer._objects == [drawn]
    for others in ((mesh._replace(positions=mesh.positions * 2),), (mesh, mesh)):
        renderer.set_scene(others)
        assert drawn not in renderer._objects and len(renderer._objects) == len(others)
    assert ctx.error == "GL_NO_ERROR"


@pytest.mark.gl
@pytest.mark.parametrize("scale", [1, 2, 4])
def test_saved_pictures_have_the_size_asked_for(scale, tmp_path):
    """Block means are the picture at 1x, but for edges; the viewport keeps its size."""
    solver = complete(make_solver(support.room(), Settings(photons=2000, radius=0.06)))
    shot, ctx = Shot(solver, Settings(size=(64, 48))), support.standalone_context()
    drawing = Renderer(ctx)
    try:
        drawing.set_scene(shot.lit.meshes)
        for o, colours in enumerate(shot.lit.sides):
            drawing.set_colours(o, *colours, weights=shot.lit.weights[o])
        drawing.resize(64, 48)
        look = Look(shot.camera.projection(64 / 48) @ shot.camera.view(), (np.eye(4),) * 2, 0.0, "clip", True)
        paths = [write_png(tmp_path / f"{k}.png", screenshot(drawing, look, None, k)) for k in (1, scale)]
        assert drawing.size == (64, 48)
    finally:
        ctx.release()
    small, large = (np.array(Image.open(path).convert("RGB")).astype(float) for path in paths)
    assert large.shape == (48 * scale, 64 * scale, 3)
    blocks = large.reshape(48, scale, 64, scale, 3).mean(axis=(1, 3))
    apart = np.abs(blocks - small).max(axis=2)
    assert np.median(apart) < 1 and apart.mean() < 4 and small.std() > 20


@pytest.mark.gl
def test_objects_that_an_edit_keeps_are_not_uploaded_again(ctx):
    """The picture is that of a new renderer, and the buffers of the other object stay."""
    (first, *light), (second, *other), (third, *new) = (
        square((0.2 * k, 0.5, 0.1), half=0.2, z=0.1 * k) for k in range(3)
    )
    look = Look(EYE.projection(SIZE[0] / SIZE[1]) @ EYE.view(), (IDENTITY, IDENTITY), tone_map="clip")
    pictures = []
    drawing = Renderer(ctx)
    for renderer, sets in ((drawing, ((first, second), (first, third))), (Renderer(ctx), ((first, third),))):
        renderer.resize(*SIZE)
        for meshes in sets:
            known = renderer._objects[:1]
            renderer.set_scene(meshes)
            assert renderer._objects[:1] == known or not known
            renderer.set_colours(0, *light)
            renderer.set_colours(1, *(new if meshes[1] is third else other))
        renderer.draw(look)
        pictures.append(renderer.pixels().copy())
    np.testing.assert_array_equal(*pictures)
