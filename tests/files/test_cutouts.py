"""Holes in textures and textures of square texels: read, seen by both renderers, passed by light."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app.draw.shot import Shot
from app.settings import Settings, make_solver
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.load import load_scene
from gi_core.geometry.cutouts import bled, cover_of, covered, without_holes
from gi_core.geometry.tessellation import tessellate
from gi_core.geometry.texture_filter import lookup
from gi_core.scene import Camera, DirectionalLight, Material, Paint, Scene, Texture
from gi_core.solver import Solver
from tests.cli.test_render import gl_picture
from tests.support.mesh_writers import QUAD, QUAD_FACES, write_glb
from tests.support.scene_builders import merge, quad

UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
RNG = np.random.default_rng(3)


def png(pixels: np.ndarray) -> bytes:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "png")
    return data.getvalue()


def leaf(n: int = 16) -> np.ndarray:
    """A green disc of radius 0.3 about (0.5, 0.5) on transparent black. (n, n, 4)."""
    y, x = (np.mgrid[:n, :n] + 0.5) / n
    alpha = np.clip(0.5 + n * (0.3 - np.hypot(x - 0.5, y - 0.5)), 0, 1)
    return np.round(np.stack([0 * x, 200 * (alpha > 0), 0 * x, 255 * alpha], axis=2)).astype(np.uint8)


def material(mode: str | None, alpha: float = 1.0, **more) -> dict:
    pbr = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, alpha]}
    return {"name": "leaf", "pbrMetallicRoughness": pbr} | ({"alphaMode": mode} if mode else {}) | more


def texture_of(tmp_path, described: dict, **more) -> Texture:
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, uv=UV, material=described, image=png(leaf()), **more)
    (texture,) = read_mesh_file(file).mesh.paint.textures
    return texture


@pytest.mark.parametrize(
    ("mode", "factor", "cutoff", "there"),
    [("MASK", 1.0, 0.5, 128), ("MASK", 1.0, 0.2, 51), ("MASK", 0.5, 0.25, 128), ("BLEND", 0.1, None, 128)],
)
def test_gltf_alpha_becomes_a_cover_with_one_threshold(tmp_path, mode, factor, cutoff, there):
    """MASK keeps alpha x factor >= cutoff; BLEND is cut at one half, for any factor."""
    described = material(mode, factor, **({} if cutoff is None else {"alphaCutoff": cutoff}))
    texture = texture_of(tmp_path, described)
    np.testing.assert_array_equal(texture.cover >= 128, leaf()[..., 3] >= there)
    assert 0 < (texture.cover >= 128).sum() < 256 and not texture.nearest
    np.testing.assert_array_equal(texture.pixels[8, 8], [0, 200, 0])
    np.testing.assert_array_equal(texture.pixels[0, 0], [0, 200, 0], "no black rim")


def test_opaque_materials_and_images_have_no_cover(tmp_path):
    assert texture_of(tmp_path, material(None)).cover is None
    file = write_glb(tmp_path / "b.glb", QUAD, QUAD_FACES, uv=UV, material=material("MASK"), image=png(leaf()[..., :3]))
    assert read_mesh_file(file).mesh.paint.textures[0].cover is None


def test_gltf_nearest_sampler_shows_square_texels(tmp_path):
    sampler = {"samplers": [{"magFilter": 9728}], "textures": [{"source": 0, "sampler": 0}]}
    assert texture_of(tmp_path, material(None), **sampler).nearest
    pixels = RNG.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    uv = RNG.random((200, 2)) * 3 - 1
    square, smooth = Texture(pixels, nearest=True), Texture(pixels)
    at = np.floor(uv * [7, 5]).astype(int) % [7, 5]
    middle = (np.floor(uv * [7, 5]) + 0.5) / [7, 5]
    near = np.full((2, 200, 2), 1e-6)
    np.testing.assert_allclose(lookup(square, uv, *near), lookup(smooth, middle, *near), atol=1e-12)
    assert len(np.unique(lookup(square, uv, *near)[:, 0])) <= len(np.unique(pixels[..., 0])) and at.max() == 6
    far = np.full((2, 200, 2), 0.5) * [[[1, 0]], [[0, 1]]]
    np.testing.assert_array_equal(lookup(square, uv, *far), lookup(smooth, uv, *far)), "smooth from afar"


@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_covered_is_the_interpolated_cover_of_every_repetition(wrap, nearest):
    cover = RNG.integers(0, 256, (6, 4), dtype=np.uint8)
    texture = Texture(np.zeros((6, 4, 3), np.uint8), (wrap, "repeat"), nearest, cover)
    uv = RNG.random((500, 2)) * 5 - 2
    # Bilinear by brute force, of the image laid out with its neighbours.
    column = {
        "repeat": lambda i: i % 4,
        "mirror": lambda i: min(i % 8, 7 - i % 8),
        "clamp": lambda i: min(max(i, 0), 3),
    }
    wanted = []
    for u, v in uv:
        x, y = u * 4 - 0.5, v * 6 - 0.5
        if nearest:
            x, y = np.floor(x + 0.5), np.floor(y + 0.5)
        i, j = int(np.floor(x)), int(np.floor(y))
        grid = np.array([[cover[(j + b) % 6, column[wrap](i + a)] for a in (0, 1)] for b in (0, 1)], float)
        wanted.append([1 - (y - j), y - j] @ grid @ [1 - (x - i), x - i])
    wanted = np.array(wanted)
    clear = np.abs(wanted - 127.5) > 1e-6
    assert clear.sum() > 400
    np.testing.assert_array_equal(covered(texture, uv)[clear], (wanted >= 127.5)[clear])


def grove(nearest: bool = False) -> Scene:
    """Two cards with nine leaves each, one behind the other, in front of a wall; seen from a corner."""
    image = leaf(32)
    cover = cover_of(image[..., 3], 1.0, 0.5)
    texture = Texture(bled(image[..., :3], cover), nearest=nearest, cover=cover)
    cards = [quad((-0.5, -0.5, z), (1, 0, 0), (0, 1, 0), (3, 3), material=1) for z in (0.0, 0.3)]
    wall = quad((-1, -1, -0.5), (2, 0, 0), (0, 2, 0), (4, 4))
    mesh = merge(wall, *cards)
    n, of_wall = len(mesh.faces), len(wall.faces)
    uv = (3 * mesh.vertices[mesh.faces][..., :2] + 0.2).astype(np.float32)
    paint = Paint((texture,), np.repeat([-1, 0], [of_wall, n - of_wall]).astype(np.int32), uv, np.ones((n, 3, 3)))
    paint = paint._replace(corner_colour=np.full((n, 3, 3), 0.8, np.float32))
    materials = Material("wall", (0.8, 0.8, 0.8)), Material("leaf", (0.8, 0.8, 0.8), two_sided=True)
    return Scene(mesh._replace(paint=paint), materials, camera=Camera((0.4, 0.3, 1.8), (0, 0, 0), 45.0))


@pytest.mark.gl
@pytest.mark.parametrize("show", ["radiance", "irradiance"])
@pytest.mark.parametrize("nearest", [False, True])
def test_rays_and_opengl_show_the_same_holes(show, nearest):
    """Blocks of 4 x 4 pixels agree; half of the cards' area shows the background; with and without reflectance."""
    settings = Settings(photons=100, radius=0.1, size=(384, 288), exposure=0.0, show=show)
    pictures = []
    for scene in (grove(nearest), whole(grove(nearest))):
        solver = make_solver(scene, settings)
        solver.frame = solver.frame._replace(irradiance=np.full(solver.irradiance.shape, 2.0))
        wall = np.unique(solver.surfaces.corner_front[: 2 * 16])
        solver.irradiance[wall] = 0.5
        shot = Shot(solver, settings)
        pictures += [p.reshape(72, 4, 96, 4, 3).mean(axis=(1, 3)) for p in (shot.take().astype(int), gl_picture(shot))]
    ours, drawn, ours_whole, _ = pictures
    apart = np.abs(ours - drawn).max(axis=2)
    assert (apart > 16).mean() < 0.03 and apart.mean() < 2, f"{(apart > 16).mean():.3%}, mean {apart.mean():.2f}"
    opened = np.abs(ours - ours_whole).max(axis=2) > 30
    assert 0.1 < opened.mean() < 0.5


