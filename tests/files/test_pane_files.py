"""Panes of scene files, OBJ and glTF, and in a baked glTF."""

import json

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Pane
from tests.support.mesh_writers import write_glb

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"


def loaded(path):
    """Return the only material of a file, and the notes about it."""
    scene = load_scene(path)
    notes = " ".join(note for note in scene.notes if "glass" in note or "transparent" in note)
    return next(m for m in scene.materials if m.name == "m"), notes


def mtl(tmp_path, lines: str):
    (tmp_path / "a.mtl").write_text(f"newmtl m\nKd 0.5 0.5 0.5\n{lines}\n")
    (tmp_path / "a.obj").write_text(OBJ)
    return loaded(tmp_path / "a.obj")


@pytest.mark.parametrize(
    "lines, pane",
    [
        ("d 0.2", Pane((0.9, 0.9, 0.9))),
        ("Tr 0.8\nNi 1.7", Pane((0.9, 0.9, 0.9), 1.7)),
        ("illum 4", Pane()),
        ("illum 7\nNi 1.33", Pane(ior=1.33)),
        ("illum 9\nTf 0.8 0.9 1", Pane((0.8, 0.9, 1.0))),
        ("d 0.5\nTf 0.2", Pane((0.2, 0.2, 0.2))),
        ("illum 6\nNi 0.001", Pane()),
        ("d 0.95", None),
        ("d 1\nillum 7", None),
        ("d 0", None),
        ("d 0.2\nKe 1 1 1", None),
        ("d 0.2\nmap_Kd none.png", None),
        ("illum 2", None),
    ],
)
def test_obj(tmp_path, lines, pane):
    read, notes = mtl(tmp_path, lines)
    assert (read.pane is None) == (pane is None), notes
    assert ("glass" in notes) == (pane is not None)
    assert ("opaque" in notes) == (pane is None and "0.2" in lines or "0.95" in lines)
    if pane is not None:
        assert read.two_sided and read.reflectance == (0.0, 0.0, 0.0)
        assert read.pane.transmittance == pytest.approx(pane.transmittance)
        assert read.pane.ior == pane.ior


def glb(tmp_path, **more):
    pbr = {"baseColorFactor": [0.5, 0.6, 0.7, 1.0], **more.pop("pbr", {})}
    described = {"name": "m", "pbrMetallicRoughness": pbr, **more}
    write_glb(tmp_path / "a.glb", TRIANGLE, np.array([0, 1, 2], np.uint32), material=described)
    return loaded(tmp_path / "a.glb")


def transmission(share: float, **others) -> dict:
    return {"KHR_materials_transmission": {"transmissionFactor": share}, **others}


@pytest.mark.parametrize(
    "more, transmittance, said",
    [
        ({"extensions": transmission(1.0), "pbr": {"roughnessFactor": 0.0}}, (0.5, 0.6, 0.7), ""),
        ({"extensions": transmission(0.8), "pbr": {"roughnessFactor": 0.1}}, (0.4, 0.48, 0.56), ""),
        ({"extensions": transmission(1.0), "pbr": {"roughnessFactor": 0.6}}, (0.5, 0.6, 0.7), "clear though rough"),
        ({"extensions": transmission(0.3)}, None, "opaque"),
        ({"alphaMode": "BLEND", "pbr": {"baseColorFactor": [0.5, 1, 1, 0.2]}}, (0.9, 1.0, 1.0), ""),
        ({"alphaMode": "BLEND", "pbr": {"baseColorFactor": [0.5, 1, 1, 0.95]}}, None, "opaque"),
        ({"alphaMode": "BLEND", "emissiveFactor": [1, 1, 1], "pbr": {"baseColorFactor": [1, 1, 1, 0.2]}}, None,
         "opaque"),
        ({"alphaMode": "OPAQUE", "pbr": {"baseColorFactor": [0.5, 1, 1, 0.2]}}, None, ""),
    ],
)  # fmt: skip
def test_gltf(tmp_path, more, transmittance, said):
    read, notes = glb(tmp_path, **more)
    assert said in notes
    assert (read.pane is None) == (transmittance is None)
    if transmittance is not None:
        assert read.pane.transmittance == pytest.approx(transmittance)


def test_gltf_index_and_volume(tmp_path):
    volume = {"KHR_materials_ior": {"ior": 1.33}, "KHR_materials_volume": {"thicknessFactor": 0.1}}
    read, notes = glb(tmp_path, extensions=transmission(1.0, **volume))
    assert read.pane.ior == 1.33
    assert "thin though solid" in notes


def scene_file(tmp_path, table: str):
    (tmp_path / "a.mtl").write_text("newmtl m\nd 0.2\n")
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.toml").write_text(f'[static]\nmesh = "a.obj"\nmax_edge = 10\n[materials.m]\n{table}\n')
    return tmp_path / "a.toml"


@pytest.mark.parametrize(
    "table, pane",
    [
        ("pane = true", Pane()),
        ("pane = true\ntransmittance = [0.1, 0.2, 0.3]\nior = 1.6", Pane((0.1, 0.2, 0.3), 1.6)),
        ("pane = false", None),
        ("reflectance = [0.5, 0.5, 0.5]", None),
        ("roughness = 0.2", None),
    ],
)
def test_scene_file_replaces_the_pane_of_a_mesh(tmp_path, table, pane):
    assert loaded(scene_file(tmp_path, table))[0].pane == pane


def test_a_pane_of_a_file_has_no_emission(tmp_path):
    with pytest.raises(SceneError, match=r"a\.toml.*a pane has no emission"):
        load_scene(scene_file(tmp_path, "emission = [1, 1, 1]"))


def test_baked_panes_are_read_as_they_were(tmp_path):
    from app.__main__ import main

    path = scene_file(tmp_path, "pane = true\ntransmittance = [0.1, 0.2, 0.3]\nior = 1.6")
    light = '[[light]]\nname = "sun"\ntype = "directional"\ndirection = [0.1, 0.2, -1]\nirradiance = [1, 1, 1]\n'
    path.write_text(path.read_text() + light)
    main(["bake", str(path), "--photons", "1000", "--out", str(tmp_path / "b.glb")])
    data = (tmp_path / "b.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert "KHR_materials_transmission" in document["extensionsUsed"]
    read = next(m for m in load_scene(tmp_path / "b.glb").materials if m.name == "m")
    assert read.pane.transmittance == pytest.approx((0.1, 0.2, 0.3))
    assert read.pane.ior == pytest.approx(1.6)
