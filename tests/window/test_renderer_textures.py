"""Textures as the renderer draws them, pixel by pixel."""

import numpy as np
import pytest

from app.draw.draw_mesh import DrawMesh
from app.draw.gl_textures import GLTextures
from app.draw.tonemap import to_display
from gi_core.geometry.texture_filter import lookup
from gi_core.scene import Texture
from tests.support.gl_drawing import EYE, HALF_TURN, SIZE, square
from tests.support.projection import projected

PIXELS = np.random.default_rng(5).integers(0, 256, (4, 4, 3), dtype=np.uint8)


def poster(texture, uv=((0, 1), (1, 1), (1, 0), (0, 0)), tint=(1.0, 1.0, 1.0), emission=(0.0, 0.0, 0.0)):
    """Return a square that faces the eye and shows an image upright; E / pi is 1 on its front, 1/2 on its back."""
    mesh, front, back = square(tint, tuple(0.5 * c for c in tint), half=0.5)
    n = len(front)
    mesh = mesh._replace(
        emission=np.tile(emission, (n, 1)),
        textures=(texture,),
        texture=np.zeros(n, np.int32),
        uv=np.array(uv, np.float32)[[0, 3, 1, 2]],  # the order of `quad`
        texel=np.ones((n, 3)),
    )
    return mesh, front, back


def inside(picture, step=5):
    """Return pixels (n, 3) of a poster and where they are in it (n, 2), 0..1 from its top left corner."""
    aspect = SIZE[0] / SIZE[1]
    (left, top), (right, bottom) = (projected(EYE, p, aspect)[:2] for p in ((-0.5, 0.5, 0.0), (0.5, -0.5, 0.0)))
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
    """At each pixel: texture times tint times E / pi, plus the emission of the front."""
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
def test_texture_is_wrapped_beyond_its_edges(draw, wrap):
    """Coordinates from -1 to 2, three periods per axis: repeated, mirrored, or clamped to the last column and row."""
    texture = Texture(PIXELS, (wrap, "repeat"))
    uv = 3 * np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float) - 1
    pixels, at = inside(draw([poster(texture, uv)], tone_map="clip"), step=3)
    assert np.abs(pixels - to_display(exact(texture, 3 * at - 1), 0.0, "clip").astype(int)).max() <= 4


@pytest.mark.gl
def test_distant_texture_shows_its_mean(draw):
    """Sixty-four checks per pixel: not black or white, but their mean reflectance."""
    checks = (255 * (np.indices((64, 64)).sum(axis=0) % 2)).astype(np.uint8)[..., None].repeat(3, axis=2)
    uv = 10 * np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float)
    drawn = draw([poster(Texture(checks), uv)], tone_map="clip")
    middle_part = drawn[SIZE[1] // 2 - 10 : SIZE[1] // 2 + 10, SIZE[0] // 2 - 10 : SIZE[0] // 2 + 10].astype(int)
    assert np.abs(middle_part - int(to_display(np.full(3, 0.5), 0.0, "clip")[0])).max() <= 2


@pytest.mark.gl
@pytest.mark.parametrize("turned", [False, True])
def test_stripes_stay_sharp_in_long_footprints(draw, turned):
    """As at grazing angles: planks and a carpet's border were grey in living_room, as footprints counted as squares."""
    stripes = np.repeat(np.where(np.arange(64) // 8 % 2, 255, 0)[None, :, None], 64, axis=0).repeat(3, axis=2)
    texture = Texture((stripes.swapaxes(0, 1) if turned else stripes).astype(np.uint8))
    scale = (1, 8)[:: -1 if turned else 1]  # texels per pixel: 0.5 across the stripes, 4 along them
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float) * scale
    pixels, at = inside(draw([poster(texture, uv)], tone_map="clip"))
    phase = (at[:, 1 if turned else 0] * 8) % 1
    middle = np.abs(phase - 0.5) < 0.2
    assert np.abs(pixels[middle] - 255 * (exact(texture, at * scale)[middle] > 0.5)).max() < 60


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
        u, v = projected(EYE, at, SIZE[0] / SIZE[1])
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
        u, v = projected(EYE, (0.4 * k - 0.4, 0, 0), SIZE[0] / SIZE[1])
        pixel = one[int(v * SIZE[1]), int(u * SIZE[0])].astype(int)
        assert pixel[k] > 240 and pixel.sum() - pixel[k] < 10


@pytest.mark.gl
def test_textures_are_freed_and_shared(ctx):
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
