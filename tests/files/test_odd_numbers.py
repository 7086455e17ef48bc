"""Odd values in files and in the arguments of load_scene: one sentence, or a scene that can be solved."""

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.scene import SceneError
from gi_core.solver import Solver
from tests.support.mesh_writers import BOX, BOX_FACES, SCENE, write_glb, write_obj, write_room, write_scene
from tests.unit.scene.test_odd_values import NEVER, PERHAPS

PLACED = "position = [0.3, 0.0, 0.3]\n"
LAMP = (
    '[[light]]\ntype = "spot"\nname = "s"\nposition = [0.5, 0.9, 0.5]\ndirection = [0, -1, 0]\nintensity = [1, 1, 1]\n'
)
LAMP += "inner_degrees = 30\nouter_degrees = 60\n"


def outcome(load) -> str:
    """Return the sentence of a refusal; "" for a scene with finite light."""
    try:
        solver = Solver(load(), photons=200, radius=0.1)
    except SceneError as problem:
        assert str(problem).isprintable()
        return str(problem)
    solver.solve()
    assert np.isfinite(solver.irradiance).all() and (solver.irradiance >= 0).all()
    return ""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (PLACED, PLACED + "axis = [0, 1e-300, 0]\nangle = 30\n", 'mobile "cube": axis must be three numbers'),
        ('title = "test"', "up = [0, 0, 1e-300]", 'up must be "x", "y", "z" or three numbers'),
        (LAMP, LAMP.replace("[0, -1, 0]", "[0, -1e-300, 0]"), 'light "s": direction must be three numbers'),
        (LAMP, LAMP.replace("[1, 1, 1]", "[1e308, 1, 1]"), 'light "s": intensity must be three numbers'),
        (LAMP, LAMP.replace("30", "nan"), 'light "s": inner_degrees must be'),
        (PLACED, "position = [1e300, 0, 0]\n", 'mobile "cube": position must be three finite numbers'),
        (PLACED, "scale = 1e-310\n", 'mobile "cube": scale must be a finite number > 0, from 1e-15'),
        (PLACED, "scale = 1e14\n", 'mobile "cube": a mobile must be 1e-06 to 1e+09 m large, got 2e+13'),
        (PLACED, PLACED + "max_edge = 5e-324\n", 'mobile "cube": max_edge must be a finite number > 0, from 1e-15'),
        (LAMP, LAMP.replace("[0.5, 0.9, 0.5]", "[1e7, 0.9, 0.5]"), "reach over 1e+07 m, more than 1000 times"),
        ('title = "test"', "[defaults]\nphotons = 1000000000000", "photons must be a whole number from 1 to"),
    ],
)  # fmt: skip
def test_odd_numbers_of_scene_files(tmp_path, old, new, message):
    text = SCENE + LAMP
    assert old in text
    file = write_scene(tmp_path, text.replace(old, new))

    def load():
        scene = load_scene(file, max_edge=0.5)
        Solver(scene)  # with the defaults of the file
        return scene

    said = outcome(load)
    assert said.startswith(("test: ", "scene: ", str(file))) and message in said


@pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-300, 1e-40, 1e-7, 1e10, 1e30, 3e38])
def test_a_mobile_of_odd_size(tmp_path, size):
    """One of denormal size was a division by zero; a GLB's float32 ends at 1e-45."""
    write_room(tmp_path)
    if size > 1e-45:
        write_glb(tmp_path / "m.glb", np.array(BOX) * size, BOX_FACES)
    write_obj(tmp_path / "m.obj", np.array(BOX) * size, BOX_FACES)
    for mobile in tmp_path.glob("m.*"):
        said = outcome(lambda m=mobile: load_scene(tmp_path / "room.obj", mobiles=[m], max_edge=0.5))
        assert "m large" in said or "every triangle of the mesh has zero area" in said or "vertices" in said, said


@pytest.mark.parametrize("name", ["path", "mobiles", "max_edge", "up", "allow_outside"])
def test_odd_arguments(tmp_path, name):
    room = write_scene(tmp_path)
    for value in [*NEVER, *PERHAPS, "\0", "x\0y", "a" * 5000, "\udcff", ["\0"], [b"a"], [None], object()]:
        if name == "path":
            assert outcome(lambda v=value: load_scene(v))
            continue
        said = outcome(lambda v=value: load_scene(room, **{"max_edge": 0.5, name: v}))
        never = any(value is v for v in [*NEVER, "\0"]) or name == "mobiles"
        as_is = name == "max_edge" and isinstance(value, float) and value == np.inf
        assert said or not never or as_is or (name, value) in (("up", "x"), ("mobiles", []))
