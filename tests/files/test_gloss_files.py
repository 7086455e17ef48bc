"""Gloss in files: glTF metallic-roughness and its extensions, MTL, and [materials.NAME] of a scene file."""

import numpy as np
import pytest

from gi_core.bsdf.ggx import base_albedo, further_albedo, gloss_albedo, under_gloss
from gi_core.bsdf.models import lobe
from gi_core.files.formats.metallic_roughness import MATTE, as_metal_rough, metallic_roughness
from gi_core.files.load import load_scene
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Gloss, Material
from tests.support.mesh_writers import write_glb

OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n"


def gltf_material(tmp_path, pbr: dict, **extensions):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    material = {"name": "m", "pbrMetallicRoughness": pbr, "extensions": extensions}
    write_glb(tmp_path / "a.glb", positions, np.array([0, 1, 2], np.uint32), material=material)
    scene = load_scene(tmp_path / "a.glb")
    return next(m for m in scene.materials if m.name == "m")


def test_gltf_plastic_mixes_with_metal(tmp_path):
    pbr = {"baseColorFactor": [0.8, 0.4, 0.2, 1], "metallicFactor": 0.25, "roughnessFactor": 0.3}
    found = gltf_material(tmp_path, pbr)
    assert found.gloss.f0 == pytest.approx((0.23, 0.13, 0.08)) and found.gloss.alpha == pytest.approx(0.09)
    # The coat alone lets 0.93 of the light through, the mixture 0.75: the base of 3/4 the colour is that much larger.
    lobes = np.array([[0.04, 0.04, 0.04, 1.0, 0.09], [*found.gloss.f0, 1.0, 0.09], [0.8, 0.4, 0.2, 1.0, 0.09]])
    (through, mixed, _), further = under_gloss(lobes), further_albedo(lobes)
    assert through == pytest.approx(0.93, abs=0.01) and mixed == pytest.approx(0.75, abs=0.01)
    parts = 0.75 * (np.array((0.8, 0.4, 0.2)) * (through - further[0]) + further[0]) + 0.25 * further[2]
    assert found.reflectance == pytest.approx((parts - further[1]) / (mixed - further[1]))
    assert as_metal_rough(np.array(found.reflectance), found.gloss).metallic == pytest.approx(0.25)


