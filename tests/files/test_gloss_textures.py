"""Textures of gloss in glTF and MTL: triangles share materials of the means of their textures."""

import numpy as np
import pytest

from gi_core.bsdf.ggx import base_albedo
from gi_core.files.edits import Insert, edited
from gi_core.files.formats.classes import ALIKE, MOST_CLASSES, classes
from gi_core.files.formats.metallic_roughness import metallic_roughness
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import flatten
from gi_core.geometry.texture_filter import levels, mean_colours
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Material, Texture
from tests.files.test_texture_files import UV, png
from tests.support.mesh_writers import QUAD, QUAD_FACES, write_glb

BASE = (0.8, 0.5, 0.25)


def image(roughness: np.ndarray, metallic: np.ndarray) -> np.ndarray:
    """Return the pixels of a texture of shares (h, w); red is no part of it."""
    shares = np.stack([np.full(roughness.shape, 0.37), roughness, metallic], axis=2)
    return np.round(255 * shares).astype(np.uint8)


def halves() -> np.ndarray:
    """A texture whose left half is metal of roughness 0.2, and whose right half is plastic of 0.4."""
    left = np.arange(64) < 32
    return image(*(np.tile(np.where(left, a, b), (64, 1)) for a, b in ((0.2, 0.4), (1.0, 0.0))))


def quad_file(folder, pixels, name="a.glb", uv=UV, transform=None, **pbr):
    extensions = {} if transform is None else {"extensions": {"KHR_texture_transform": transform}}
    factors = {"baseColorFactor": [*BASE, 1], "metallicRoughnessTexture": {"index": 0, **extensions}}
    material = {"name": "m", "doubleSided": True, "pbrMetallicRoughness": factors | pbr}
    return write_glb(folder / name, QUAD, QUAD_FACES, uv=uv, material=material, image=png(pixels))


def worn(mesh, scene) -> list[Material]:
    """Return the material of each face of the file's own material."""
    return [scene.materials[k] for k in mesh.face_material if scene.materials[k].name == "m"]


def places(mesh, scene) -> np.ndarray:
    named = [scene.materials[k].name == "m" for k in mesh.face_material]
    return mesh.vertices[mesh.faces[named]].mean(axis=1)


def test_gloss_follows_the_texture(tmp_path):
    scene = load_scene(quad_file(tmp_path, halves()), max_edge=0.1)
    middles, materials = places(scene.static, scene), worn(scene.static, scene)
    metal = metallic_roughness(Material("m", BASE), 1.0, 0.2)
    plastic = metallic_roughness(Material("m", BASE), 0.0, 0.4)
    apart = np.abs(middles[:, 0] - 0.5) > 0.07  # faces that lie in one half
    assert apart.sum() > 100
    for (x, *_), found in zip(middles[apart], np.array(materials, object)[apart], strict=True):
        gloss, reflectance = found[4], found[1]
        wanted = metal if x < 0.5 else plastic
        assert gloss.f0 == pytest.approx(wanted.gloss.f0, abs=0.01)
        assert gloss.alpha == pytest.approx(wanted.gloss.alpha, abs=0.01)
        assert reflectance == pytest.approx(wanted.reflectance, abs=0.04)


def test_large_triangles_have_one_mean_each(tmp_path):
    """The limit: without max_edge a quad of two triangles has one gloss per triangle."""
    scene = load_scene(quad_file(tmp_path, halves()), max_edge=np.inf)
    metals = sorted({m.gloss.f0[0] for m in worn(scene.static, scene)})
    # Half of the texels are metal. Its share of the lower right triangle is 1/4, of the other 3/4.
    assert metals == pytest.approx([0.25 * BASE[0] + 0.75 * 0.04, 0.75 * BASE[0] + 0.25 * 0.04], abs=0.01)


