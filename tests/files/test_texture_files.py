"""Textures in files: coordinates, samplers, unreadable images, textures kept by scenes.

Textures: their mean under triangles, their value in pixels, their passage through mesh operations.
"""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gi_core.files.formats.boundary import LIMITS, MOST_IMAGE_PIXELS, Boundary
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.formats.texture_images import FORMATS, decode
from gi_core.files.load import load_scene
from gi_core.geometry import texture_filter
from gi_core.geometry.mesh_parts import join_paints
from gi_core.geometry.surfaces import flatten
from gi_core.geometry.tessellation import tessellate
from gi_core.geometry.texture_filter import (
    LINEAR,
    MOST_REFLECTANCE,
    levels,
    lookup,
    mean_colours,
    mean_linear,
    srgb_to_linear,
)
from gi_core.scene import Material, Mesh, Paint, Scene, Texture
from tests.support.mesh_writers import QUAD, QUAD_FACES, write_glb, write_obj


def png(pixels: np.ndarray) -> bytes:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "png")
    return data.getvalue()


def huge_png(width=60_000, height=50_000) -> bytes:
    """A few bytes that declare 3,000 million pixels."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    )


def textured(**texture) -> dict:
    return {"name": "oak", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}}}


UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
PIXELS = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)


def test_gltf_texture_with_transform_and_sampler(tmp_path):
    """The extension's own order: scale, then rotate, then shift; a quarter turn carries u to -v."""
    turned = {"KHR_texture_transform": {"offset": [0.5, 0.25], "rotation": np.pi / 2, "scale": [2, 3]}}
    file = write_glb(
        tmp_path / "a.glb", QUAD, QUAD_FACES, uv=UV, material=textured(extensions=turned), image=png(PIXELS),
        samplers=[{"wrapS": 33648, "wrapT": 33071}], textures=[{"source": 0, "sampler": 0}],
    )  # fmt: skip
    paint = read_mesh_file(file).mesh.paint
    (texture,) = paint.textures
    assert texture.wrap == ("mirror", "clamp")
    np.testing.assert_array_equal(texture.pixels, PIXELS)
    u, v = UV.T * [[2], [3]]
    np.testing.assert_allclose(paint.corner_uv, np.stack([0.5 + v, 0.25 - u], axis=1)[QUAD_FACES], atol=1e-6)


@pytest.mark.parametrize("how", [{"texCoord": 1}, {"extensions": {"KHR_texture_transform": {"texCoord": 1}}}])
def test_gltf_second_set_of_coordinates(tmp_path, how):
    file = write_glb(
        tmp_path / "a.glb", QUAD, QUAD_FACES, uv=np.zeros((4, 2)), uv1=UV, material=textured(**how), image=png(PIXELS)
    )
    np.testing.assert_array_equal(read_mesh_file(file).mesh.paint.corner_uv, UV[QUAD_FACES])


def test_gltf_factor_and_vertex_colours_multiply_the_texture(tmp_path):
    material = textured()
    material["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 1, 1, 1]
    colours = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, uv=UV, colours=colours, material=material, image=png(PIXELS))
    paint = read_mesh_file(file).mesh.paint
    np.testing.assert_allclose(paint.corner_colour, (colours * [0.5, 1, 1])[QUAD_FACES])
    assert (paint.face_texture == 0).all()


@pytest.mark.parametrize("format", ["glb", "obj"])
def test_without_coordinates_a_texture_counts_by_its_mean(tmp_path, format):
    """Exporters write a black Kd with a map: a mesh without coordinates must not turn black, nor grey silently."""
    if format == "glb":
        file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, material=textured(), image=png(PIXELS))
    else:
        (tmp_path / "a b.png").write_bytes(png(PIXELS))
        library = "newmtl oak\nKd 0 0 0\nmap_Kd a b.png\n"
        file = write_obj(tmp_path / "a.obj", QUAD, QUAD_FACES, "mtllib a.mtl\nusemtl oak", library)
    read = read_mesh_file(file)
    scene = Scene(read.mesh, tuple(read.materials))
    wanted = srgb_to_linear(PIXELS / 255.0).mean(axis=(0, 1))
    np.testing.assert_allclose(flatten(scene)[0].reflectance, np.broadcast_to(wanted, (2, 3)), atol=1e-6)
    (note,) = (n for n in read.notes if "no texture coordinates" in n)
    assert note.startswith('material "oak": ')


def test_equal_images_are_stored_once(tmp_path):
    """Two files and two samplers share the pixels of one image."""
    (tmp_path / "t.png").write_bytes(png(PIXELS))
    kept = []
    for name in "ab":
        file = write_glb(
            tmp_path / f"{name}.glb", QUAD, QUAD_FACES, uv=UV, material=textured(),
            images=[{"uri": "t.png"}], textures=[{"source": 0}],
        )  # fmt: skip
        kept.append(read_mesh_file(file).mesh.paint.textures[0].pixels)
    assert kept[0] is kept[1] is decode(png(PIXELS), "t.png", Boundary(tmp_path)).pixels


