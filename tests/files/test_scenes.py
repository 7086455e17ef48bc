"""The shipped scenes agree with their comments; third-party scenes load, if present."""

import json
import os
import subprocess
import sys
from importlib import import_module, resources
from pathlib import Path

import numpy as np
import pytest

from gi_core.files.find import find_scene, shipped_scenes
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.formats.obj_file import read_obj
from gi_core.files.formats.texture_images import decode
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import mean_colours
from gi_core.scene import SceneError
from gi_core.scene.pose import pose_at, to_world
from scenes.cornell_spectra import GREEN, RED, WHITE, lamp_rgb, reflectance_rgb, to_rgb
from scenes.key_frames import written

SHARED = Path(__file__).parents[3] / "shared" / "scenes"
GENERATORS = tuple(
    f"make_{name}" for name in "classroom cornell furnace gallery living_room office second_tree showroom tree".split()
)
SHIPPED = {
    "classroom": 3, "cornell": 1, "furnace": 1, "gallery": 1, "living_room": 2, "office": 3, "second_tree": 1,
    "showroom": 2, "tree": 1,
}  # fmt: skip
SHIPPED["tree_worst"] = 1


def area(mesh) -> float:
    return float(face_normals(mesh)[1].sum())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes in folders")
def test_a_pipe_is_no_scene(tmp_path):
    """The sentence proposed the pipe's own name."""
    os.mkfifo(tmp_path / "room.toml")
    with pytest.raises(SceneError, match=r"room.toml: a scene is a file, this is a pipe, socket or device; shipped"):
        find_scene(tmp_path / "room.toml")


def test_shipped_scenes_are_found_by_name():
    assert shipped_scenes() == list(SHIPPED)
    assert find_scene("cornell").name == "cornell.toml"
    suggestion = (
        r"cornel: there is no such scene file; did you mean cornell\? shipped scenes are classroom, cornell, furnace"
    )
    with pytest.raises(SceneError, match=suggestion):
        find_scene("cornel")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load_without_notes(name):
    scene = load_scene(name)
    assert scene.notes == () and scene.camera is not None and len(scene.mobiles) == SHIPPED[name]


def rounded(value):
    """Return a JSON value with its numbers to 12 digits."""
    if isinstance(value, dict):
        return {name: rounded(part) for name, part in value.items()}
    if isinstance(value, list):
        return [rounded(part) for part in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def contents(data: bytes):
    """Return the JSON of a GLB, the bytes of its arrays, and the pixels of its images."""
    length = int.from_bytes(data[12:16], "little")
    said, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    views = [binary[v["byteOffset"] : v["byteOffset"] + v["byteLength"]] for v in said.pop("bufferViews")]
    arrays = [views[a["bufferView"]] for a in said["accessors"]]
    pixels = [decode(views[i.pop("bufferView")], "a", Boundary(".")).pixels.tobytes() for i in said.get("images", [])]
    del said["buffers"]
    return said, arrays, pixels


@pytest.mark.parametrize("generator", GENERATORS)
def test_generators_give_the_committed_files(generator):
    """Arrays byte for byte, images pixel for pixel; colours to the last digits, which differ between processors."""
    for name, data in import_module(f"scenes.{generator}").files().items():
        committed = (resources.files("scenes") / name).read_bytes()
        if not name.endswith(".glb"):
            assert committed == data, f"run python -m scenes.{generator}"
            continue
        (values, *rest), (others, *made) = contents(committed), contents(data)
        assert rest == made and rounded(values) == rounded(others), f"run python -m scenes.{generator}"
        assert len(committed) < 2e6, name


@pytest.mark.parametrize("generator", [g for g in GENERATORS if g not in ("make_classroom", "make_furnace")])
def test_generators_give_the_committed_paths(generator):
    """Written again, no scene file changes."""
    for name, path in import_module(f"scenes.{generator}").paths().items():
        text = (resources.files("scenes") / name).read_text()
        assert written(text, path) == text, f"run python -m scenes.{generator}"


def test_loading_a_scene_file_imports_no_trimesh():
    code = (
        "import sys, gi_core.files.load as s; assert 'trimesh' not in sys.modules; "
        "s.load_scene('cornell'); assert 'trimesh' not in sys.modules"
    )
    root = Path(str(resources.files("scenes"))).parent
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)


