"""Lights added, changed and removed; `test_edits.py` compares each such edit with a new solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gi_core.files.completion.completion import DEFAULT_LAMP, lit_by_stand_ins
from gi_core.files.edits import Darken, Light, edited, removed_lamps, with_edit
from gi_core.files.load import load_scene
from gi_core.scene.errors import SceneError
from gi_core.scene.types import LampLevel, LightScene, PointLight
from gi_core.solver import Solver, edited_solver, photons_of
from tests.physics.test_edits import EDITS, GIVEN, HIGHER, PANEL, room, solved
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb


@pytest.mark.parametrize(("edit", "lamp"), [(HIGHER, "bulb"), (EDITS["light turned"], "spot")])
def test_a_moved_light_retraces_its_own_photons_and_no_others(edit, lamp):
    solver = solved(room())
    photons = photons_of(solver).subset(GIVEN["photons"])[0].lamp
    own = int((photons == solver.lamps.names.index(lamp)).sum())
    assert 0 < own < 0.7 * GIVEN["photons"]
    other = edited_solver(solver, edited(room(), [edit]))
    other.solve()
    assert photons_of(other).traced == own
    assert not np.array_equal(other.irradiance, solver.irradiance)


def test_lights_are_added_changed_and_removed():
    scene = edited(room(), [PANEL, Light("panel", (("flux", (1.0, 2.0, 3.0)),)), Darken("bulb"), Darken("lamp")])
    spot, panel = scene.lights
    assert (spot.name, panel.name) == ("spot", "panel") and panel.flux == (1.0, 2.0, 3.0)
    assert panel.size == (0.1, 0.2) and panel.position == (0.2, 0.8, 0.9)
    assert not any(max(m.emission) for m in scene.materials)
    assert Solver(scene, photons=0).lamps.names == ("spot", "panel")


def test_of_lights_that_share_a_name_each_is_changed_by_its_number():
    lights = [PointLight("bulb", (x, 0.5, 0.5), (1.0, 1.0, 1.0)) for x in (0.2, 0.5, 0.8)]
    scene = room(lights=(*lights, PointLight("other", (0.5, 0.5, 0.9), (1.0, 1.0, 1.0))))
    second = Light("bulb", (("position", (0.5, 0.1, 0.5)),), number=2)
    assert [light.position[1] for light in edited(scene, [second]).lights] == [0.5, 0.1, 0.5, 0.5]
    rest = edited(scene, [Darken("bulb", 1), second]).lights
    assert [light.position[:2] for light in rest] == [(0.5, 0.5), (0.5, 0.1), (0.5, 0.5)]
    assert [light.name for light in edited(scene, [Darken("bulb")]).lights] == ["other"]
    with pytest.raises(SceneError, match="lamp 'bulb' has no light 4"):
        edited(scene, [Darken("bulb", 4)])


def test_changes_of_a_light_are_one_edit():
    there, later = Light("bulb", (("position", (0.5, 0.5, 0.9)),)), Light("bulb", (("flux", (2.0, 2.0, 2.0)),))
    both = Light("bulb", (("position", (0.7, 0.3, 0.5)), ("flux", (2.0, 2.0, 2.0))))
    edits = ()
    for edit in (there, EDITS["material"], HIGHER, later):
        edits = with_edit(edits, edit)
    assert edits == (EDITS["material"], both)
    assert with_edit((PANEL,), Light("panel", (("flux", (1.0,) * 3),)))[0].light[1] == PANEL.light[1]
    copy = Light("bulb 2", (), of="bulb")
    assert with_edit((there, copy), HIGHER) == (there, copy, HIGHER), "the copy is of the light before"
    assert with_edit((there, Darken("bulb")), PANEL) == (there, Darken("bulb"), PANEL)
    assert removed_lamps((Darken("bulb", 1),)) == set(), "others of that name are left"
    assert removed_lamps((Darken("bulb"), Darken("spot"), PANEL, Light("bulb", PANEL.light))) == {"spot"}


def test_the_plate_of_a_default_light_goes_with_it(tmp_path):
    """It would hang dark over the user's own lamps."""
    scene = load_scene(str(write_glb(tmp_path / "room.glb", 3 * BOX, BOX_FACES[:, ::-1])))
    own = Light("own", (("type", "point"), ("position", (0.1, 0.2, 0.3)), ("flux", (1.0, 1.0, 1.0))))
    lamps = {m.name for m in scene.materials if max(m.emission) > 0}
    assert lamps == {DEFAULT_LAMP} and lit_by_stand_ins(scene)
    lit = edited(scene, [own, Darken(DEFAULT_LAMP)])
    assert Solver(lit, photons=0).lamps.names == ("own",)
    of_plate = np.array([m.name == DEFAULT_LAMP for m in scene.materials])[scene.static.face_material]
    assert of_plate.any() and len(lit.static.faces) == len(scene.static.faces) - of_plate.sum()


def test_light_scenes_forget_a_removed_lamp():
    evening = LightScene("evening", (LampLevel("bulb", 0.5), LampLevel("spot", 0.2)))
    scene = edited(replace(room(), light_scenes=(evening,)), [Darken("bulb")])
    assert scene.light_scenes == (LightScene("evening", (LampLevel("spot", 0.2),)),)
