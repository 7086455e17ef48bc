"""Scene files: what they say arrives, and every mistake gets its sentence."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mesh_writers import BOX, BOX_FACES, SCENE, write_glb, write_obj, write_scene

from gi_core.pose import as_pose, pose_at, rotation
from gi_core.scene import DirectionalLight, PointLight, Pose, SceneError, SkyLight, SpotLight, load_scene
from gi_core.solver import Solver

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


def test_everything_in_a_scene_file_arrives(tmp_path):
    text = 'up = "z"\nunits = "photometric"\n' + SCENE.replace("[static]", "[static]\nscale = 2.0\nmax_edge = 0.5")
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
    assert bulb == PointLight("bulb", (0.5, 0.5, 0.5), (1, 2, 3))
    assert isinstance(spot, SpotLight) and (spot.inner_degrees, spot.outer_degrees) == (10, 20)
    assert isinstance(sun, DirectionalLight) and isinstance(sky, SkyLight)
    assert scene.probes[0].normal == (0, 0, 1)
    assert scene.defaults == (1000, 0.1, 7, "photon_map", 1.5, 3.0)
    assert scene.camera.vertical_fov_degrees == 45


def test_path_spins_through_whole_turns(tmp_path):
    """360 degrees a second for 2 s: half way through a turn, slerp alone could not tell the way round."""
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
    "huge": (SCENE.replace("[0.5, 0.5, 0.1]", "[1e300, 0, 0]"), "position must be three finite numbers, got"),
    "huge whole number": (
        SCENE.replace("[0.5, 0.5, 0.1]", f"[{'9' * 400}, 0, 0]"),
        "position must be three finite numbers",
    ),
    "scale out of sight": (
        SCENE.replace("[static]", "[static]\nscale = 1e12"),
        "a scene must be 1e-06 to 1e[+]09 m large",
    ),
    "tiny edges": (SCENE.replace("[static]", "[static]\nmax_edge = 1e-9"), "max_edge 1e-09 makes more than 4,000,000"),
    "endless spin": (
        SCENE + "[mobile.path]\ntimes = [0, 1e6]\npositions = [[0, 0, 0], [1, 0, 0]]\nspin = 1e6",
        "spin must make fewer than 25,000 turns in all, got 2.78e[+]09",
    ),
    "spot of no width": (
        SCENE + '[[light]]\ntype = "spot"\nposition = [0, 0, 0]\ndirection = [0, 0, 1]\nintensity = [1, 1, 1]\n'
        "outer_degrees = 0",
        "outer_degrees must be a number > 0 and < 90",
    ),
    "light without type": (SCENE + "[[light]]\nposition = [0, 0, 0]", 'light "0": type is missing; write type = '),
    "name too long for a file": (SCENE.replace("cube.obj", "x" * 5000 + ".obj"), "there is no such mesh file"),
    "malformed": ("title = ", "a scene file must be TOML, which this is not"),
    "misspelt key": (SCENE.replace("target", "taget"), r"\[camera\]: unknown key 'taget'; did you mean 'target'\?"),
    "misspelt table": (SCENE.replace("[camera]", "[cammera]"), "unknown key 'cammera'; did you mean 'camera'?"),
    "wrong type": (SCENE.replace('"test"', "3"), "title must be a text in quotes, got 3"),
    "wrong shape": (SCENE.replace("[0.5, 0.5, 0.1]", "[0.5, 0.5]"), "position must be three finite numbers, got"),
    "nan": (SCENE.replace("[0.5, 0.5, 0.1]", "[0.5, nan, 0.5]"), r"finite numbers, got \[0.5, nan, 0.5\]"),
    "reflectance": (
        SCENE + "[materials.wall]\nreflectance = [1, 0, 0]",
        r'material "wall": reflectance must be three numbers >= 0 and < 1, got \[1, 0, 0\]',
    ),
    "emission": (SCENE + "[materials.lamp]\nemission = [-1, 0, 0]", r"emission must be three numbers >= 0, got"),
    "unused material": (
        SCENE + "[materials.walls]\nreflectance = [0, 0, 0]",
        "material \"walls\": no mesh has a material of that name; did you mean 'wall'",
    ),
    "unknown material": (SCENE + 'material = "wal"', 'mobile "cube": there is no material "wal"'),
    "emissive mobile": (
        SCENE + 'material = "red"\n[materials.red]\nemission = [1, 1, 1]',
        'mobile "cube": a mobile cannot emit light, its material "red" has emission',
    ),
    "duplicate mobiles": (
        SCENE + '[[mobile]]\nname = "cube"\nmesh = "cube.obj"',
        'mobile "cube": names must differ, this one is used twice',
    ),
    "duplicate lights": (
        SCENE + '[[light]]\ntype = "sky"\nname = "a"\nradiance = [1, 1, 1]\n' * 2,
        'light "a": names must differ',
    ),
    "missing mesh": (SCENE.replace("cube.obj", "cubes.obj"), "cubes.obj: there is no such mesh file"),
    "mesh format": (SCENE.replace("cube.obj", "cube.fbx"), "must be one of .glb .gltf .obj .ply .stl, got .fbx"),
    "non-rigid": (
        SCENE + "rotation = [2, 0, 0, 0]",
        r"rotation: the quaternion \(w, x, y, z\) of a pose must have length 1, got 2; write \[1, 0, 0, 0\]",
    ),
    "two rotations": (SCENE + "rotation = [1, 0, 0, 0]\nangle = 3", "rotation and axis/angle exclude each other"),
    "zero axis": (SCENE + "axis = [0, 0, 0]\nangle = 3", "axis must be three numbers that are not all 0"),
    "scale": (SCENE + "scale = 0", "scale must be a number > 0, got 0"),
    "path lengths": (
        SCENE + "[mobile.path]\ntimes = [0, 1]\npositions = [[0, 0, 0]]",
        "positions must be a list with 2 entries of three numbers, got a list of 1",
    ),
    "path times": (
        SCENE + "[mobile.path]\ntimes = [1, 1]\npositions = [[0, 0, 0], [1, 0, 0]]",
        r"times must increase, got \[1.0, 1.0\]",
    ),
    "light type": (SCENE + '[[light]]\ntype = "laser"', 'light "0": type must be one of "point", "spot"'),
    "light key": (
        SCENE + '[[light]]\ntype = "point"\nposition = [0, 0, 0]\nfluks = [1, 1, 1]',
        "unknown key 'fluks'; did you mean 'flux'",
    ),
    "flux": (
        SCENE + '[[light]]\ntype = "point"\nname = "ceiling"\nposition = [0, 0, 0]\nflux = [-1, 0, 2]',
        r'light "ceiling": flux must be three numbers >= 0, got \[-1, 0, 2\]',
    ),
    "spot": (
        SCENE + '[[light]]\ntype = "spot"\nposition = [0, 0, 0]\ndirection = [0, 0, 1]\nintensity = [1, 1, 1]\n'
        "inner_degrees = 30\nouter_degrees = 20",
        "inner_degrees must be at most outer_degrees 20, got 30",
    ),
    "camera": (SCENE.replace("[0.5, 0.5, 0.9]", "[0.5, 0.5, 0.1]"), "target must differ from position"),
    "photons": (SCENE + "[defaults]\nphotons = 0.5", "photons must be a whole number >= 1, got 0.5"),
    "up": ('up = "w"' + SCENE, 'up must be "x", "y", "z" or three numbers in brackets, got \'w\''),
    "up is a number": ("up = 3" + SCENE, 'up must be "x", "y", "z" or three numbers in brackets, got 3'),
    "up of two numbers": ("up = [0, 1]" + SCENE, r"up must be three finite numbers, got \[0, 1\]"),
    "no rotation": (SCENE + "rotation = [0, 0, 0, 0]", r"length 1, got 0; write \[1, 0, 0, 0\]"),
    "two digits": (SCENE + "rotation = [0.7, 0, 0.7, 0]", r"got 0.9899; write \[0.7071, 0, 0.7071, 0\]"),
    "light is a table": (SCENE + "[light]\n", r"a light is written as a table \[\[light\]\], got"),
}


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
def test_a_rotation_as_people_type_it_is_made_exact(tmp_path, digits):
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
def test_mistakes_end_with_code_3_and_one_line(command, mistake, tmp_path, capsys, monkeypatch):
    from app.__main__ import main

    monkeypatch.chdir(tmp_path)
    text = SCENE + '[defaults]\nestimator = "magic"' if mistake == "estimator" else MISTAKES[mistake][0]
    assert main([command, str(write_scene(tmp_path, text))]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "Traceback" not in said and said.startswith("gi-viewer: ")


def test_file_that_is_not_there():
    with pytest.raises(SceneError, match=r"no_such.toml: there is no such scene file; shipped scenes are cornell, "):
        load_scene("no_such.toml")


def test_options_are_checked(tmp_path):
    file = write_scene(tmp_path)
    with pytest.raises(SceneError, match="max_edge must be a length > 0 in metres, got -1"):
        load_scene(file, max_edge=-1)
    with pytest.raises(SceneError, match='up must be "x", "y", "z" or three numbers, got'):
        load_scene(file, up="w")
    with pytest.raises(SceneError, match=r"mobile.glb: there is no such mesh file"):
        load_scene(file, mobiles=[tmp_path / "mobile.glb"])
    with pytest.raises(SceneError, match="a scene is a .toml file or one of .glb"):
        load_scene(tmp_path / "room.mtl")


def test_mobile_on_the_command_line_stands_on_the_floor(tmp_path):
    """A cube of 2 m in a room of 1 m, z up in a y-up room: turned upright, scaled with a note, on the floor."""
    file = write_scene(tmp_path)
    import trimesh

    trimesh.Trimesh(BOX * [2, 2, 1], [[0, 1, 3]], process=False).export(tmp_path / "sheet.stl")
    write_obj(tmp_path / "big.obj", BOX * 2)
    scene = load_scene(file, mobiles=[tmp_path / "big.obj", tmp_path / "big.obj", tmp_path / "sheet.stl"])
    assert [m.name for m in scene.mobiles] == ["cube", "big", "big 2", "sheet"]
    big = scene.mobiles[1]
    v = big.mesh.vertices
    assert v[:, 1].min() == pytest.approx(0) and v[:, 0].min() == pytest.approx(-v[:, 0].max())
    assert np.ptp(v, axis=0).max() == pytest.approx(1 / 6, rel=0.02)
    assert any('mobile "big" scaled by' in n for n in scene.notes)
    assert big.pose.position[1] == pytest.approx(0, abs=1e-6)
    at = np.array(big.pose.position) + v
    assert at.min() > -1e-6 and at.max() < 1
    sheet = scene.mobiles[3].mesh.vertices
    assert np.ptp(sheet[:, 1]) == pytest.approx(np.ptp(sheet, axis=0).max() / 2)  # 1 along z of 2 along y


def test_mesh_file_alone_is_a_scene(tmp_path):
    write_scene(tmp_path)
    scene = load_scene(tmp_path / "room.obj", mobiles=[tmp_path / "cube.obj"])
    assert scene.name == "room" and scene.up == (0, 1, 0) and scene.camera is not None
    assert len(scene.static.faces) > 1000
    assert not any("no light in the file" in n for n in scene.notes)


def test_dark_scene_gets_a_lamp_that_shines_down(tmp_path):
    file = write_obj(tmp_path / "dark.obj", BOX, BOX_FACES[:, ::-1])
    scene = load_scene(file, mobiles=[write_obj(tmp_path / "cube.obj", BOX * 0.1)])
    lamp = next(i for i, m in enumerate(scene.materials) if m.name == "default light")
    p = scene.static.vertices[scene.static.faces[scene.static.face_material == lamp]]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert (normal[:, 1] < 0).all() and np.abs(normal[:, [0, 2]]).max() < 1e-12
    assert 0.8 < p[..., 1].max() < 1
    assert any("no light in the file" in n for n in scene.notes)


def test_glb_light_and_camera(tmp_path):
    """A node turned by -90 degrees about x looks down; candela become lumen over the whole sphere: x 4 pi."""
    extra = {
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {
            "KHR_lights_punctual": {
                "lights": [
                    {"type": "point", "intensity": 5, "color": [1, 0, 0], "name": "bulb"},
                    {"type": "spot", "intensity": 10, "spot": {"outerConeAngle": 0.5}},
                ]
            }
        },
        "nodes": [
            {"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"rotation": [-(0.5**0.5), 0, 0, 0.5**0.5], "extensions": {"KHR_lights_punctual": {"light": 1}}},
            {"camera": 0, "translation": [0.5, 0.5, 4]},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
    }
    scene = load_scene(write_glb(tmp_path / "lit.glb", BOX, [[0, 1, 3], [0, 3, 2]], **extra))
    bulb, spot = scene.lights
    np.testing.assert_allclose(bulb.flux, [20 * np.pi, 0, 0])
    assert bulb.position == (1, 2, 3) and scene.units == "photometric"
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-12)
    assert spot.outer_degrees == pytest.approx(np.degrees(0.5)) and spot.inner_degrees == 0
    np.testing.assert_allclose(np.subtract(scene.camera.target, scene.camera.position), [0, 0, -1], atol=1e-12)


def test_a_scaled_file_looks_the_same_with_its_own_lights_and_camera(tmp_path):
    """A room in millimetres, its lights and camera among its walls: at 0.001 every surface receives what it did.

    Lights that are lengths away go with the square, the sun and radiance stay; what the scene file says is in metres.
    """
    lights = [
        {"type": "point", "intensity": 5e6},
        {"type": "spot", "intensity": 3e6, "spot": {"outerConeAngle": 0.9}},
        {"type": "directional", "intensity": 2.0},
    ]
    held = [{"extensions": {"KHR_lights_punctual": {"light": k}}} for k in range(3)]
    extra = {
        "extensions": {"KHR_lights_punctual": {"lights": lights}},
        "nodes": [
            {"translation": [500, 800, 500], **held[0]},
            {"translation": [300, 700, 400], "rotation": [-(0.5**0.5), 0, 0, 0.5**0.5], **held[1]},
            held[2],
            {"camera": 0, "translation": [500, 500, 4000]},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
    }
    write_glb(tmp_path / "room.glb", BOX * 1000, BOX_FACES[:, ::-1], **extra)
    lamp = '[[light]]\ntype = "point"\nposition = [0.5, 0.5, 0.5]\nflux = [0, 0, 0]\n'
    scenes, means = [], []
    for scale in (1.0, 0.001):
        file = tmp_path / f"{scale}.toml"
        file.write_text(f'[static]\nmesh = "room.glb"\nscale = {scale}\nmax_edge = {250 * scale}\n{lamp}')
        scenes.append(load_scene(file))
        solver = Solver(scenes[-1], photons=20_000, radius=100 * scale)
        solver.solve()
        means.append(solver.irradiance)
    large, small = scenes
    assert large.lights[0] == small.lights[0], "the scene file's own lamp is in metres"
    for was, now in zip(large.lights[1:3], small.lights[1:3], strict=True):
        np.testing.assert_allclose(np.multiply(was.position, 0.001), now.position)
    assert small.lights[1].flux[0] == pytest.approx(large.lights[1].flux[0] * 1e-6)
    assert small.lights[2].intensity[0] == pytest.approx(large.lights[2].intensity[0] * 1e-6)
    assert small.lights[3].irradiance == large.lights[3].irradiance == (2.0,) * 3
    np.testing.assert_allclose(np.multiply(large.camera.position, 0.001), small.camera.position)
    np.testing.assert_allclose(np.multiply(large.camera.target, 0.001), small.camera.target)
    assert small.camera.vertical_fov_degrees == large.camera.vertical_fov_degrees
    assert means[0].mean() > 0.1
    np.testing.assert_allclose(means[1].mean(axis=0), means[0].mean(axis=0), rtol=1e-3)
    assert np.abs(means[1] - means[0]).mean() < 1e-2 * means[0].mean(), "photon for photon, but for rounding"
