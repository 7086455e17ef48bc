"""Edges in pictures of one sample per pixel, against pictures of 64."""

import numpy as np
import pytest

from app.draw.draw_mesh import DrawMesh
from app.draw.gl_targets import smooth_edges
from app.draw.renderer import Look, Renderer
from gi_core.display.edges import edges_of
from gi_core.scene import Pose, Texture
from gi_core.scene.pose import axis_angle, rotation
from tests.support.gl_drawing import EYE, IDENTITY, SIZE
from tests.support.scene_builders import box, merge, quad, sphere

VIEW = EYE.projection(SIZE[0] / SIZE[1]) @ EYE.view()
CHECKS = Texture(np.kron(np.array([[40, 200], [200, 40]], np.uint8), np.ones((8, 8), np.uint8))[..., None].repeat(3, 2))
WALL = quad((-3, -3, -0.5), (6, 0, 0), (0, 6, 0), (4, 4))


def solid(mesh, tint=1.0, texture=None, glass=False, smooth=False):
    """Return a draw mesh whose faces are as bright as their normals are turned, and its light."""
    points, faces = mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces), dtype=np.int32)
    a, b, c = (points[k::3] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    joined, at = np.unique(
        np.c_[points, (points / np.linalg.norm(points, axis=1)[:, None] if smooth else normal.repeat(3, axis=0))].round(
            9
        ),
        axis=0,
        return_inverse=True,
    )
    faces, n = at.reshape(-1)[faces].reshape(-1, 3).astype(np.int32), len(joined)
    places, light = joined[:, :3].astype(np.float32), tint * (0.5 + 0.4 * joined[:, 3:] @ (0.5, 0.7, 0.5))
    none = np.zeros(n, np.int32)
    made = DrawMesh(places, faces, none, none - 1, np.zeros((n, 3)), np.zeros((n, 3)))
    made = made._replace(edges=edges_of(places, faces, np.zeros(len(faces), bool)))
    if texture is not None:
        made = made._replace(textures=(texture,), texture=none, uv=places[:, :2] * 2, texel=np.full((n, 3), 0.3))
    if glass:
        made = made._replace(
            pane=np.tile(np.float32((0.8, 0.9, 0.8, 1.5)), (n, 1)), edges=edges_of(places, faces[:0], faces[:0, 0])
        )
    front = np.tile(np.float32(light)[:, None], (1, 3))
    return made, front, np.zeros_like(front)


def turned(axis, degrees, position=(0.0, 0.0, 0.0)):
    model = IDENTITY.copy()
    model[:3, :3], model[:3, 3] = rotation(Pose(quaternion=axis_angle(axis, degrees))), position
    return model


@pytest.fixture
def pictures(ctx):
    """Return a function that draws objects: with smooth edges, without, and the mean of 64 samples."""

    def draw(objects, models=None, view=VIEW):
        renderer = Renderer(ctx, 1)
        renderer.set_scene(tuple(mesh for mesh, _, _ in objects))
        for o, (_, front, back) in enumerate(objects):
            renderer.set_colours(o, front, back)
        look = Look(view, tuple(models or [IDENTITY] * len(objects)), tone_map="clip", eye=EYE.eye())
        out = []
        for scale, samples, smooth in ((1, 1, smooth_edges), (1, 1, lambda *_: None), (4, 4, smooth_edges)):
            renderer.resize(scale * SIZE[0], scale * SIZE[1], samples)
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("app.draw.renderer.smooth_edges", smooth)
                renderer.draw(look)
            out.append(renderer.pixels().reshape(SIZE[1], scale, SIZE[0], scale, 3).astype(float).mean(axis=(1, 3)))
        return out

    yield draw
    assert ctx.error == "GL_NO_ERROR"


def errors_at_edges(smooth, plain, truth):
    """Return the mean errors, smooth and plain, of pixels that samples show otherwise than one sample does."""
    edge = np.abs(plain - truth).max(axis=2) > 3
    assert edge.sum() > 60
    return [np.abs(picture - truth)[edge].mean() for picture in (smooth, plain)]


BLOCK = box((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3))
FLOOR = quad((-2, -0.3, 0.9), (4, 0, 0), (0, 0.2, -3), (1, 1))
CASES = {
    "static": ([solid(merge(WALL, BLOCK))], [turned((1, 2, 0.4), 20)]),
    "mobile": ([solid(WALL), solid(BLOCK)], [IDENTITY, turned((1, 2, 0.4), 33, (0.1, 0.02, 0.0))]),
    "textured": ([solid(WALL), solid(BLOCK, texture=CHECKS)], [IDENTITY, turned((1, 2, 0.4), 33)]),
    "round": ([solid(WALL), solid(sphere((0, 0, 0), 0.35, 3), 0.5, smooth=True)], None),
    "against the background": ([solid(BLOCK)], [turned((1, 2, 0.4), 33)]),
    "on a floor": ([solid(FLOOR), solid(box((-0.4, -0.35, 0.0), (0.2, 0.1, 0.3)))], [IDENTITY, turned((0, 1, 0), 20)]),
    "behind glass": (
        [solid(WALL), solid(BLOCK), solid(quad((-2, -2, 0.6), (4, 0, 0), (0, 4, 0)), glass=True)],
        [IDENTITY, turned((1, 2, 0.4), 33), IDENTITY],
    ),
}  # fmt: skip


@pytest.mark.gl
@pytest.mark.parametrize("case", CASES)
def test_edges_are_those_of_many_samples(pictures, case):
    now, before = errors_at_edges(*pictures(*CASES[case]))
    assert now < (0.5 if case == "textured" else 0.25) * before


@pytest.mark.gl
def test_only_pixels_at_edges_change(pictures):
    smooth, plain, truth = pictures(*CASES["mobile"])
    inside = np.abs(plain - truth).max(axis=2) < 0.3
    assert inside.sum() > 5000 and np.abs(smooth - plain)[inside].max() <= 3


@pytest.mark.gl
@pytest.mark.parametrize("angle", [0.0, 0.7, 12.0, 44.0])
@pytest.mark.parametrize("pixels", [0.25, 0.5, 0.8])
def test_a_line_thinner_than_a_pixel_is_unbroken(pictures, angle, pixels):
    pixel = 2 * 2 * np.tan(np.radians(20)) / SIZE[1]  # [m], where the line is
    half = 0.5 * pixels * pixel
    line = solid(box((-half, -0.5, -half), (half, 0.5, half)), tint=0.0)
    smooth, _, truth = pictures([solid(WALL), line], [IDENTITY, turned((0, 0, 1), angle, (0.013, 0.0, 0.0))])
    empty, _, _ = pictures([solid(WALL)])
    rows = slice(SIZE[1] // 2 - 15, SIZE[1] // 2 + 15)
    drawn, wanted = ((empty - picture)[rows, :, 0].sum(axis=1) for picture in (smooth, truth))
    assert wanted.min() > 20
    assert drawn.min() > 0.4 * wanted.mean() and drawn.max() < 1.8 * wanted.mean()
    assert drawn.mean() == pytest.approx(wanted.mean(), rel=0.35)


@pytest.mark.gl
@pytest.mark.parametrize("angle", [2.0, 12.0, 30.0])
@pytest.mark.parametrize("pixels", [0.3, 0.6])
def test_a_groove_narrower_than_a_pixel_is_unbroken(pictures, angle, pixels):
    half = 0.5 * pixels * 4 * np.tan(np.radians(20)) / SIZE[1]
    tiles = merge(*(quad((x, -2, 0), (2, 0, 0), (0, 4, 0)) for x in (half, -half - 2)))
    models = [turned((0, 0, 1), angle, (0.013, 0.0, 0.0))] * 2
    smooth, plain, truth = pictures([solid(WALL, 0.05), solid(tiles)], models)
    rows = slice(SIZE[1] // 2 - 15, SIZE[1] // 2 + 15)
    (drawn, once, wanted) = ((picture[0, 0, 0] - picture[rows, :, 0]).sum(axis=1) for picture in (smooth, plain, truth))
    assert once.min() == 0, "one sample misses it in some rows"
    assert drawn.min() > 0.5 * wanted.mean() and drawn.max() < 1.7 * wanted.mean()


@pytest.mark.gl
def test_hidden_edges_leave_no_line(pictures):
    curtain = solid(quad((-2, -2, 0.6), (4, 0, 0), (0, 4, 0), (3, 3)))
    models = [IDENTITY, turned((1, 2, 0.4), 33, (0.1, 0.02, 0.0)), IDENTITY]
    covered, *_ = pictures([solid(WALL), solid(BLOCK, 0.1), curtain], models)
    alone, *_ = pictures([curtain])
    np.testing.assert_array_equal(covered, alone)


@pytest.mark.gl
def test_a_slow_drag_does_not_flicker(pictures):
    """From frame to frame, pixels change as those of many samples do; one sample jumps by whole contrasts."""
    frames = []
    for k in range(10):
        frames.append(pictures(CASES["mobile"][0], [IDENTITY, turned((1, 2, 0.4), 33, (0.002 * k, 0.001 * k, 0.0))]))
    smooth, plain, truth = (np.array(f) for f in zip(*frames, strict=True))
    moving = np.ptp(truth, axis=0).max(axis=2) > 8
    jumps = [np.abs(np.diff(f, axis=0) - np.diff(truth, axis=0)).max(axis=(0, 3))[moving] for f in (smooth, plain)]
    assert moving.sum() > 100
    assert np.percentile(jumps[0], 95) < 0.35 * np.percentile(jumps[1], 95)


def test_a_cube_has_twelve_edges_and_a_ball_only_folds():
    cube, ball = box((0, 0, 0), (1, 1, 1), 3), sphere((0, 0, 0), 1.0, 2)
    edges = solid(cube)[0].edges
    lengths = np.linalg.norm(edges.points[:, 1] - edges.points[:, 0], axis=1)
    assert len(edges.fold) == 36 and not edges.fold.any() and lengths.sum() == pytest.approx(12, rel=1e-5)
    smooth = edges_of(ball.vertices.astype(np.float32), ball.faces, np.zeros(len(ball.faces), bool))
    assert len(smooth.fold) == 1.5 * len(ball.faces) and smooth.fold.all()
    assert len(edges_of(cube.vertices.astype(np.float32), cube.faces[:0], np.zeros(0, bool)).fold) == 0
