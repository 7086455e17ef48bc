"""Holes in textures and textures of square texels: read, and seen by both renderers.

Holes from an MTL file, and picking through holes.
"""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app.draw.picking import Picker
from app.draw.shot import Shot
from app.settings import Settings, make_solver
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.formats.texture_images import _bled, _cover_of
from gi_core.geometry.texture_filter import lookup
from gi_core.model import Model
from gi_core.scene import Camera, Material, Mesh, Paint, Pose, Scene, Texture
from gi_core.scene.types import Mobile
from tests.files.test_texture_files import UV, png
from tests.support.gl_drawing import gl_picture
from tests.support.mesh_writers import QUAD, QUAD_FACES, write_glb
from tests.support.scene_builders import merge, quad

RNG = np.random.default_rng(3)


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


def grove(nearest: bool = False) -> Scene:
    """Two cards with nine leaves each, one behind the other, in front of a wall; seen from a corner."""
    image = leaf(32)
    cover = _cover_of(image[..., 3], 1.0, 0.5)
    texture = Texture(_bled(image[..., :3], cover), nearest=nearest, cover=cover)
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
    settings = Settings(photons=100, radius=0.1, size=(256, 192), exposure=0.0, show=show)
    pictures = []
    for scene in (grove(nearest), whole(grove(nearest))):
        solver = make_solver(scene, settings)
        solver.frame = solver.frame._replace(irradiance=np.full(solver.irradiance.shape, 2.0))
        wall = np.unique(solver.surfaces.corner_front[: 2 * 16])
        solver.irradiance[wall] = 0.5
        shot = Shot(solver, settings)
        pictures += [p.reshape(48, 4, 64, 4, 3).mean(axis=(1, 3)) for p in (shot.take().astype(int), gl_picture(shot))]
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


CHECKS = np.array([[255, 0], [0, 255]], np.uint8)  # there, and not, in squares of half a card
CARD = "mtllib card.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl leaf\n"


def card(tmp_path, mtl: str, **images: np.ndarray):
    """Read a card with an MTL and images in its folder."""
    for name, pixels in images.items():
        Image.fromarray(pixels).save(tmp_path / f"{name}.png")
    (tmp_path / "card.mtl").write_text("newmtl leaf\n" + mtl)
    (tmp_path / "card.obj").write_text(CARD + "f 1/1 2/2 3/3 4/4\n")
    return read_mesh_file(tmp_path / "card.obj")


def big(checks: np.ndarray, n: int = 8) -> np.ndarray:
    return np.kron(checks, np.ones((n, n), np.uint8))


@pytest.mark.parametrize("order", ["map_Kd green.png\nmap_d mask.png\n", "map_d mask.png\nmap_Kd green.png\n"])
@pytest.mark.parametrize("channel", ["grey", "alpha"])
def test_map_d_cuts_a_picture(tmp_path, order, channel):
    """A mask is an image's alpha where it has one, else its grey."""
    mask = big(CHECKS)
    if channel == "alpha":
        mask = np.concatenate([np.full((*mask.shape, 3), 77, np.uint8), mask[..., None]], axis=2)
    green = np.full((16, 16, 3), (0, 200, 0), np.uint8)
    (texture,) = card(tmp_path, order, green=green, mask=mask).mesh.paint.textures
    assert np.array_equal(texture.cover >= 128, big(CHECKS) == 255)
    assert np.array_equal(texture.pixels[0, 0], (0, 200, 0))


def test_a_mask_of_another_size_is_stretched_over_the_picture(tmp_path):
    green = np.full((32, 16, 3), (0, 200, 0), np.uint8)
    (texture,) = card(
        tmp_path, "map_Kd green.png\nmap_d mask.png\n", green=green, mask=big(CHECKS, 4)
    ).mesh.paint.textures
    assert texture.cover.shape == (32, 16)
    assert texture.cover[4, 4] == 255 and texture.cover[4, 12] == 0 and texture.cover[28, 12] == 255