def test_classes_reflect_what_their_texels_would(tmp_path):
    """Sum over faces of area x F0 is that of the texels, and so is the diffuse part; there are MOST_CLASSES at most."""
    rng = np.random.default_rng(4)
    metallic = np.kron(rng.random((8, 8)), np.ones((8, 8)))
    pixels = image(np.full((64, 64), 0.3), metallic)
    scene = load_scene(quad_file(tmp_path, pixels), max_edge=0.05)
    surfaces, _ = flatten(scene)
    glossy = ~np.isnan(surfaces.lobe[:, 4])
    area = surfaces.areas[glossy]
    mean = area @ surfaces.lobe[glossy, :3] / area.sum()
    m = pixels[..., 2].mean() / 255
    assert mean == pytest.approx(m * np.array(BASE) + (1 - m) * 0.04, rel=2e-3)
    lobes = np.array([[0.04, 0.04, 0.04, 1.0, 0.09], [*BASE, 1.0, 0.09]])
    coated, metal = base_albedo(lobes, np.array([BASE, (0.0, 0.0, 0.0)]))
    base = area @ surfaces.reflectance[glossy] / area.sum()
    assert base == pytest.approx((1 - m) * coated + m * metal, rel=2e-3)
    assert 2 < sum(k.name == "m" for k in scene.materials) <= MOST_CLASSES


