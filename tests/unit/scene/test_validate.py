"""Scenes built from arrays: invalid ones are refused in one sentence."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from gi_core.geometry.surfaces import flatten
from gi_core.lights.emission import build_emitters
from gi_core.lights.lamps import delta_lights
from gi_core.scene import SceneError
from gi_core.scene.types import DirectionalLight, PointLight, SkyLight, SpotLight
from gi_core.scene.validate import check_scene
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, coloured_room, grey, lamp, solve

ROOM = coloured_room((box_mobile(),))
WHITE = (1.0, 1.0, 1.0)


def with_material(**changes):
    return replace(ROOM, materials=(ROOM.materials[0]._replace(**changes), *ROOM.materials[1:]))


def with_static(**changes):
    return replace(ROOM, static=ROOM.static._replace(**changes))


def with_light(light):
    return replace(ROOM, lights=(light,))


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (with_material(reflectance=(1.5, 0, 0)), "reflectance must be three numbers in [0, 1), got (1.5, 0, 0)"),
        (with_material(reflectance=(0.5, 0.5)), "reflectance must be three numbers"),
        (with_material(emission=(0, -1, 0)), "emission must be three numbers >= 0 and <= 1e+15, got (0, -1, 0)"),
        (with_material(emission=(0, float("nan"), 0)), "emission must be three numbers >= 0"),
        (with_static(vertices=ROOM.static.vertices * np.nan),
         "the static part: vertices must be an array (n, 3) of finite numbers"),
        (with_static(vertices=ROOM.static.vertices[:, :2]),
         "of finite numbers from -1e+15 to 1e+15, got float64 (62, 2) from 0 to 1"),
        (with_static(faces=ROOM.static.faces + 1000), "faces must be an array (n, 3) of integers from 0 to "),
        (with_static(faces=ROOM.static.faces - 1), "faces must be an array (n, 3) of integers from 0 to "),
        (with_static(faces=ROOM.static.faces.astype(float)), "faces must be an array (n, 3) of integers from 0 to"),
        (with_static(face_material=ROOM.static.face_material[1:]), "face_material must be an array ("),
        (with_static(face_material=ROOM.static.face_material + 9), "of integers from 0 to 2, got int32 ("),
        (with_static(face_reflectance=np.full((len(ROOM.static.faces), 3), 1.0)),
         "3) of finite numbers from 0 to 1, got float64 ("),
        (with_light(PointLight("p", (0, 0, 0.5), (-1, 0, 0))), 'light "p": flux must be three numbers >= 0'),
        (with_light(PointLight("p", (0, 0, np.inf), WHITE)), 'light "p": position must be three finite numbers'),
        (with_light(SpotLight("s", (0, 0, 0), (0, 0, 0), WHITE, 1, 2)),
         "direction must be three numbers that are not all 0"),
        (with_light(SpotLight("s", (0, 0, 0), (0, 0, 1), WHITE, 30, 20)), "got 30 and 20"),
        (with_light(DirectionalLight("d", (0, 0, 1), (np.nan,) * 3)), "irradiance must be three numbers >= 0"),
        (with_light(SkyLight("y", (1, 1, -1))), "radiance must be three numbers >= 0"),
        (replace(ROOM, up=(0, 0, 0)), "up must be three numbers that are not all 0"),
        (coloured_room((box_mobile(material=1),)), 'mobile "box": material "lamp" emits light'),
    ],
)  # fmt: skip
def test_refused_in_one_sentence(scene, message):
    with pytest.raises(SceneError) as problem:
        Solver(scene, photons=10)
    assert str(problem.value).startswith("room: ")
    assert message in str(problem.value)
    assert "\n" not in str(problem.value)


def test_values_at_the_limits_are_allowed():
    black = replace(ROOM, materials=(grey(0.0), lamp(0.0), grey(0.999)), lights=())
    solver = solve(black, photons=10)
    assert not solver.irradiance.any()


def test_a_refused_setting_changes_nothing():
    solver = Solver(ROOM, photons=10, radius=0.1)
    with pytest.raises(SceneError, match="radius must be a finite number > 0, .*, got -1"):
        solver.configure(photons=20, radius=-1)
    assert (solver.photons, solver.setting.radius) == (10, 0.1)


@pytest.mark.parametrize(
    "setting", [{"photons": -1}, {"radius": 0}, {"radius": "wide"}, {"neighbours": 0}, {"threads": 0}]
)
def test_a_solver_refuses_settings_out_of_range(setting):
    with pytest.raises(SceneError, match=f"{next(iter(setting))} must be"):
        Solver(ROOM, **setting)


def test_no_photons_no_light():
    solver = solve(ROOM, photons=0)
    assert solver.photons == 0 and not solver.irradiance.any()


class Beam(NamedTuple):
    """A kind of light that nothing knows."""

    name: str = "beam"
    position: tuple = (0.0, 0.0, 0.0)
    direction: tuple = (0.0, 0.0, -1.0)
    radiance: tuple = WHITE


def test_an_unknown_kind_of_light_is_refused():
    """No other kind may stand in for it: it became a sky to this check, and was absent to shadow rays."""
    with pytest.raises(SceneError, match='light "beam" must be a .*PointLight, .*SkyLight, .* got a Beam'):
        check_scene(with_light(Beam()))
    surfaces, _ = flatten(with_light(Beam()))
    with pytest.raises(KeyError, match="Beam"):
        delta_lights(with_light(Beam()))
    with pytest.raises(KeyError, match="Beam"):
        build_emitters(with_light(Beam()), surfaces, np.zeros(3), 1.0)