BAD_IMAGES = {
    "missing": (None, "wood.png is missing"),
    "damaged": (png(PIXELS)[:45], "wood.png is not a readable image"),
    "text": (b"hello", "wood.png is not a readable image"),
    "huge": (huge_png(), f"wood.png declares more than {MOST_IMAGE_PIXELS:,} pixels"),
    "vast": (huge_png(9000, 9000), f"wood.png declares 9000 x 9000 pixels, more than {MOST_IMAGE_PIXELS:,}"),
}


@pytest.mark.parametrize("kind", BAD_IMAGES)
@pytest.mark.parametrize("format", ["glb", "obj"])
def test_unreadable_texture_is_grey_and_adds_a_note(tmp_path, kind, format):
    data, sentence = BAD_IMAGES[kind]
    if data is not None:
        (tmp_path / "wood.png").write_bytes(data)
    read = read_mesh_file(quad_with(tmp_path, format, "wood.png"))
    (note,) = [n for n in read.notes if "texture" in n]
    assert note.startswith("surfaces are grey 0.7 where a texture is missing: ") and sentence in note
    surfaces, _ = flatten(Scene(read.mesh, tuple(read.materials)))
    np.testing.assert_allclose(surfaces.reflectance, 0.7, rtol=1e-6)


@pytest.mark.parametrize("format", ["glb", "obj"])
def test_images_outside_the_folder_are_not_read(tmp_path, format):
    inner = tmp_path / "scene"
    inner.mkdir()
    (tmp_path / "secret.png").write_bytes(png(PIXELS))
    for name in ("../secret.png", str(tmp_path / "secret.png")):
        read = read_mesh_file(quad_with(inner, format, name))
        assert any("lies outside the folder of the scene; move it there" in n for n in read.notes), read.notes
    (inner / "secret.png").write_bytes(png(PIXELS))
    assert read_mesh_file(quad_with(inner, format, "C:\\maps\\secret.png")).mesh.paint.textures


def quad_with(folder, format, image: str):
    if format == "glb":
        return write_glb(
            folder / "a.glb", QUAD, QUAD_FACES, uv=UV, material=textured(),
            images=[{"uri": image}], textures=[{"source": 0}],
        )  # fmt: skip
    return quad_obj(folder, f"Kd 0 0 0\nmap_Kd {image}\n")


def quad_obj(folder, material: str):
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in QUAD), *(f"vt {u} {v}" for u, v in UV), "usemtl m"]
    (folder / "a.obj").write_text("\n".join([*lines, "f 1/1 2/2 3/3 4/4"]) + "\n")
    (folder / "a.mtl").write_text(f"newmtl m\n{material}")
    return folder / "a.obj"


def test_obj_texture_options_and_names_with_spaces(tmp_path):
    """v runs upwards in OBJ: v' = 1 - (scale v + offset)."""
    (tmp_path / "old oak.png").write_bytes(png(PIXELS))
    file = quad_obj(tmp_path, "map_Kd -blendu on -s 2 3 1 -o 0.5 0.25 -mm 0 1 -clamp on old oak.png\nKd 0.1 0.1 0.1\n")
    paint = read_mesh_file(file).mesh.paint
    assert paint.textures[0].wrap == ("clamp", "clamp")
    np.testing.assert_array_equal(paint.textures[0].pixels, PIXELS)
    np.testing.assert_allclose(paint.corner_uv, (UV * [2, -3] + [0.5, 0.75])[QUAD_FACES], atol=1e-6)
    np.testing.assert_array_equal(paint.corner_colour, 1)


def test_obj_emissive_texture(tmp_path):
    (tmp_path / "glow.png").write_bytes(png(np.full((2, 2, 3), 188, np.uint8)))
    (material,) = read_mesh_file(quad_obj(tmp_path, "Kd 0 0 0\nKe 10 20 0\nmap_Ke glow.png\n")).materials
    np.testing.assert_allclose(material.emission, (5.03, 10.06, 0), atol=0.01)


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGBA", "I;16", "CMYK"])
def test_every_kind_of_pixel_becomes_rgb(tmp_path, mode):
    grey = np.tile(np.arange(0, 256, 16, dtype=np.uint8), (4, 1))
    image = Image.fromarray(grey.astype(np.uint16) * 257) if mode == "I;16" else Image.fromarray(grey).convert(mode)
    data = io.BytesIO()
    image.save(data, "jpeg" if mode == "CMYK" else "png")
    pixels = decode(data.getvalue(), "a", Boundary(tmp_path)).pixels
    assert pixels.shape == (4, 16, 3) and pixels.dtype == np.uint8
    assert np.abs(pixels.astype(int) - grey[..., None]).max() <= 3


