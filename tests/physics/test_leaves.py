"""Holes of textures: light passes them texel by texel, as the eye does."""

import numpy as np
import pytest

from gi_core.gather.reference import reference_irradiance
from gi_core.model import Model
from gi_core.scene.types import DirectionalLight, Material, Mesh, Mobile, Paint, Pane, Pose, Scene, Texture
from tests.support.scene_builders import grey, quad, solve

UP = (0.0, 0.0, 1.0)


def screen(cover: np.ndarray, size=1.0, height=0.0, repeats=1.0, **texture) -> Mesh:
    """Return a square with one image of holes, of one material."""
    mesh = quad((0, 0, height), (size, 0, 0), (0, size, 0), (1, 1), 0)
    image = Texture(np.full((*cover.shape, 3), 255, np.uint8), cover=cover, **texture)
    place = (mesh.vertices[mesh.faces][..., :2] / size * repeats).astype(np.float32)
    faces = len(mesh.faces)
    white = np.full((faces, 3, 3), 0.5, np.float32)
    return mesh._replace(paint=Paint((image,), np.zeros(faces, np.int32), place, white))


def blots(n: int, seed: int) -> np.ndarray:
    return np.where(np.random.default_rng(seed).random((n, n + 2)) < 0.4, 0, 255).astype(np.uint8)


INTO = {
    "repeat": lambda i, n: i % n,
    "mirror": lambda i, n: min(i % (2 * n), 2 * n - 1 - i % (2 * n)),
    "clamp": lambda i, n: min(max(i, 0), n - 1),
}


def covered(texture: Texture, uv: np.ndarray) -> np.ndarray:
    """Return where the bilinear cover (n,) of the image, laid out by its wraps, is there."""
    (h, w), (across, along), out = texture.cover.shape, texture.wrap, []
    for u, v in uv:
        x, y = (np.floor(k + 0.5) if texture.nearest else k for k in (u * w - 0.5, v * h - 0.5))
        i, j = int(np.floor(x)), int(np.floor(y))
        rows, columns = ([INTO[way](k + a, n) for a in (0, 1)] for way, k, n in ((along, j, h), (across, i, w)))
        out.append([1 - (y - j), y - j] @ texture.cover[np.ix_(rows, columns)].astype(float) @ [1 - (x - i), x - i])
    return np.array(out) >= 127.5


@pytest.mark.parametrize("nearest", [True, False])
@pytest.mark.parametrize("wrap", [("repeat", "repeat"), ("mirror", "clamp"), ("clamp", "mirror")])
@pytest.mark.parametrize("rays", ["embree", "bvh"])
def test_rays_meet_what_is_covered(nearest, wrap, rays):
    """Also in a scene with panes; kernels of whole frames for both compile for 20 s."""
    mesh = screen(blots(7, 3), repeats=2.5, wrap=wrap, nearest=nearest)
    pane = Mobile("pane", quad((0, 0, 0), (1, 0, 0), (0, 1, 0), material=1))
    mobiles, glass = (pane,) * (rays == "bvh"), Material("glass").as_pane(Pane())
    model = Model(Scene(mesh, (grey(0.5), glass), mobiles, (), up=UP, name="leaf"), rays=rays)
    at = np.random.default_rng(5).random((4000, 2)).astype(np.float32)
    origins = np.concatenate([at, np.ones((4000, 1))], axis=1).astype(np.float32)
    down = np.tile(np.float32((0, 0, -1)), (4000, 1))
    limits = np.full(4000, 3.0, np.float32)
    t, face = model.accelerator.nearest(0, origins, down, limits)
    solid = covered(mesh.paint.textures[0], at.astype(np.float64) * 2.5)
    off = (face >= 0) != solid
    assert off.mean() < 2e-3, "rounding at borders of texels"
    np.testing.assert_array_equal(t[face >= 0], 1.0)
    np.testing.assert_array_equal(model.accelerator.occluded(0, origins, down, limits), face >= 0)
    if mobiles:
        inside = (at > 0.001).all(axis=1) & (at < 0.999).all(axis=1)
        assert (model.accelerator.nearest(1, origins, down, limits)[1][inside] >= 0).all(), "a pane has no holes"
    assert 0.3 < solid.mean() < 0.9