@pytest.mark.parametrize("roughness, metallic", [(0.4, 0.0), (0.2, 1.0), (0.6, 0.6), (0.8, 0.0)])
def test_an_even_texture_is_a_factor(tmp_path, roughness, metallic):
    even = image(np.full((4, 4), roughness), np.full((4, 4), metallic))
    (tmp_path / "b").mkdir()
    factors = {"baseColorFactor": [*BASE, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
    plain = {"name": "m", "doubleSided": True, "pbrMetallicRoughness": factors}
    write_glb(tmp_path / "b/a.glb", QUAD, QUAD_FACES, material=plain)
    found, wanted = (
        [m for m in load_scene(file).materials if m.name == "m"]
        for file in (quad_file(tmp_path, even), tmp_path / "b/a.glb")
    )
    assert len(found) == len(wanted) == 1
    assert found[0].reflectance == pytest.approx(wanted[0].reflectance, abs=1e-3)
    assert (found[0].gloss is None) == (wanted[0].gloss is None)
    if found[0].gloss is not None:
        assert found[0].gloss.f0 == pytest.approx(wanted[0].gloss.f0, abs=1e-3)
        assert found[0].gloss.alpha == pytest.approx(wanted[0].gloss.alpha, abs=1e-3)


def test_factors_and_transform_apply(tmp_path):
    """Shifted by half a texture the halves change places; factors of 1/2 halve roughness and metallic."""
    file = quad_file(tmp_path, halves(), transform={"offset": [0.5, 0.0]}, metallicFactor=0.5, roughnessFactor=0.5)
    scene = load_scene(file, max_edge=0.1)
    middles, materials = places(scene.static, scene), worn(scene.static, scene)
    at = int(np.argmin(np.abs(middles[:, :2] - (0.8, 0.5)).sum(axis=1)))
    assert materials[at].gloss.alpha == pytest.approx(0.01, abs=1e-3)
    assert materials[at].gloss.f0 == pytest.approx(0.5 * np.array(BASE) + 0.02, abs=0.01)


def test_without_coordinates_the_mean_counts(tmp_path):
    scene = load_scene(quad_file(tmp_path, halves(), uv=None), max_edge=0.2)
    (found,) = [m for m in scene.materials if m.name == "m"]
    assert found.gloss.f0 == pytest.approx(0.5 * np.array(BASE) + 0.02, abs=2e-3)
    assert found.gloss.alpha == pytest.approx(0.09, abs=1e-3)


def test_a_missing_texture_leaves_the_factors(tmp_path):
    file = quad_file(tmp_path, halves(), roughnessFactor=0.3)
    file.write_bytes(file.read_bytes().replace(b"\x89PNG", b"\x89PNX"))
    scene = load_scene(file)
    (found,) = [m for m in scene.materials if m.name == "m"]
    assert found.gloss.f0 == pytest.approx(BASE) and found.gloss.alpha == pytest.approx(0.09)
    assert any("gloss is even where its texture is missing" in note for note in scene.notes)


@pytest.mark.parametrize("line", ["roughness = 0.25", 'brdf = "lewis"'])
def test_a_scene_file_replaces_the_texture(tmp_path, line):
    quad_file(tmp_path, halves())
    (tmp_path / "a.toml").write_text(f'[static]\nmesh = "a.glb"\nmax_edge = 0.2\n[materials.m]\n{line}\n')
    (found,) = [m for m in load_scene(tmp_path / "a.toml").materials if m.name == "m"]
    assert found.varied is None
    assert found.brdf if "brdf" in line else found.gloss.alpha == pytest.approx(0.0625)


def test_mobiles_and_inserted_objects_follow_their_textures(tmp_path):
    file = quad_file(tmp_path, halves())
    scene = load_scene("cornell", mobiles=[file])
    scene = edited(scene, [Insert("another", str(file))])
    for mobile in scene.mobiles[-2:]:
        alphas = {round(m.gloss.alpha, 2) for m in worn(mobile.mesh, scene)}
        assert {0.04, 0.16} <= alphas and mobile.mesh.finish is None
    assert all(m.varied is None for m in scene.materials)


def test_a_colour_texture_gives_the_metal_its_colour(tmp_path):
    """One image as both textures: where green and blue say rough metal, they are its colour too."""
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[:, :32], pixels[:, 32:] = (255, 51, 255), (0, 51, 255)
    scene = load_scene(quad_file(tmp_path, pixels, baseColorTexture={"index": 0}), max_edge=0.1)
    middles, materials = places(scene.static, scene), worn(scene.static, scene)
    reds = np.array([m.gloss.f0[0] for m in materials])
    assert reds[middles[:, 0] < 0.4] == pytest.approx(0.98 * BASE[0], abs=0.01)
    assert reds[middles[:, 0] > 0.6] == pytest.approx(0.0, abs=0.01)


def specular_halves(tint=(255, 0, 0), strength=64) -> np.ndarray:
    """Return an image whose left half has these values of colour and alpha, and whose right half is white, opaque."""
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[:, :32] = (*tint, strength)
    return pixels


def specular_file(folder, pixels, textures, roughness=0.2, transform=None, **factors):
    """Write a quad of plastic whose textures of KHR_materials_specular are one image."""
    placed = {} if transform is None else {"extensions": {"KHR_texture_transform": transform}}
    specular = factors | {key: {"index": 0, **placed} for key in textures}
    pbr = {"baseColorFactor": [*BASE, 1], "metallicFactor": 0.0, "roughnessFactor": roughness}
    material = {"name": "m", "doubleSided": True, "pbrMetallicRoughness": pbr}
    material["extensions"] = {"KHR_materials_specular": specular}
    image_bytes = pixels if isinstance(pixels, bytes) else png(pixels)
    return write_glb(folder / "a.glb", QUAD, QUAD_FACES, uv=UV, material=material, image=image_bytes)


BOTH = "specularTexture", "specularColorTexture"


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_specular_textures_give_coats_of_their_texels(tmp_path, shift):
    """Alpha lowers F0 and F90, colour F0 alone; a shift by half a texture lets the halves change places."""
    transform = {"offset": [shift, 0.0]} if shift else None
    scene = load_scene(specular_file(tmp_path, specular_halves(), BOTH, transform=transform), max_edge=0.1)
    middles, materials = places(scene.static, scene), worn(scene.static, scene)
    a, seen = 64 / 255, set()
    for (x, *_), found in zip(middles, materials, strict=True):
        if abs(x - 0.5) > 0.07 and 0.07 < x < 0.93:
            left = (x < 0.5) != (shift > 0)
            wanted = (0.04 * a, 0.0, 0.0) if left else (0.04,) * 3
            assert found.gloss.f0 == pytest.approx(wanted, abs=1e-3)
            assert found.gloss.f90 == pytest.approx(a if left else 1.0, abs=0.02)
            assert found.reflectance == pytest.approx(BASE) and found.gloss.alpha == pytest.approx(0.04)
            seen.add(left)
    assert seen == {True, False}


@pytest.mark.parametrize("textures", [BOTH, BOTH[:1], BOTH[1:]])
def test_even_specular_textures_are_factors(tmp_path, textures):
    """sRGB 188 is 0.503 linear. One factor of 1.5 multiplies the texture before F0 is limited to 1."""
    even = np.full((4, 4, 4), 188, np.uint8)
    scene = load_scene(specular_file(tmp_path, even, textures, specularFactor=0.5, specularColorFactor=[1.5, 1, 0.2]))
    (found,) = [m for m in scene.materials if m.name == "m"]
    strength = 0.5 * (188 / 255 if BOTH[0] in textures else 1.0)
    tint = 0.503 if BOTH[1] in textures else 1.0
    assert found.gloss.f0 == pytest.approx(np.array([1.5, 1, 0.2]) * 0.04 * strength * tint, abs=1e-4)
    assert found.gloss.f90 == pytest.approx(strength, abs=1e-3)


def test_roughness_and_specular_in_one_image(tmp_path):
    """Roughness in green, strength in alpha."""
    pixels = np.empty((8, 8, 4), np.uint8)
    pixels[:] = (200, 102, 0, 51)
    pbr = {"baseColorFactor": [*BASE, 1], "roughnessFactor": 0.5, "metallicRoughnessTexture": {"index": 0}}
    extensions = {"KHR_materials_specular": {"specularTexture": {"index": 0}}}
    material = {"name": "m", "doubleSided": True, "pbrMetallicRoughness": pbr, "extensions": extensions}
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, uv=UV, material=material, image=png(pixels))
    (found,) = [m for m in load_scene(file).materials if m.name == "m"]
    assert found.gloss.alpha == pytest.approx(0.04) and found.gloss.f90 == pytest.approx(0.2)


@pytest.mark.parametrize("pixels", [b"no image", np.full((4, 4, 3), 99, np.uint8)])
def test_a_specular_texture_without_alpha_is_one(tmp_path, pixels):
    """An opaque image, and one that cannot be read, leave the factor; the latter has a note."""
    scene = load_scene(specular_file(tmp_path, pixels, BOTH[:1], specularFactor=0.5))
    (found,) = [m for m in scene.materials if m.name == "m"]
    assert found.gloss.f0 == pytest.approx((0.02,) * 3) and found.gloss.f90 == 0.5
    assert any("gloss is even" in note for note in scene.notes) == isinstance(pixels, bytes)


@pytest.mark.parametrize("key", ["metallicRoughnessTexture", "specularTexture", "specularColorTexture"])
@pytest.mark.parametrize("index", [7, -1, "wood"])
def test_a_texture_that_is_not_there_is_named(tmp_path, key, index):
    pbr = {"roughnessFactor": 0.2, "metallicFactor": 0.0}
    material = {"pbrMetallicRoughness": pbr, "extensions": {"KHR_materials_specular": {}}}
    (pbr if key.startswith("metallic") else material["extensions"]["KHR_materials_specular"])[key] = {"index": index}
    file = write_glb(tmp_path / "a.glb", QUAD, QUAD_FACES, uv=UV, material=material, image=png(specular_halves()))
    with pytest.raises(
        SceneError, match=r"a.glb: .*must name a texture by its number, 0 to 0, got .*; add the texture"
    ):
        load_scene(file)


def mtl_file(folder, lines: str, faces=("1/1 2/2 3/3", "1/1 3/3 4/4"), **images):
    """Write a quad whose material has the given lines, and images by name."""
    text = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in QUAD), *(f"vt {u} {1 - v}" for u, v in UV), "usemtl m"]
    (folder / "a.obj").write_text("\n".join([*text, *(f"f {face}" for face in faces)]) + "\n")
    (folder / "a.mtl").write_text(f"newmtl m\nKd {BASE[0]} {BASE[1]} {BASE[2]}\n{lines}\n")
    for name, pixels in images.items():
        (folder / f"{name}.png").write_bytes(png(pixels))
    return folder / "a.obj"