@pytest.mark.parametrize("kind", ["EPS", "PDF", "TIFF", "GIF", "PPM", "ICNS"])
def test_other_formats_are_not_opened(tmp_path, monkeypatch, kind):
    """Pillow passes PostScript to Ghostscript, for any file name."""
    run = []
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", lambda *_, **__: run.append(kind))
    Image.fromarray(PIXELS).resize((16, 16)).save(tmp_path / "wood.png", kind)
    (note,) = [n for n in read_mesh_file(quad_with(tmp_path, "obj", "wood.png")).notes if "texture" in n]
    assert "wood.png is not a readable image" in note and not run


@pytest.mark.parametrize("kind", FORMATS)
def test_formats_of_images(tmp_path, kind):
    Image.fromarray(np.full((4, 4, 3), 99, np.uint8)).save(tmp_path / "wood.png", kind)
    (texture,) = read_mesh_file(quad_with(tmp_path, "obj", "wood.png")).mesh.paint.textures
    assert np.abs(texture.pixels.astype(int) - 99).max() <= 2


def test_every_image_is_opened_by_its_formats():
    """One call without `formats` opens any file with any plugin of Pillow."""
    root = Path(__file__).parents[2]
    calls = [line for p in ("app", "gi_core") for f in (root / p).rglob("*.py") for line in f.read_text().splitlines()]
    opened = [line for line in calls if "Image.open(" in line]
    assert opened and all("formats=" in line for line in opened)


def test_pixels_of_all_images_are_bounded(tmp_path, monkeypatch):
    """Each picture counts once; copies with holes count again."""
    monkeypatch.setitem(LIMITS, "pixels", 40)
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in QUAD), *(f"vt {u} {v}" for u, v in UV)]
    for i in range(4):
        (tmp_path / f"{i}.png").write_bytes(png(PIXELS + i % 3))
        lines += [f"usemtl m{i}", "f 1/1 2/2 3/3 4/4"]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "a.mtl").write_text("".join(f"newmtl m{i}\nmap_Kd {i}.png\n" for i in range(4)))
    read = read_mesh_file(tmp_path / "a.obj")
    assert len(read.mesh.paint.textures) == 3  # 0, 1 and 3, which equals 0
    (note,) = [n for n in read.notes if "texture" in n]
    assert "2.png: a scene must have no more than 40 pixels, got 48" in note


def test_a_scene_file_keeps_textures_or_replaces_them(tmp_path):
    """A reflectance under [materials] replaces the texture; other keys leave it."""
    (tmp_path / "t.png").write_bytes(png(PIXELS))
    quad_obj(tmp_path, "map_Kd t.png\n")
    lamp = '[[light]]\ntype = "point"\nposition = [0.5, 0.5, 2]\nflux = [1, 1, 1]\n'
    text = '[static]\nmesh = "a.obj"\nmax_edge = 10\n[camera]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\n' + lamp
    (tmp_path / "a.toml").write_text(text + "[materials.m]\ntwo_sided = false\n")
    (tmp_path / "b.toml").write_text(text + "[materials.m]\nreflectance = [0.2, 0.3, 0.4]\n")
    kept, replaced = (load_scene(tmp_path / f"{name}.toml").static.paint for name in "ab")
    assert (kept.face_texture == 0).all()
    assert (replaced.face_texture == -1).all()
    np.testing.assert_allclose(mean_colours(replaced), [[0.2, 0.3, 0.4]] * 2, rtol=1e-6)


def test_a_bare_file_carries_its_texture_through_completion(tmp_path):
    """Default lamp, tessellation, a mobile: the textured quad is still textured, the lamp is not."""
    (tmp_path / "t.png").write_bytes(png(PIXELS))
    file = quad_obj(tmp_path, "map_Kd t.png\n")
    scene = load_scene(file, mobiles=[file], up="z")
    lamp = next(i for i, m in enumerate(scene.materials) if m.name == "default light")
    is_lamp = scene.static.face_material == lamp
    assert is_lamp.any() and len(scene.static.faces) > 100
    assert ((scene.static.paint.face_texture >= 0) == ~is_lamp).all()
    assert (scene.mobiles[0].mesh.paint.face_texture == 0).all()
    assert scene.mobiles[0].mesh.paint.textures[0].pixels is scene.static.paint.textures[0].pixels


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


@pytest.mark.parametrize("shape", [(8, 8), (13, 7), (1, 5), (6, 1), (1, 1)])
def test_every_scale_has_the_same_mean(shape):
    """Halving keeps the linear mean: to the rounding of a byte, also where a side is odd."""
    chain = levels(Texture(RNG.integers(0, 256, (*shape, 3), dtype=np.uint8)))
    assert chain[-1].shape == (1, 1, 3)
    for smaller, larger in zip(chain[1:], chain, strict=False):
        assert smaller.shape[:2] == tuple(max(n // 2, 1) for n in larger.shape[:2])
    for level in chain:
        np.testing.assert_allclose(mean_linear(level), mean_linear(chain[0]), atol=4e-3)


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