def whole(scene: Scene) -> Scene:
    paint = scene.static.paint
    return replace(
        scene, static=scene.static._replace(paint=paint._replace(textures=(Texture(np.zeros((2, 2, 3), np.uint8)),)))
    )


def test_light_passes_through_removed_triangles(tmp_path):
    """A card with a hole of half its width, under the sun: below the hole as bright as in the open, the rest in shade.

    As two triangles it shades all of it; the file's card comes out cut, like the one made here.
    """
    image = np.full((64, 64, 4), 255, np.uint8)
    image[16:48, 16:48, 3] = 0
    cover = cover_of(image[..., 3], 1.0, 0.5)
    texture = Texture(bled(image[..., :3], cover), ("clamp", "clamp"), cover=cover)
    card = quad((-1, 1, 1), (2, 0, 0), (0, 0, -2), material=1)
    uv = ((card.vertices[card.faces][..., [0, 2]] + 1) / 2).astype(np.float32)
    card = card._replace(paint=Paint((texture,), np.zeros(2, np.int32), uv, np.full((2, 3, 3), 0.5, np.float32)))
    assert len(without_holes(card).faces) == 2
    fine = without_holes(tessellate(card, 0.15))
    assert 0.6 < len(fine.faces) / len(tessellate(card, 0.15).faces) < 0.85
    middles = np.abs(fine.vertices[fine.faces].mean(axis=1)[:, [0, 2]]).max(axis=1)
    assert middles.min() > 0.4 and np.allclose(fine.paint.corner_uv * 2 - 1, fine.vertices[fine.faces][..., [0, 2]])
    sun = DirectionalLight("sun", (0.0, -1.0, 0.0), (1.0, 1.0, 1.0))
    floor = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), (16, 16))
    seen = []
    for shade in (None, card, fine):
        mesh = floor if shade is None else merge(floor, shade)
        scene = Scene(
            mesh, (Material("floor", (0.0,) * 3), Material("card", (0.0,) * 3, two_sided=True)), lights=(sun,)
        )
        solver = Solver(scene, photons=40_000, radius=0.12)
        solver.solve()
        at = solver.receivers.positions
        below = (at[:, 1] < 0.5) & (np.abs(at[:, [0, 2]]).max(axis=1) < 0.25)
        beside = (at[:, 1] < 0.5) & (np.abs(np.abs(at[:, 0]) - 0.8) < 0.1) & (np.abs(at[:, 2]) < 0.8)
        seen.append((solver.irradiance[below].mean(), solver.irradiance[beside].mean()))
    (open_below, open_beside), (whole_below, _), (cut_below, cut_beside) = seen
    assert open_beside > 0.8 and whole_below < 0.01
    assert cut_below == pytest.approx(open_below, rel=0.1) and cut_beside < 0.01

    described = {
        "name": "card",
        "alphaMode": "MASK",
        "doubleSided": True,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
    }
    write_glb(tmp_path / "card.glb", QUAD, QUAD_FACES, uv=UV, material=described, image=png(image))
    (tmp_path / "card.toml").write_text('[static]\nmesh = "card.glb"\nmax_edge = 0.1\n')
    faces = len(load_scene(tmp_path / "card.toml").static.faces)
    (tmp_path / "card.glb").unlink()
    opaque = described | {"alphaMode": "OPAQUE"}
    write_glb(tmp_path / "card.glb", QUAD, QUAD_FACES, uv=UV, material=opaque, image=png(image))
    assert len(load_scene(tmp_path / "card.toml").static.faces) - faces > 40


def test_clamped_mask_extends_its_rim_and_repeated_mask_its_holes():
    """Clamped, the rim goes on for ever; repeated, a hole does too, over several periods."""
    cover = np.zeros((8, 8), np.uint8)
    cover[0, 0] = 255
    corners = np.array([[[0.3, 0.3], [0.7, 0.3], [0.3, 0.7]], [[2.3, 1.3], [2.7, 1.3], [2.3, 1.7]]], np.float32)
    wide = np.array([[[0.3, 0.3], [1.4, 0.3], [0.3, 1.4]]], np.float32)
    mesh = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    left = {}
    for wrap in ("repeat", "clamp"):
        texture = Texture(np.zeros((8, 8, 3), np.uint8), (wrap, wrap), cover=cover)
        for name, uv in (("inside", corners), ("wide", np.concatenate([corners[:1], wide]))):
            paint = Paint((texture,), np.zeros(2, np.int32), uv, np.ones((2, 3, 3), np.float32))
            left[wrap, name] = len(without_holes(mesh._replace(paint=paint)).faces)
    assert left["repeat", "wide"] == 1 and left["clamp", "inside"] == 1
    assert left["repeat", "inside"] == 2, "a mesh of nothing but holes stays as it is"