def grey(left: float, right: float) -> np.ndarray:
    """Return an image (64, 64) uint8 of two halves."""
    return np.round(255 * np.tile(np.where(np.arange(64) < 32, left, right), (64, 1))).astype(np.uint8)


@pytest.mark.parametrize("faces", [("1/1 2/2 3/3", "1/1 3/3 4/4"), ("1/1 2/2 3/3", "4/4 3/3 1/1")])
def test_mtl_maps_of_roughness_and_metallic(tmp_path, faces):
    """Each map has its own options: that of metallic is shifted by half. A face wound the other way keeps its place."""
    lines = "Pr 0.9\nPm 0.9\nmap_Pr rough.png\nmap_Pm -o 0.5 0 metal.png"
    file = mtl_file(tmp_path, lines, faces, rough=grey(0.2, 0.4), metal=grey(0.0, 1.0))
    scene = load_scene(file, max_edge=0.1)
    middles, materials = places(scene.static, scene), worn(scene.static, scene)
    metal, plastic = (
        metallic_roughness(Material("m", BASE), 1.0, 0.2),
        metallic_roughness(Material("m", BASE), 0.0, 0.4),
    )
    apart = (np.abs(middles[:, 0] - 0.5) > 0.07) & (np.abs(middles[:, 0] - 0.5) < 0.43)
    assert apart.sum() > 100
    for (x, *_), found in zip(middles[apart], np.array(materials, object)[apart], strict=True):
        wanted = metal if x < 0.5 else plastic
        assert found[4].f0 == pytest.approx(wanted.gloss.f0, abs=0.01)
        assert found[4].alpha == pytest.approx(wanted.gloss.alpha, abs=0.01)