def test_a_mask_alone_cuts_the_material_s_colour(tmp_path):
    read = card(tmp_path, "Kd 0.25 0.5 0.02\nmap_d mask.png\n", mask=big(CHECKS))
    (texture,) = read.mesh.paint.textures
    assert np.array_equal(texture.cover >= 128, big(CHECKS) == 255)
    srgb = texture.pixels[0, 0] / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    assert np.allclose(linear, (0.25, 0.5, 0.02), atol=0.005)


def test_missing_mask_leaves_the_surface_opaque_and_adds_a_note(tmp_path):
    read = card(tmp_path, "Kd 0.2 0.2 0.2\nmap_d gone.png\n")
    assert read.mesh.paint is None and sum("gone.png is missing" in note for note in read.notes) == 1


@pytest.mark.parametrize(
    ("line", "noted"), [("d 0.4", True), ("Tr 0.3", True), ("d 1", False), ("Tr 0", False), ("", False)]
)
def test_dissolved_material_becomes_a_pane(tmp_path, line, noted):
    notes = card(tmp_path, f"Kd 0.2 0.2 0.2\n{line}\n").notes
    assert any('panes of glass: "leaf"' in note for note in notes) == noted


def scene_of_a_card_with_holes() -> Scene:
    """A card at z = 0 with holes in two quarters, as a mobile, before a wall at z = -1."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
    faces, uv = np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    texture = Texture(np.full((16, 16, 3), 99, np.uint8), cover=big(CHECKS))
    paint = Paint((texture,), np.zeros(2, np.int32), uv[faces], np.ones((2, 3, 3), np.float32))
    wall = Mesh(2 * corners - (0.5, 0.5, 1.0), faces, np.zeros(2, np.int32))
    sheet = Mesh(corners, faces, np.zeros(2, np.int32), paint=paint)
    return Scene(wall, (Material("grey", two_sided=True),), (Mobile("sheet", sheet, Pose((0.0, 0.0, 0.0))),))


def test_picking_passes_through_holes():
    """The upper left quarter is opaque; right of it a ray hits the wall behind."""
    scene = scene_of_a_card_with_holes()
    picker = Picker(Model(scene))
    for x, y, of in ((0.25, 0.75, 1), (0.75, 0.75, 0), (0.25, 0.25, 0), (0.75, 0.25, 1)):
        hit = picker.pick((x, y, 2.0), (0.0, 0.0, -1.0), [scene.mobiles[0].pose], cull=True)
        assert (hit.object, round(hit.distance)) == (of, 2 if of else 3), (x, y, hit)


def test_palette_transparency_is_a_mask(tmp_path):
    """A palette with a transparent entry is a mask by its alpha."""
    image = Image.fromarray(big(CHECKS)).convert("P")
    data = io.BytesIO()
    image.save(data, "png", transparency=int(np.asarray(image)[0, 15]))
    (tmp_path / "mask.png").write_bytes(data.getvalue())
    (texture,) = card(tmp_path, "map_d mask.png\n").mesh.paint.textures
    assert np.array_equal(texture.cover >= 128, big(CHECKS) == 255)


@pytest.mark.parametrize(
    ("described", "left"),
    [
        ({"alphaMode": "MASK"}, 1),
        ({"alphaMode": "MASK", "alphaCutoff": 0.1}, 2),
        ({"alphaMode": "MASK", "alphaCutoff": 0.3, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5]}}, 1),
        ({"alphaMode": "BLEND"}, 1),
        ({}, 2),
    ],
)
def test_vertex_alpha_removes_whole_triangles(tmp_path, described, left):
    """Corners of the first triangle have alpha 1, of the second 0.2 throughout; they share none."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0]], np.float64)
    colours = np.ones((6, 4))
    colours[3:, 3] = 0.2
    faces = np.arange(6).reshape(2, 3)
    file = write_glb(tmp_path / "a.glb", corners, faces, material={"name": "leaf", **described}, colours=colours)
    assert len(read_mesh_file(file).mesh.faces) == left
