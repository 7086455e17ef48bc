"""Completion of files: mobiles, lamps and cameras added to mesh files and scene files."""

import numpy as np
import pytest

from gi_core.files.completion import SCALED
from gi_core.files.load import load_scene
from gi_core.model import Model
from gi_core.scene import SceneError
from tests.support.mesh_writers import BOX, BOX_FACES, gltf_lights, write_glb, write_obj, write_scene
from tests.support.scene_builders import solve

DOWN = [-(0.5**0.5), 0, 0, 0.5**0.5]  # the rotation of a node whose light shines downwards


def test_missing_file():
    with pytest.raises(SceneError, match=r"no_such.toml: there is no such scene file; shipped scenes are classroom, "):
        load_scene("no_such.toml")


def test_options_are_checked(tmp_path):
    file = write_scene(tmp_path)
    with pytest.raises(SceneError, match="max_edge must be a finite number > 0, .*, got -1"):
        load_scene(file, max_edge=-1)
    with pytest.raises(SceneError, match='up must be "x", "y", "z" or three numbers that are not all 0, got'):
        load_scene(file, up="w")
    with pytest.raises(SceneError, match=r"mobile.glb: there is no such file"):
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
    assert np.ptp(v, axis=0).max() == pytest.approx(SCALED, rel=0.02)
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


def test_dark_scene_gets_a_downward_lamp(tmp_path):
    file = write_obj(tmp_path / "dark.obj", BOX, BOX_FACES[:, ::-1])
    scene = load_scene(file, mobiles=[write_obj(tmp_path / "cube.obj", BOX * 0.1)])
    lamp = next(i for i, m in enumerate(scene.materials) if m.name == "default light")
    p = scene.static.vertices[scene.static.faces[scene.static.face_material == lamp]]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert (normal[:, 1] < 0).all() and np.abs(normal[:, [0, 2]]).max() < 1e-12
    assert 0.8 < p[..., 1].max() < 1
    assert any("no light in the file" in n for n in scene.notes)


def test_the_default_lamp_of_a_photometric_file_has_lumens(tmp_path):
    """17.67 lm, beside which each luminaire that was added blinded the picture."""
    shapes = 'shape = [{ type = "room", size = [4, 2.5, 3] }, { type = "box", size = [0.4, 0.4, 0.4], mobile = true }]'
    flux = []
    for units in ("radiometric", "photometric"):
        (tmp_path / "room.toml").write_text(f'units = "{units}"\n{shapes}\n')
        scene = load_scene(tmp_path / "room.toml")
        flux.append(Model(scene).emitters.flux.sum(axis=0))
    assert flux[1] == pytest.approx(179.0 * flux[0]) and 1000 < flux[1][0] < 10_000


def test_glb_light_and_camera(tmp_path):
    """A node turned by -90 degrees about x looks down; candela become lumen over the whole sphere: x 4 pi."""
    extra = {
        "extensionsUsed": ["KHR_lights_punctual"],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
    } | gltf_lights(
        ({"type": "point", "intensity": 5, "color": [1, 0, 0], "name": "bulb"}, {"translation": [1, 2, 3]}),
        ({"type": "spot", "intensity": 10, "spot": {"outerConeAngle": 0.5}}, {"rotation": DOWN}),
        nodes=[{"camera": 0, "translation": [0.5, 0.5, 4]}],
    )
    scene = load_scene(write_glb(tmp_path / "lit.glb", BOX, [[0, 1, 3], [0, 3, 2]], **extra))
    bulb, spot = scene.lights
    np.testing.assert_allclose(bulb.flux, [20 * np.pi, 0, 0])
    assert bulb.position == (1, 2, 3) and scene.units == "photometric"
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-12)
    assert spot.outer_degrees == pytest.approx(np.degrees(0.5)) and spot.inner_degrees == 0
    np.testing.assert_allclose(np.subtract(scene.camera.target, scene.camera.position), [0, 0, -1], atol=1e-12)


def test_emission_of_a_gltf_file_is_in_candela_per_square_metre(tmp_path):
    """KHR_materials_emissive_strength; a scene file states its units itself."""
    nits = {"name": "lamp", "emissiveFactor": [1, 1, 1]}
    lit = write_glb(tmp_path / "lit.glb", BOX, BOX_FACES, material=nits)
    assert load_scene(lit).units == "photometric"
    assert load_scene(write_glb(tmp_path / "dark.glb", BOX, BOX_FACES)).units == "radiometric"
    (tmp_path / "lit.toml").write_text('[static]\nmesh = "lit.glb"\n')
    assert load_scene(tmp_path / "lit.toml").units == "radiometric"


def test_a_scaled_file_looks_the_same_with_its_own_lights_and_camera(tmp_path):
    """A room in millimetres, lights and camera inside: at scale 0.001 every surface receives the same light.

    Flux of point lights scales with the square; sun and radiance stay; values of the scene file are in metres.
    """
    spot = {"type": "spot", "intensity": 3e6, "spot": {"outerConeAngle": 0.9}}
    extra = gltf_lights(
        ({"type": "point", "intensity": 5e6}, {"translation": [500, 800, 500]}),
        (spot, {"translation": [300, 700, 400], "rotation": DOWN}),
        ({"type": "directional", "intensity": 2.0}, {}),
        nodes=[{"camera": 0, "translation": [500, 500, 4000]}],
    ) | {"cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}]}
    write_glb(tmp_path / "room.glb", BOX * 1000, BOX_FACES[:, ::-1], **extra)
    lamp = '[[light]]\ntype = "point"\nposition = [0.5, 0.5, 0.5]\nflux = [0, 0, 0]\n'
    scenes, means = [], []
    for scale in (1.0, 0.001):
        file = tmp_path / f"{scale}.toml"
        file.write_text(f'[static]\nmesh = "room.glb"\nscale = {scale}\nmax_edge = {250 * scale}\n{lamp}')
        scenes.append(load_scene(file))
        solver = solve(scenes[-1], photons=20_000, radius=100 * scale)
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
