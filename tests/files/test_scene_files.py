"""Scene files: values read, and sentences about mistakes."""

import re

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.scene import DirectionalLight, PointLight, Pose, SceneError, SkyLight, SpotLight
from gi_core.scene.pose import as_pose, pose_at, rotation
from tests.support.mesh_writers import SCENE, write_scene

LIGHTS = """
[[light]]
type = "point"
name = "bulb"
position = [0.5, 0.5, 0.5]
flux = [1, 2, 3]
[[light]]
type = "spot"
position = [0.5, 0.9, 0.5]
direction = [0, -1, 0]
intensity = [4, 4, 4]
inner_degrees = 10
outer_degrees = 20
[[light]]
type = "directional"
direction = [0, -2, 0]
irradiance = [1, 1, 1]
[[light]]
type = "sky"
radiance = [0.1, 0.1, 0.2]
"""


def test_every_key_of_a_scene_file_is_read(tmp_path):
    text = 'up = "z"\nunits = "photometric"\n' + SCENE.replace("max_edge = 10", "scale = 2.0\nmax_edge = 0.5")
    text += (
        'axis = [0, 0, 2]\nangle = 90\nscale = 0.5\nmaterial = "red"\n[materials.red]\nreflectance = [0.6, 0.1, 0.1]\n'
    )
    text += "[materials.wall]\ntwo_sided = false\n[materials.lamp]\nemission = [1, 2, 3]\n" + LIGHTS
    text += '[[probe]]\nname = "p"\nposition = [0, 0, 0]\nnormal = [0, 0, 5]\n'
    text += '[defaults]\nphotons = 1000\nradius = 0.1\nneighbours = 7\nestimator = "photon_map"\nexposure = 1.5\n'
    text += "scene_size = 3.0\n"
    scene = load_scene(write_scene(tmp_path, text))
    assert scene.up == (0, 0, 1) and scene.units == "photometric" and scene.name == "test"
    assert scene.static.vertices.max() == 2.0
    materials = {m.name: m for m in scene.materials}
    assert materials["wall"].two_sided is False and materials["wall"].reflectance == (0.5, 0.5, 0.5)
    assert materials["lamp"].emission == (1, 2, 3)
    mobile = scene.mobiles[0]
    assert {scene.materials[i].name for i in mobile.mesh.face_material} == {"red"}
    assert mobile.mesh.vertices.max() == pytest.approx(0.1)
    np.testing.assert_allclose(rotation(mobile.pose) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    bulb, spot, sun, sky = scene.lights
    assert [light.name for light in scene.lights[1:]] == ["light 2", "light 3", "light 4"], "as in sentences"
    assert bulb == PointLight("bulb", (0.5, 0.5, 0.5), (1, 2, 3))
    assert isinstance(spot, SpotLight) and (spot.inner_degrees, spot.outer_degrees) == (10, 20)
    assert isinstance(sun, DirectionalLight) and isinstance(sky, SkyLight)
    assert scene.probes[0].normal == (0, 0, 1)
    assert scene.defaults == (1000, 0.1, 7, "photon_map", 1.5, 3.0)
    assert scene.camera.vertical_fov_degrees == 45


def test_path_spins_through_whole_turns(tmp_path):
    """360 degrees per second for 2 s: at half a turn, slerp alone has no unique direction."""
    path = "[mobile.path]\ntimes = [0, 2]\npositions = [[0, 0, 0], [1, 0, 0]]\nspin = 360\n"
    path = load_scene(write_scene(tmp_path, SCENE + path)).mobiles[0].path
    for t in (0.1, 0.6, 1.3):
        pose = pose_at(path, t)
        assert pose.position[0] == pytest.approx(t / 2)
        angle = 2 * np.pi * t
        np.testing.assert_allclose(rotation(pose) @ [1, 0, 0], [np.cos(angle), 0, -np.sin(angle)], atol=1e-12)


def test_pose_of_a_path_is_its_first_key(tmp_path):
    path = "[mobile.path]\ntimes = [0, 1]\npositions = [[0.7, 0, 0.2], [1, 0, 0]]\n"
    scene = load_scene(write_scene(tmp_path, SCENE.replace("position = [0.3, 0.0, 0.3]", path)))
    assert scene.mobiles[0].pose.position == (0.7, 0, 0.2)


MISTAKES = {
    "missing static": (SCENE.replace("[static]", "[other]"), "unknown key 'other'"),
    "no static": ('title = "t"', r"\[static\] is missing; write \[static\] and below it mesh = "),
    "static is a text": ('static = "room.obj"', r"\[static\] must be a table of keys, got 'room.obj'"),
    "huge": (SCENE.replace("[0.5, 0.5, 0.1]", "[1e300, 0, 0]"),
        "position must be three finite numbers, at most 1e\\+15, got"),
    "huge whole number": (SCENE.replace("[0.5, 0.5, 0.1]", f"[{'9' * 400}, 0, 0]"),
        "position must be three finite numbers"),
    "scale out of sight": (SCENE.replace("[static]", "[static]\nscale = 1e12"),
        "a scene must be 1e-06 to 1e[+]09 m large"),
    "tiny edges": (SCENE.replace("max_edge = 10", "max_edge = 1e-9"), "max_edge 1e-09 makes more than 4,000,000"),
    "endless spin": (SCENE + "[mobile.path]\ntimes = [0, 1e6]\npositions = [[0, 0, 0], [1, 0, 0]]\nspin = 1e6",
        "spin: a scene must have no more than 100,000 key frames, got"),
    "spot of no width": (
        SCENE + '[[light]]\ntype = "spot"\nposition = [0, 0, 0]\ndirection = [0, 0, 1]\nintensity = [1, 1, 1]\n'
        "outer_degrees = 0",
        "outer_degrees must be a number of degrees > 0 and <= 90",
    ),
    "key of a light": (
        SCENE + '[[light]]\ntype = "point"\nname = "lamp"\nposition = [0, 1, 0]\nflux = [1, 1, 1]\n'
        '[[light]]\ntype = "sky"\nradianse = [1, 1, 1]',
        "light 2: unknown key 'radianse'; did you mean 'radiance'?",
    ),
    "light without type": (SCENE + "[[light]]\nposition = [0, 0, 0]", "light 1: type is missing; write type = "),
    "name too long for a file": (SCENE.replace("cube.obj", "x" * 5000 + ".obj"), "there is no such mesh file"),
    "malformed": ("title = ", "a scene file must be TOML, which this is not"),
    "misspelt key": (SCENE.replace("target", "taget"), r"\[camera\]: unknown key 'taget'; did you mean 'target'\?"),
    "misspelt table": (SCENE.replace("[camera]", "[cammera]"), "unknown key 'cammera'; did you mean 'camera'?"),
    "wrong type": (SCENE.replace('"test"', "3"), "title must be a text in quotes, not empty, got 3"),
    "wrong shape": (SCENE.replace("[0.5, 0.5, 0.1]", "[0.5, 0.5]"), "position must be three finite numbers, got"),
    "nan": (SCENE.replace("[0.5, 0.5, 0.1]", "[0.5, nan, 0.5]"), r"finite numbers, got \[0.5, nan, 0.5\]"),
    "reflectance": (SCENE + "[materials.wall]\nreflectance = [1, 0, 0]",
        r'material "wall": reflectance must be three numbers >= 0 and < 1, got \[1, 0, 0\]'),
    "emission": (SCENE + "[materials.lamp]\nemission = [-1, 0, 0]", r"emission must be three numbers >= 0, got"),
    "unused material": (SCENE + "[materials.walls]\nreflectance = [0, 0, 0]",
        "material \"walls\": no mesh has a material of that name; did you mean 'wall'"),
    "unknown material": (SCENE + 'material = "wal"', 'mobile "cube": there is no material "wal"'),
    "emissive mobile": (SCENE + 'material = "red"\n[materials.red]\nemission = [1, 1, 1]',
        'mobile "cube": a mobile cannot emit light, its material "red" has emission'),
    "duplicate mobiles": (SCENE + '[[mobile]]\nname = "cube"\nmesh = "cube.obj"',
        'mobile "cube": names must differ, this one is used twice'),
    "duplicate lights": (SCENE + '[[light]]\ntype = "sky"\nname = "a"\nradiance = [1, 1, 1]\n' * 2,
        'light "a": names must differ'),
    "missing mesh": (SCENE.replace("cube.obj", "cubes.obj"), "cubes.obj: there is no such mesh file"),
    "mesh format": (SCENE.replace("cube.obj", "cube.fbx"), "must be one of .glb .gltf .obj .ply .stl, got .fbx"),
    "non-rigid": (SCENE + "rotation = [2, 0, 0, 0]",
        r"rotation: the quaternion \(w, x, y, z\) of a pose must have length 1, got 2; write \[1, 0, 0, 0\]"),
    "two rotations": (SCENE + "rotation = [1, 0, 0, 0]\nangle = 3", "rotation and axis/angle exclude each other"),
    "zero axis": (SCENE + "axis = [0, 0, 0]\nangle = 3", "axis must be three numbers that are not all 0"),
    "scale": (SCENE + "scale = 0", "scale must be a number > 0, got 0"),
    "path lengths": (SCENE + "[mobile.path]\ntimes = [0, 1]\npositions = [[0, 0, 0]]",
        "positions must be a list with 2 entries of three numbers, got a list of 1"),
    "path times": (SCENE + "[mobile.path]\ntimes = [1, 1]\npositions = [[0, 0, 0], [1, 0, 0]]",
        r"times must increase, got \[1.0, 1.0\]"),
    "light type": (SCENE + '[[light]]\ntype = "laser"', 'light 1: type must be one of "point", "spot"'),
    "light key": (SCENE + '[[light]]\ntype = "point"\nposition = [0, 0, 0]\nfluks = [1, 1, 1]',
        "unknown key 'fluks'; did you mean 'flux'"),
    "flux": (SCENE + '[[light]]\ntype = "point"\nname = "ceiling"\nposition = [0, 0, 0]\nflux = [-1, 0, 2]',
        r'light "ceiling": flux must be three numbers >= 0 and <= 1e\+15, got \[-1, 0, 2\]'),
    "spot": (
        SCENE + '[[light]]\ntype = "spot"\nposition = [0, 0, 0]\ndirection = [0, 0, 1]\nintensity = [1, 1, 1]\n'
        "inner_degrees = 30\nouter_degrees = 20",
        "inner_degrees <= outer_degrees <= 90, got 30.0 and 20.0",
    ),
    "camera": (SCENE.replace("[0.5, 0.5, 0.9]", "[0.5, 0.5, 0.1]"), "target must differ from position"),
    "photons": (SCENE + "[defaults]\nphotons = 0.5", "photons must be a whole number >= 1, got 0.5"),
    "up": ('up = "w"' + SCENE, 'up must be "x", "y", "z" or three numbers in brackets, got \'w\''),
    "up is a number": ("up = 3" + SCENE, 'up must be "x", "y", "z" or three numbers in brackets, got 3'),
    "up of two numbers": ("up = [0, 1]" + SCENE, r"up must be three finite numbers, got \[0, 1\]"),
    "no rotation": (SCENE + "rotation = [0, 0, 0, 0]", r"length 1, got 0; write \[1, 0, 0, 0\]"),
    "two digits": (SCENE + "rotation = [0.7, 0, 0.7, 0]", r"got 0.9899; write \[0.7071, 0, 0.7071, 0\]"),
    "light is a table": (SCENE + "[light]\n", r"a light is written as a table \[\[light\]\], got"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(tmp_path, mistake):
    text, sentence = MISTAKES[mistake]
    file = write_scene(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(file)
    message = str(caught.value)
    assert message.startswith(str(file)), message
    assert re.search(sentence.replace("'?", "'\\?") if "?" in sentence else sentence, message), message
    assert "\n" not in message and (message.endswith("...") or not message.endswith("."))


@pytest.mark.parametrize("digits", [3, 4, 9])
def test_rounded_rotation_is_made_exact(tmp_path, digits):
    """Quarter turns rounded to three digits are off by 1.5e-4 in length, any by at most 1e-3."""
    c = round(0.5**0.5, digits)
    pose = load_scene(write_scene(tmp_path, SCENE + f"rotation = [{c}, 0, {c}, 0]")).mobiles[0].pose
    np.testing.assert_allclose(rotation(pose) @ [1, 0, 0], [0, 0, -1], atol=1e-15)
    matrix = np.eye(4)
    matrix[:3, :3] = np.round(rotation(Pose(quaternion=(0.6, 0.0, 0.0, 0.8))), 5)
    np.testing.assert_allclose(np.linalg.norm(as_pose(matrix).quaternion), 1, atol=1e-15)
    for scale in (1.001, 0.999):
        matrix[:3, :3] = np.eye(3) * scale
        with pytest.raises(SceneError, match="must be rigid .*; bake scale into the mesh"):
            as_pose(matrix)


def test_windows_files_are_read(tmp_path):
    """A byte order mark and carriage returns, as Notepad writes them."""
    file = write_scene(tmp_path)
    file.write_bytes(b"\xef\xbb\xbf" + SCENE.replace("\n", "\r\n").encode())
    assert load_scene(file).name == "test"


@pytest.mark.parametrize("command", ["info", "render", "bench"])
@pytest.mark.parametrize("mistake", ["nan", "misspelt key", "missing mesh", "reflectance", "estimator"])
def test_errors_exit_with_3_and_one_line(command, mistake, tmp_path, capsys, monkeypatch):
    from app.__main__ import main

    monkeypatch.chdir(tmp_path)
    text = SCENE + '[defaults]\nestimator = "magic"' if mistake == "estimator" else MISTAKES[mistake][0]
    assert main([command, str(write_scene(tmp_path, text))]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "Traceback" not in said and said.startswith("gi-viewer: ")