def test_cornell_colours_follow_the_measured_spectra():
    """Known linear sRGB of the measured reflectances under an equal-energy light, to 1 % of full scale."""
    known = [(WHITE, (0.885809, 0.698859, 0.666422)), (GREEN, (0.105421, 0.37798, 0.076425))]
    known.append((RED, (0.570068, 0.0430135, 0.0443706)))
    for spectrum, rgb in known:
        np.testing.assert_allclose(to_rgb(np.array(spectrum)), rgb, atol=0.01)
    np.testing.assert_allclose(reflectance_rgb(np.full(76, 0.5)), [0.5] * 3, rtol=1e-12)  # grey stays grey
    scene = load_scene("cornell")
    materials = {m.name: m for m in scene.materials}
    np.testing.assert_allclose(materials["white"].reflectance, reflectance_rgb(WHITE), rtol=1e-12)
    np.testing.assert_allclose(materials["lamp"].emission, lamp_rgb(), rtol=1e-12)
    assert materials["lamp"].reflectance == (0.78,) * 3
    assert not any(m.two_sided for m in scene.materials)


def test_cornell_faces_the_room():
    """From the middle of the room every wall shows its front; the boxes' fronts point away from their middles."""
    scene = load_scene("cornell", max_edge=np.inf)
    normals, areas = face_normals(scene.static)
    centre = scene.static.vertices[scene.static.faces].mean(axis=1)
    lamp = np.array([any(m.emission) for m in scene.materials])[scene.static.face_material]
    assert areas[lamp].sum() == pytest.approx(0.130 * 0.105, rel=1e-6)
    assert (normals[lamp][:, 1] < -0.999).all()
    # Ceiling and lamp do not overlap: together they have the area of the outline.
    ceiling = (normals[:, 1] < -0.999) & (centre[:, 1] > 0.548)
    assert areas[ceiling].sum() == pytest.approx(0.556 * 0.5592, rel=1e-6)
    assert scene.static.vertices[:, 2].min() == pytest.approx(0) and scene.static.vertices.max() < 0.56
    # A closed surface facing in has volume -V of the room, the open front adds nothing at z = 0 (p . n = 0
    # there); the boxes, facing out and open at y = 0, add their own volume.
    p = scene.static.vertices[scene.static.faces]
    volume = (p[:, 0] * np.cross(p[:, 1], p[:, 2])).sum() / 6
    boxes = [(np.array([[130, 65], [82, 225], [240, 272], [290, 114]]), 165)]
    boxes.append((np.array([[423, 247], [265, 296], [314, 456], [472, 406]]), 330))
    room = 0.5488 * 0.5592 * (0.5528 + 0.5496 + 0.556 + 0.556) / 4
    inner = sum(_polygon_area(c) * h for c, h in boxes) * 1e-9
    assert volume == pytest.approx(inner - room, rel=1e-3)  # the red wall is not quite flat


