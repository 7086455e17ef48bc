"""Holes from an MTL file, and picking through holes."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from app.draw.picking import Picker
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.geometry.surfaces import flatten
from gi_core.scene import Material, Mesh, Paint, Pose, Scene, Texture
from gi_core.scene.types import Mobile
from tests.support.mesh_writers import write_glb

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
def test_fully_dissolved_material_adds_a_note(tmp_path, line, noted):
    notes = card(tmp_path, f"Kd 0.2 0.2 0.2\n{line}\n").notes
    assert any('taken as opaque: "leaf"' in note for note in notes) == noted


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
    picker = Picker(flatten(scene)[0])
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
