"""Scene files: values read, and mistakes at the command line; test_documentation.py has every sentence."""

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


MISTAKES = {
    "nan": SCENE.replace("[0.5, 0.5, 0.1]", "[0.5, nan, 0.5]"),
    "missing mesh": SCENE.replace("cube.obj", "cubes.obj"),
    "estimator": SCENE + '[defaults]\nestimator = "magic"',
}


@pytest.mark.parametrize("command", ["info", "render", "bench"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_errors_exit_with_3_and_one_line(command, mistake, tmp_path, capsys, monkeypatch):
    from app.__main__ import main

    monkeypatch.chdir(tmp_path)
    assert main([command, str(write_scene(tmp_path, MISTAKES[mistake]))]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "Traceback" not in said and said.startswith("gi-viewer: ")