def test_pawn_keeps_clear_of_boxes_and_walls():
    scene = load_scene("cornell")
    (pawn,) = scene.mobiles
    radius = np.sqrt((pawn.mesh.vertices[:, [0, 2]] ** 2).sum(axis=1)).max()
    assert pawn.mesh.vertices[:, 1].min() == 0
    boxes = [[(130, 65), (82, 225), (240, 272), (290, 114)], [(423, 247), (265, 296), (314, 456), (472, 406)]]
    nearest_green, nearest_red = 1.0, 1.0
    for t in np.linspace(pawn.path.times[0], pawn.path.times[-1], 800):
        x, y, z = pose_at(pawn.path, t).position
        assert y == 0 and radius <= z <= 0.5592 - radius
        red = 0.5528 - 0.0032 * z / 0.5592 - x
        nearest_green, nearest_red = min(nearest_green, x - radius), min(nearest_red, red - radius)
        for box in boxes:
            c = np.array(box) * 1e-3
            for a, b in zip(c, np.roll(c, -1, axis=0), strict=True):
                u = np.clip(((x, z) - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
                assert np.hypot(*((x, z) - a - u * (b - a))) > radius
    assert 0 < nearest_green < 0.03 and 0 < nearest_red < 0.03  # up to both coloured walls


def test_furnace_equals_its_derived_answer():
    scene = load_scene("furnace")
    lit = scene.materials[scene.static.face_material[0]]
    assert (scene.static.face_material == scene.static.face_material[0]).all() and area(scene.static) == pytest.approx(
        6
    )
    E = np.pi * np.array(lit.emission) / (1 - np.array(lit.reflectance))
    text = Path(find_scene("furnace")).read_text()
    assert "E = (" + ", ".join(f"{e:.4f}" for e in E) + ") W/m2" in text
    normals, _ = face_normals(scene.static)
    inward = 0.5 - scene.static.vertices[scene.static.faces].mean(axis=1)
    assert ((normals * inward).sum(axis=1) > 0).all()
    cube = to_world(scene.mobiles[0].pose, scene.mobiles[0].mesh.vertices)
    assert cube[:, 0].min() > 1


def test_tree_is_the_reports_tree():
    scene = load_scene("tree")
    worst = load_scene("tree_worst")
    assert len(scene.static.faces) == len(worst.static.faces) == 71_966
    assert len(scene.mobiles[0].mesh.faces) == 500
    assert scene.defaults.photons == 1_000_000 and scene.defaults.radius == 0.01 and scene.up == (0, 0, 1)
    names = [m.name for m in scene.materials]
    _, areas = face_normals(scene.static)
    flux = {}
    for i, m in enumerate(scene.materials):
        flux[m.name] = np.pi * np.mean(m.emission) * areas[scene.static.face_material == i].sum()
    assert flux["dome"] == pytest.approx(0.1 * flux["lamp"], rel=1e-3)
    ground = scene.static.faces[scene.static.face_material == names.index("ground")]
    assert len(ground) == 5000
    np.testing.assert_allclose(areas[scene.static.face_material == names.index("ground")], 0.0002, rtol=1e-4)
    lamp = scene.static.vertices[scene.static.faces[scene.static.face_material == names.index("lamp")]].reshape(-1, 3)
    np.testing.assert_allclose([lamp.min(axis=0), lamp.max(axis=0)], [[0.35, 0.35, 1.6], [0.65, 0.65, 1.6]], atol=1e-6)


@pytest.mark.parametrize("name", ["tree", "tree_worst"])
def test_tree_paths_are_loops_at_constant_speed(name):
    """A frame of 1/20 s moves the ring by 0.015; the ring stays over the ground and above it."""
    scene = load_scene(name)
    (ring,) = scene.mobiles
    path = ring.path
    np.testing.assert_array_equal(path.positions[0], path.positions[-1])
    assert abs(abs(path.quaternions[0] @ path.quaternions[-1]) - 1) < 1e-6
    speed = np.sqrt((np.diff(path.positions, axis=0) ** 2).sum(axis=1)) / np.diff(path.times)
    np.testing.assert_allclose(speed, 0.3, rtol=0.02)
    for t in np.linspace(0, path.times[-1], 60):
        v = to_world(pose_at(path, t), ring.mesh.vertices)
        assert v.min() > 0 and v[:, :2].max() < 1
    heights = path.positions[:, 2]
    assert heights.max() < 0.15 if name == "tree" else heights.min() > 1


needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the collection of strangers' scenes is not here")

AREAS = {"cornell_box_mcguire/CornellBox-Original.obj": 26.5477, "cornell_box_tinyobj/cornell_box.obj": 1989605}


@needs_shared
@pytest.mark.parametrize("name", AREAS)
def test_area_of_classic_boxes(name):
    """As read; loading leaves out McGuire's four duplicates (two box bottoms given with the sides' vertices)."""
    (part,) = read_obj(SHARED / name, (SHARED / name).read_bytes(), name, Boundary(SHARED)).parts
    p = part.vertices[part.faces]
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert np.sqrt((cross * cross).sum(axis=1)).sum() / 2 == pytest.approx(AREAS[name], rel=3e-6)


def shared_files():
    found = sorted(p for p in SHARED.rglob("*") if p.suffix in (".glb", ".gltf", ".obj", ".stl"))
    return [str(p.relative_to(SHARED)) for p in found]


@needs_shared
@pytest.mark.parametrize("name", shared_files())
def test_third_party_meshes_are_read(name):
    mesh = read_mesh_file(SHARED / name).mesh
    normals, areas = face_normals(mesh)
    assert (areas > 0).all() and np.isfinite(mesh.vertices).all()
    if mesh.corner_normals is not None:
        length = np.sqrt((mesh.corner_normals**2).sum(axis=2))
        np.testing.assert_allclose(length, 1, rtol=1e-9)
        assert ((mesh.corner_normals * normals[:, None]).sum(axis=2) > 0).all()


@needs_shared
def test_kitchen_with_an_armchair():
    """The chair stands on the rooms' floor (y = 0), in a room of some 11 units, not out on the slab of 52."""
    scene = load_scene(SHARED / "lux_kitchen/lux_kitchen.glb", mobiles=[SHARED / "mobiles/armchair.gltf"])
    x, y, z = scene.mobiles[0].pose.position
    assert -1 < x < 10.6 and -3.5 < z < 7.1 and y == pytest.approx(0, abs=0.02)
    cx, cy, cz = scene.camera.position
    assert -1 < cx < 10.6 and -3.5 < cz < 7.1 and 0 < cy < 2.6
    assert len(scene.static.faces) < 200_000
    assert np.median(mean_colours(scene.mobiles[0].mesh.paint)[:, 2]) > 0.3  # blue, from its texture


@needs_shared
def test_bevy_lamp_keeps_its_strength():
    read = read_mesh_file(SHARED / "cornell_box_bevy/CornellBox.glb")
    assert (100, 100, 100) in [m.emission for m in read.materials]


def _polygon_area(corners) -> float:
    x, z = corners[:, 0].astype(float), corners[:, 1].astype(float)
    return abs(float((x * np.roll(z, -1) - z * np.roll(x, -1)).sum())) / 2