@pytest.mark.parametrize("metallic", [0.0, 0.25, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("roughness", [0.1, 0.5, 0.8])
def test_a_mixture_reflects_the_sum_of_its_parts(metallic, roughness):
    """glTF: metallic of the light meets metal, the rest a coated base; their hemispherical albedos add up so."""

    def albedo(m):
        found = metallic_roughness(Material("m", (0.8, 0.4, 0.2)), m, roughness)
        lobe = np.array([[*found.gloss.f0, found.gloss.f90, found.gloss.alpha]])
        return (base_albedo(lobe, np.array([found.reflectance])) + gloss_albedo(lobe))[0]

    assert albedo(metallic) == pytest.approx(metallic * albedo(1.0) + (1 - metallic) * albedo(0.0), rel=1e-9)


@pytest.mark.parametrize("metallic", [0.05, 0.25, 0.5, 0.75, 0.95, 1.0])
@pytest.mark.parametrize("roughness", [0.1, 0.5, 0.8, 1.0])
def test_a_mixture_is_parted_again(metallic, roughness):
    material = metallic_roughness(Material("m", (0.8, 0.4, 0.2)), metallic, roughness)
    found = as_metal_rough(np.array(material.reflectance), material.gloss)
    assert found.metallic == pytest.approx(metallic, abs=1e-5)
    assert found.base == pytest.approx((0.8, 0.4, 0.2), abs=1e-4)


@pytest.mark.parametrize("metallic", [0.5, 1.0])
def test_light_of_rough_metal_has_no_step(tmp_path, metallic):
    """Albedo falls with roughness, by less than 0.03 per 0.05, up to roughness 1."""
    albedos = []
    for k in range(11):
        pbr = {"baseColorFactor": [0.8, 0.5, 0.2, 1], "metallicFactor": metallic, "roughnessFactor": 0.5 + 0.05 * k}
        found = gltf_material(tmp_path, pbr)
        lobe = np.array([[*found.gloss.f0, found.gloss.f90, found.gloss.alpha]])
        albedos.append((base_albedo(lobe, np.array([found.reflectance])) + gloss_albedo(lobe))[0])
    steps = -np.diff(albedos, axis=0)
    assert (steps > 0).all() and (steps < 0.03).all()


def test_a_material_without_a_choice_is_diffuse(tmp_path):
    """The format's default is metal of roughness 1: files that name neither mean paint."""
    found = gltf_material(tmp_path, {"baseColorFactor": [0.8, 0.5, 0.2, 1]})
    assert found.gloss is None and found.reflectance == pytest.approx((0.8, 0.5, 0.2))
    assert gltf_material(tmp_path, {"metallicFactor": 1.0}).gloss.alpha == 1.0


def test_gltf_ior_and_specular(tmp_path):
    pbr = {"metallicFactor": 0.0, "roughnessFactor": 0.2}
    ior, specular = {"ior": 2.0}, {"specularFactor": 0.5, "specularColorFactor": [1.0, 0.5, 0.0]}
    found = gltf_material(tmp_path, pbr, KHR_materials_ior=ior, KHR_materials_specular=specular)
    assert found.gloss.f0 == pytest.approx((0.5 / 9, 0.25 / 9, 0.0)) and found.gloss.f90 == 0.5


@pytest.mark.parametrize("roughness, glossy", [(MATTE - 0.01, True), (MATTE, False)])
def test_gltf_rough_plastic_is_matte(tmp_path, roughness, glossy):
    found = gltf_material(tmp_path, {"metallicFactor": 0.0, "roughnessFactor": roughness})
    assert (found.gloss is not None) == glossy


@pytest.mark.parametrize(
    "lines, reflectance, gloss",
    [
        ("Kd .5 .4 .3\nPr .5\nPm 0", (0.5, 0.4, 0.3), Gloss((0.04,) * 3, 0.25)),
        ("Kd .5 .4 .3\nPr .2\nPm 1", (0.0, 0.0, 0.0), Gloss((0.5, 0.4, 0.3), pytest.approx(0.04))),
        ("Kd .9 .4 .3\nKs .3 .2 .2\nNs 48", (0.7, 0.4, 0.3), Gloss((0.3, 0.2, 0.2), pytest.approx(0.2), 0.3)),
        ("Kd .9 .4 .3\nKs .3 .2 .2\nNs 48\nillum 1", (0.9, 0.4, 0.3), None),
        ("Kd .5 .4 .3\nKs 0 0 0\nNs 48", (0.5, 0.4, 0.3), None),
    ],
)
def test_mtl(tmp_path, lines, reflectance, gloss):
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.mtl").write_text(f"newmtl m\n{lines}\n")
    found = next(m for m in load_scene(tmp_path / "a.obj").materials if m.name == "m")
    assert found.reflectance == pytest.approx(reflectance) and found.gloss == gloss


def scene_file(tmp_path, lines: str):
    (tmp_path / "a.obj").write_text(OBJ.replace("mtllib a.mtl\n", ""))
    text = f'[static]\nmesh = "a.obj"\n[materials.m]\n{lines}\n'
    (tmp_path / "a.toml").write_text(text + '[[light]]\ntype = "point"\nposition = [0, 0, 1]\nflux = [1, 1, 1]\n')
    return next(m for m in load_scene(tmp_path / "a.toml").materials if m.name == "m")


def test_scene_file(tmp_path):
    found = scene_file(tmp_path, "reflectance = [0.6, 0.5, 0.4]\nroughness = 0.5\nior = 2.0")
    assert found.gloss == Gloss(pytest.approx((1 / 9,) * 3), 0.25) and found.reflectance == (0.6, 0.5, 0.4)


def test_scene_file_with_a_model(tmp_path):
    found = scene_file(tmp_path, 'brdf = "ward"\nkd = [0.2, 0.1, 0.1]\nks = 0.3\nax = 0.1\nay = 0.4\ngrain = [0, 0, 1]')
    assert found.brdf == (lobe("ward", {"kd": (0.2, 0.1, 0.1), "ks": 0.3, "ax": 0.1, "ay": 0.4}),)
    assert found.grain == (0.0, 0.0, 1.0) and not found.scaled


def test_scene_file_with_a_linear_combination(tmp_path):
    parts = 'brdf = [{ model = "lewis", ks = 0.3, kd = 0.2 }, { model = "oren_nayar", factor = 0.5 }]\nscale = true'
    found = scene_file(tmp_path, parts)
    assert found.brdf == (lobe("lewis", {"ks": 0.3, "kd": 0.2}), lobe("oren_nayar", {}, 0.5)) and found.scaled


def test_a_darkened_model_is_noted(tmp_path):
    """In the notes of the scene, which info and the window show; a model that needs no darkening has none."""
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.mtl").write_text("newmtl m\n")
    start = 'material "m": phong reflects more light than arrives, '
    for ks, noted in ((1.0, [True]), (0.1, [])):
        lines = f'brdf = "phong"\nks = {ks}\nkd = 0.0\nscale = true'
        (tmp_path / "a.toml").write_text(f'[static]\nmesh = "a.obj"\n[materials.m]\n{lines}\n')
        notes = [note for note in load_scene(tmp_path / "a.toml").notes if "darkened" in note]
        assert [note.startswith(start) for note in notes] == noted


def test_a_model_that_reflects_more_than_arrives_is_refused(tmp_path):
    with pytest.raises(SceneError, match='a.toml: material "m": .*scale = true'):
        scene_file(tmp_path, 'brdf = "phong"\nks = 1.0\nkd = 0.0')
    assert scene_file(tmp_path, 'brdf = "phong"\nks = 1.0\nkd = 0.0\nscale = true').scaled


@pytest.mark.parametrize(
    "pbr, extensions, said",
    [
        ({"roughnessFactor": "a"}, {}, "roughnessFactor must be a number from 0 to 1, got 'a'"),
        ({"metallicFactor": None}, {}, "metallicFactor must be a number from 0 to 1, got None"),
        ({"metallicFactor": True}, {}, "metallicFactor must be a number from 0 to 1, got True"),
        ({"baseColorFactor": [1, 1]}, {}, "baseColorFactor must be four numbers from 0 to 1, got [1, 1]"),
        ({"metallicRoughnessTexture": 3}, {}, "metallicRoughnessTexture must be an object, got 3"),
        ([], {}, "pbrMetallicRoughness must be an object, got []"),
        ({}, {"KHR_materials_ior": {"ior": []}}, "ior must be a number from 1 to 1e+15 or 0, got []"),
        ({}, {"KHR_materials_specular": 1}, "KHR_materials_specular must be an object, got 1"),
        (
            {},
            {"KHR_materials_specular": {"specularColorFactor": [None, 1, 1]}},
            "specularColorFactor must be three numbers from 0 to 1e+15, got [None, 1, 1]",
        ),
    ],
)
def test_bad_gloss_of_gltf(tmp_path, pbr, extensions, said):
    with pytest.raises(SceneError) as error:
        gltf_material(tmp_path, pbr, **extensions)
    assert str(error.value).startswith(f'{tmp_path / "a.glb"}: material "m": {said}; ')
    assert str(error.value).endswith("export it again")


def gltf_notes(tmp_path, pbr: dict, **extensions) -> tuple[str, ...]:
    gltf_material(tmp_path, pbr, **extensions)
    return load_scene(tmp_path / "a.glb").notes


def test_values_of_gltf_beyond_their_range_are_noted(tmp_path):
    pbr = {"metallicFactor": 2, "roughnessFactor": -1, "baseColorFactor": [0.5, 0.5, 0.5, 1]}
    notes = gltf_notes(tmp_path, pbr, KHR_materials_specular={"specularColorFactor": [-1, 1, 1]})
    for key, rule in (
        ("metallicFactor", "a number from 0 to 1"),
        ("roughnessFactor", "a number from 0 to 1"),
        ("specularColorFactor", "three numbers from 0 to 1e+15"),
    ):
        assert f"{key} must be {rule}: limited in m" in notes
    assert not any("limited" in note for note in gltf_notes(tmp_path, {"metallicFactor": 1, "roughnessFactor": 0}))


def test_gltf_ior_of_0_reflects_everything(tmp_path):
    """KHR_materials_ior: F is 1 times the specular colour, for files converted from specular-glossiness."""
    pbr, specular = {"metallicFactor": 0.0, "roughnessFactor": 0.2}, {"specularColorFactor": [0.3, 0.2, 0.1]}
    found = gltf_material(tmp_path, pbr, KHR_materials_ior={"ior": 0}, KHR_materials_specular=specular)
    assert found.gloss.f0 == pytest.approx((0.3, 0.2, 0.1))


@pytest.mark.parametrize("index", [7, -1, "m", True])
def test_a_material_that_gltf_does_not_have(tmp_path, index):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "material": index}
    meshes = [{"primitives": [primitive]}]
    write_glb(tmp_path / "a.glb", positions, np.array([0, 1, 2], np.uint32), material={"name": "m"}, meshes=meshes)
    with pytest.raises(SceneError, match="mesh 0 primitive 0 must name a material by its number, 0 to 0, got "):
        load_scene(tmp_path / "a.glb")


def mtl_notes(tmp_path, lines: str) -> tuple[str, ...]:
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.mtl").write_text(f"newmtl m\n{lines}\n")
    return load_scene(tmp_path / "a.obj").notes


@pytest.mark.parametrize(
    "line, note",
    [
        ("Pr 2", "Pr must be a number from 0 to 1: limited in m"),
        ("Pm -1", "Pm must be a number from 0 to 1: limited in m"),
        ("Pr rough", "Pr must be a number from 0 to 1: left out in m"),
        ("Ns -5", "Ns must be a number from 0 to 1e+06: limited in m"),
        ("Ks 2 0 0", "Ks must be three numbers from 0 to 1: limited in m"),
        ("Kd -1 0 0", "Kd must be three numbers >= 0: limited in m"),
        ("Kd a b c", "Kd must be three numbers >= 0: left out in m"),
        ("Ks nan 0 0", "Ks must be three numbers from 0 to 1: left out in m"),
    ],
)
def test_values_of_mtl_beyond_their_range_are_noted(tmp_path, line, note):
    assert note in mtl_notes(tmp_path, line)