@pytest.mark.parametrize(
    "lines, roughness, metallic",
    [
        ("map_Pr rough.png", 0.6, 0.0),
        ("Pr 0.1\nPm 0.3\nmap_Pr rough.png", 0.6, 0.3),
        ("Pr 0.1\nmap_Pm metal.png", 0.1, 0.8),
        ("map_Pr rough.png\nmap_Pm metal.png", 0.6, 0.8),
        ("Pr 0.1\nmap_Pr missing.png", 0.1, 0.0),
        ("Ks 1 1 1\nNs 90\nmap_Ks metal.png\nPr 0.3", 0.3, 0.0),
    ],
)
def test_even_mtl_maps_are_numbers(tmp_path, lines, roughness, metallic):
    scene = load_scene(mtl_file(tmp_path, lines, rough=grey(0.6, 0.6), metal=grey(0.8, 0.8)))
    (found,) = [m for m in scene.materials if m.name == "m"]
    wanted = metallic_roughness(Material("m", BASE), metallic, roughness)
    assert found.gloss.f0 == pytest.approx(wanted.gloss.f0) and found.gloss.alpha == pytest.approx(wanted.gloss.alpha)
    assert found.reflectance == pytest.approx(wanted.reflectance)
    assert any("missing.png is missing" in note for note in scene.notes) == ("missing" in lines)


def test_mtl_map_of_specular_colour(tmp_path):
    """map_Ks stands in place of Ks. sRGB 188 is 0.503; Ns of 48 is alpha 0.2."""
    scene = load_scene(mtl_file(tmp_path, "Ks 1 1 1\nNs 48\nmap_Ks ks.png", ks=grey(188 / 255, 0.0)), max_edge=0.1)
    middles, materials = places(scene.static, scene), worn(scene.static, scene)
    for (x, *_), found in zip(middles, materials, strict=True):
        if x < 0.43:
            assert found.gloss.f0 == pytest.approx((0.503,) * 3, abs=0.01) and found.gloss.alpha == pytest.approx(0.2)
            assert found.gloss.f90 == pytest.approx(0.503, abs=0.01)
        if x > 0.57:
            assert found.gloss is None or max(found.gloss.f0) < 0.02


def test_metal_of_a_painted_file_shows_its_further_reflections(tmp_path):
    """Faces of metal lose the texture of their base, and have the paint of light that facets reflect more than once."""
    pixels = np.full((8, 8, 3), (255, 230, 255), np.uint8)  # a base colour, and roughness 0.9 of metal
    scene = load_scene(quad_file(tmp_path, pixels, baseColorTexture={"index": 0}), max_edge=0.3)
    surfaces, _ = flatten(scene)
    glossy = ~np.isnan(surfaces.lobe[:, 4])
    wanted = base_albedo(surfaces.lobe[glossy], np.zeros((glossy.sum(), 3)))
    assert surfaces.reflectance[glossy] == pytest.approx(wanted, abs=1e-3) and wanted.min() > 0.01
    assert mean_colours(surfaces.paint[0])[glossy] == pytest.approx(surfaces.reflectance[glossy], abs=1e-6)


def test_classes_divide_where_values_vary():
    values = np.repeat([[0.1, 0.0], [0.1, 1.0], [0.9, 0.5]], 5, axis=0)
    found = classes(values, np.ones(15))
    assert len(np.unique(found)) == 3
    assert all(len(np.unique(found[k : k + 5])) == 1 for k in (0, 5, 10))
    assert (classes(values * ALIKE, np.ones(15)) == 0).all()
    assert classes(np.random.default_rng(1).random((500, 3)), np.ones(500)).max() == MOST_CLASSES - 1


def test_copies_of_a_linear_texture_have_its_mean():
    pixels = np.random.default_rng(2).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    assert levels(Texture(pixels, linear=True))[-1][0, 0] == pytest.approx(pixels.mean(axis=(0, 1)), abs=0.51)
