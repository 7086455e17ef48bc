"""Textures: their mean under triangles, their value in pixels, their passage through mesh operations."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.geometry import texture_filter
from gi_core.geometry.paint import join_paints
from gi_core.geometry.surfaces import flatten
from gi_core.geometry.tessellation import tessellate
from gi_core.geometry.texture_filter import LINEAR, MOST_REFLECTANCE, levels, lookup, mean_colours, mean_linear
from gi_core.scene import Material, Mesh, Paint, Scene, Texture
from tests.support.mesh_writers import QUAD, QUAD_FACES

RNG = np.random.default_rng(7)


def noise(h=13, w=21, wrap=("repeat", "repeat")) -> Texture:
    return Texture(RNG.integers(0, 256, (h, w, 3), dtype=np.uint8), wrap)


def smooth(n=64, wrap=("repeat", "repeat")) -> Texture:
    """A gradient with a bright disc, like a photograph at this scale."""
    y, x = np.mgrid[:n, :n] / n
    disc = (x - 0.6) ** 2 + (y - 0.4) ** 2 < 0.04
    return Texture(np.stack([200 * x, 150 * y + 60 * disc, 40 + 200 * disc], axis=2).astype(np.uint8), wrap)


def painted(texture: Texture, uv, colour=None) -> Paint:
    uv = np.asarray(uv, np.float32)
    colour = np.ones((len(uv), 3, 3)) if colour is None else colour
    return Paint((texture,), np.zeros(len(uv), np.int32), uv, np.asarray(colour, np.float32))


def bilinear_naively(texture: Texture, u: float, v: float) -> np.ndarray:
    """One texel at a time, wrapped by name."""
    h, w = texture.pixels.shape[:2]

    def at(i, n, way):
        if way == "clamp":
            return min(max(i, 0), n - 1)
        if way == "mirror" and (i // n) % 2:
            return n - 1 - i % n
        return i % n

    x, y = u * w - 0.5, v * h - 0.5
    total = np.zeros(3)
    for i, wx in ((int(np.floor(x)), 1 - x % 1), (int(np.floor(x)) + 1, x % 1)):
        for j, wy in ((int(np.floor(y)), 1 - y % 1), (int(np.floor(y)) + 1, y % 1)):
            pixel = texture.pixels[at(j, h, texture.wrap[1]), at(i, w, texture.wrap[0])]
            total += wx * wy * np.minimum(LINEAR[pixel], MOST_REFLECTANCE)
    return total


def mean_naively(texture: Texture, uv, n=60) -> np.ndarray:
    """Thousands of points per triangle, evenly spread."""
    total, count = np.zeros(3), 0
    for i in range(n):
        for j in range(n - i):
            b, c = (i + 1 / 3) / n, (j + 1 / 3) / n
            total += bilinear_naively(texture, *((1 - b - c) * uv[0] + b * uv[1] + c * uv[2]))
            count += 1
    return total / count


# Scales ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(8, 8), (13, 7), (1, 5), (6, 1), (1, 1)])
def test_every_scale_has_the_same_mean(shape):
    """Halving keeps the linear mean: to the rounding of a byte, also where a side is odd."""
    chain = levels(Texture(RNG.integers(0, 256, (*shape, 3), dtype=np.uint8)))
    assert chain[-1].shape == (1, 1, 3)
    for smaller, larger in zip(chain[1:], chain, strict=False):
        assert smaller.shape[:2] == tuple(max(n // 2, 1) for n in larger.shape[:2])
    for level in chain:
        np.testing.assert_allclose(mean_linear(level), mean_linear(chain[0]), atol=4e-3)


# The mean under a triangle --------------------------------------------------------------------------


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("span", [0.01, 0.3, 2.5])
def test_mean_equals_point_sampling(wrap, span):
    """From a hundredth of the image to several repetitions of it."""
    texture = smooth(64, (wrap, wrap))
    corner = RNG.uniform(-1.5, 1.5, (6, 1, 2))
    uv = (corner + span * RNG.uniform(-1, 1, (6, 3, 2))).astype(np.float32)
    expected = np.array([mean_naively(texture, t.astype(float)) for t in uv])
    np.testing.assert_allclose(mean_colours(painted(texture, uv)), expected, atol=0.01)
    # Of very many triangles each gets fewer samples.
    many = mean_colours(painted(texture, np.tile(uv, (6000, 1, 1))))[-6:]
    assert np.abs(many - expected).mean() < 0.01 and np.abs(many - expected).max() < 0.06


def test_triangle_below_a_texel_has_the_value_at_its_centre():
    texture = noise()
    uv = (RNG.uniform(-2, 2, (20, 1, 2)) + RNG.uniform(0, 1e-3, (20, 3, 2))).astype(np.float32)
    expected = [bilinear_naively(texture, *t.mean(axis=0)) for t in uv.astype(float)]
    np.testing.assert_allclose(mean_colours(painted(texture, uv)), expected, atol=1e-3)


def test_triangle_of_many_repetitions_has_the_image_mean():
    texture = noise(32, 32)
    uv = [[[0.1, 0.2], [1003.0, 5.0], [40.0, 990.0]]]
    np.testing.assert_allclose(mean_colours(painted(texture, uv))[0], mean_linear(texture.pixels), atol=0.01)


def test_an_image_of_stripes_is_weighed_by_area():
    """White left of u = 1/2: of the triangle (0,0) (1,0) (0,1) three quarters; of its complement one quarter."""
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[:, :32] = 255
    uv = [[[0, 0], [1, 0], [0, 1]], [[1, 1], [0, 1], [1, 0]]]
    means = mean_colours(painted(Texture(pixels, ("clamp", "clamp")), uv))
    np.testing.assert_allclose(means[:, 0], [0.75 * MOST_REFLECTANCE, 0.25 * MOST_REFLECTANCE], atol=0.01)


def test_corner_colours_weight_the_texture_locally():
    """A colour that is 1 at the white end and 0 at the black end reflects more than the product of the means."""
    ramp = np.repeat(np.linspace(255, 0, 256).astype(np.uint8)[None, :, None], 4, axis=0).repeat(3, axis=2)
    uv = np.array([[[0.01, 0.5], [0.99, 0.5], [0.01, 0.6]]])
    colour = np.array([[[1.0] * 3, [0.0] * 3, [1.0] * 3]])
    texture = Texture(ramp, ("clamp", "clamp"))
    mean = mean_colours(painted(texture, uv, colour))[0, 0]
    s = (np.arange(2000) + 0.5) / 2000  # the share of the triangle nearer than s along u falls as 1 - s
    value = np.array([bilinear_naively(texture, 0.01 + 0.98 * t, 0.5)[0] for t in s])
    assert mean == pytest.approx((2 * (1 - s) * (1 - s) * value).mean(), rel=0.02)
    assert mean > 1.15 * mean_colours(painted(texture, uv))[0, 0] * colour.mean()


def test_reflectance_stays_below_its_limit():
    white = Texture(np.full((4, 4, 3), 255, np.uint8))
    assert mean_colours(painted(white, [[[0, 0], [1, 0], [0, 1]]])).max() <= MOST_REFLECTANCE
    assert texture_filter.REFLECTANCE.max() == MOST_REFLECTANCE


@pytest.mark.parametrize("uv", [np.nan, np.inf, 1e30])
def test_non_finite_coordinates_are_harmless(uv):
    mean = mean_colours(painted(noise(), [[[uv, 0], [0, uv], [0.5, 0.5]]]))
    assert np.isfinite(mean).all() and (mean >= 0).all()


def test_a_mean_is_the_same_each_time_and_in_any_order():
    texture, uv = noise(200, 333), RNG.uniform(-1, 2, (500, 3, 2))
    order = RNG.permutation(500)
    first = mean_colours(painted(texture, uv))
    np.testing.assert_array_equal(first[order], mean_colours(painted(Texture(texture.pixels), uv[order])))


# The value in a pixel -------------------------------------------------------------------------------


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_a_near_pixel_is_interpolated_between_texels(wrap):
    texture = noise(wrap=(wrap, "repeat"))
    uv = RNG.uniform(-2, 3, (40, 2))
    step = np.full((40, 2), 1e-4)
    expected = [bilinear_naively(texture, *at) for at in uv]
    np.testing.assert_allclose(lookup(texture, uv, step * [1, 0], step * [0, 1]), expected, atol=1e-9)


def test_pixel_covering_the_image_has_its_mean():
    texture = noise(32, 32)
    one = np.ones((1, 2))
    np.testing.assert_allclose(
        lookup(texture, 0.3 * one, one * [1, 0], one * [0, 1])[0], mean_linear(texture.pixels), atol=0.01
    )


def test_a_grazing_pixel_is_blurred_along_its_footprint_only():
    """Columns of black and white, a footprint eight texels long: grey across them, sharp along them."""
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[:, ::2] = 255
    texture, uv = Texture(pixels), np.array([[0.5 / 64, 0.5]])
    thin, long = np.array([[1.0, 0]]) / 64, np.array([[0, 8.0]]) / 64
    assert lookup(texture, uv, thin, long)[0, 0] == pytest.approx(MOST_REFLECTANCE, abs=1e-6)
    assert lookup(texture, uv, thin[:, ::-1], long[:, ::-1])[0, 0] == pytest.approx(0.5, abs=0.05)


# Meshes and scenes ----------------------------------------------------------------------------------


def test_transport_uses_the_mean_and_leaves_plain_scenes_unchanged():
    mesh = Mesh(QUAD, QUAD_FACES.astype(np.int32), np.zeros(2, np.int32))
    red = Material("red", (0.5, 0.1, 0.1))
    plain, _ = flatten(Scene(mesh, (red,)))
    np.testing.assert_array_equal(plain.reflectance, [[0.5, 0.1, 0.1]] * 2)
    assert plain.paint == (None,)
    paint = painted(smooth(), QUAD[QUAD_FACES][..., :2])
    surfaces, _ = flatten(Scene(mesh._replace(paint=paint), (red,)))
    np.testing.assert_array_equal(surfaces.reflectance, mean_colours(paint))


def test_means_follow_mesh_refinement():
    """Halves of a black and white image: one large triangle is grey, small ones black or white; the mean stays."""
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[:, 1] = 255
    texture = Texture(np.kron(pixels, np.ones((32, 32, 1), np.uint8)), ("clamp", "clamp"))
    mesh = Mesh(QUAD, QUAD_FACES.astype(np.int32), np.zeros(2, np.int32))
    mesh = mesh._replace(paint=painted(texture, QUAD[QUAD_FACES][..., :2]))
    coarse, fine = mesh, tessellate(mesh, 0.1)
    middle = fine.vertices[fine.faces].mean(axis=1)[:, 0]
    rho = mean_colours(fine.paint)[:, 0]
    assert rho[middle < 0.4].max() < 0.01 and rho[middle > 0.6].min() > 0.97
    assert mean_colours(coarse.paint)[:, 0].mean() == pytest.approx(rho.mean(), abs=0.01)


def test_coordinates_and_colours_stay_linear_in_position():
    """Both are affine over the quad, and remain so at each corner after it is cut into hundreds of faces."""
    slope = np.array([[2.0, 0.5], [-0.25, 3.0], [0, 0]])
    tint = np.array([[0.3, 0.1, 0.6], [0.2, 0.4, 0.1], [0, 0, 0]])
    at = QUAD[QUAD_FACES]
    paint = painted(noise(), at @ slope, at @ tint)
    fine = tessellate(Mesh(QUAD, QUAD_FACES.astype(np.int32), np.zeros(2, np.int32), paint=paint), 0.07)
    corners = fine.vertices[fine.faces]
    assert len(fine.faces) > 300 and (fine.paint.face_texture == 0).all() and fine.paint.textures is paint.textures
    np.testing.assert_allclose(fine.paint.corner_uv, corners @ slope, atol=1e-6)
    np.testing.assert_allclose(fine.paint.corner_colour, corners @ tint, atol=1e-6)


def test_joined_paints_keep_their_textures():
    a = Mesh(QUAD, QUAD_FACES.astype(np.int32), np.zeros(2, np.int32), paint=painted(noise(), np.zeros((2, 3, 2))))
    b = a._replace(paint=None, face_reflectance=np.array([[0.1, 0.2, 0.3]] * 2))
    c = a._replace(paint=painted(smooth(), np.ones((2, 3, 2))))
    joined = join_paints([a, b, c], [Material("m")])
    assert joined.face_texture.tolist() == [0, 0, -1, -1, 1, 1]
    assert joined.textures == (*a.paint.textures, *c.paint.textures)
    np.testing.assert_allclose(mean_colours(joined)[2:4], b.face_reflectance, rtol=1e-6)
    assert join_paints([b, b], [Material("m")]) is None