def shaded(share: float, mobile: bool) -> tuple[Scene, float]:
    """Return a floor under the sun behind a screen of so many holes, and the share of light that passes."""
    n = 64
    cover = np.where((np.arange(n)[None] * 7 + np.arange(n)[:, None] * 5) % 10 < 10 * share, 0, 255).astype(np.uint8)
    leaf = screen(cover, 2.0, 0.0 if mobile else 0.5, 4.0, nearest=True)
    floor = quad((0.5, 0.5, 0), (1, 0, 0), (0, 1, 0), (4, 4), 1)
    sun = DirectionalLight("sun", (0.0, 0.0, -1.0), (10.0, 10.0, 10.0), 0.0)
    materials = (Material("leaf", (0.5, 0.5, 0.5), two_sided=True), grey(0.0))
    passes = float((cover == 0).mean())
    if mobile:
        moved = Mobile("leaf", leaf._replace(vertices=leaf.vertices - (1, 1, 0)), Pose((1.0, 1.0, 0.5)))
        return Scene(floor, materials, (moved,), (sun,), up=UP, name="shade"), passes
    faces = np.concatenate([leaf.faces, floor.faces + len(leaf.vertices)])
    own = Paint(
        leaf.paint.textures,
        np.concatenate([leaf.paint.face_texture, np.full(len(floor.faces), -1, np.int32)]),
        np.concatenate([leaf.paint.corner_uv, np.zeros((len(floor.faces), 3, 2), np.float32)]),
        np.concatenate([leaf.paint.corner_colour, np.zeros((len(floor.faces), 3, 3), np.float32)]),
    )
    kind = np.concatenate([leaf.face_material, np.ones(len(floor.faces), np.int32)])
    static = Mesh(np.concatenate([leaf.vertices, floor.vertices]), faces, kind, paint=own)
    return Scene(static, materials, (), (sun,), up=UP, name="shade"), passes


@pytest.mark.parametrize("mobile", [False, True])
@pytest.mark.parametrize("share", [0.2, 0.7])
def test_a_shadow_is_as_dark_as_the_leaf_is_covered(share, mobile):
    scene, passes = shaded(share, mobile)
    solver = solve(scene, photons=200_000, radius=0.3, light="photons")
    r = solver.receivers
    floor = (r.positions[:, 2] < 0.1) & (np.abs(r.positions[:, :2] - 1).max(axis=1) < 0.3)
    assert solver.irradiance[floor, 0].mean() == pytest.approx(10 * passes, rel=0.03)
    points = np.random.default_rng(2).random((3000, 3)) * (0.8, 0.8, 0) + (0.6, 0.6, 0)
    E, _ = reference_irradiance(scene, points, np.tile(UP, (3000, 1)), 1, 1)
    assert E[:, 0].mean() == pytest.approx(10 * passes, rel=0.06)
    assert set(np.round(E[:, 0], 6)) == {0.0, 10.0}, "each point is in a hole or in the shade"


def test_frames_of_a_leaf_equal_those_from_scratch():
    scene, _ = shaded(0.5, mobile=True)
    solver = solve(scene, photons=3000, radius=0.3, light="best", seed=11)
    for place in ((1.2, 1.0, 0.4), (1.0, 1.3, 0.0), (1.0, 1.0, 0.5)):
        solver.move("leaf", Pose(place))
        assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_other_holes_are_another_way_of_rays():
    def key(cover: np.ndarray, **changes) -> str:
        return Model(Scene(screen(cover, **changes), (grey(0.5),), (), (), up=UP, name="leaf")).static_rays_key

    holes, first = blots(7, 3), key(blots(7, 3))
    assert key(holes) == first
    others = [key(blots(7, 4)), key(holes, repeats=2.0), key(holes, wrap=("clamp", "clamp")), key(holes, nearest=True)]
    assert len({first, *others, key(np.full((7, 9), 255, np.uint8))}) == 6
