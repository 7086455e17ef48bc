"""Lamps added, moved, aimed, copied and removed in the window; the light equals that of a scene built so."""

import ctypes
import dataclasses
import os

import numpy as np
import pytest
from imgui_bundle import imgui

from app.cli import saved_scene
from app.session.lights import PANEL, LightId, aim_of
from app.settings import LampLevel, make_solver, open_scene
from app.window.actions import lamps as actions
from app.window.drag import TURN_SPEED
from app.window.panel import widgets as ui
from app.window.panel.lights import FILE
from gi_core.files.edits import Darken, Light
from gi_core.geometry.error import luminance
from gi_core.lights.lamps import OTHERS
from gi_core.scene import PointLight, SpotLight
from gi_core.solver import Solver
from tests.support import viewer_support as support
from tests.support.photometry import write_ies
from tests.support.viewer_hand import errors, in_window, keys
from tests.window.test_viewer_edits import built, change

BULB, SPOT = LightId("bulb"), LightId("spot")


def lit_room():
    """The room with its lamp of faces, a bulb and a spot in sight of the camera."""
    bulb = PointLight("bulb", (0.8, 0.2, 0.8), (4.0, 4.0, 8.0))
    spot = SpotLight("spot", (0.2, 0.8, 0.6), (0.0, -1.0, 0.0), (3.0, 3.0, 3.0), 10.0, 25.0)
    return dataclasses.replace(support.room(), lights=(bulb, spot))


def is_that_of_a_new_solver(session) -> bool:
    return np.array_equal(session.irradiance, built(session, lit_room))


@in_window(scene=lit_room)
def test_a_mark_is_dragged_and_the_light_follows(hand, viewer):
    first, lamps = viewer.session, viewer.viewport.lamps
    before = first.irradiance
    start = hand.at((0.8, 0.2, 0.8))
    hand.drag(start, start, steps=1)
    assert lamps.selected == BULB and viewer.viewport.selection == () and viewer.session is first

    change(hand, viewer, lambda: hand.drag(start, (start[0] - 60, start[1]), steps=6))
    x, y, z = viewer.session.scene.lights[0].position
    assert x < 0.7 and y == pytest.approx(0.2) and not np.array_equal(viewer.session.irradiance, before)
    assert is_that_of_a_new_solver(viewer.session)
    assert lamps.selected == BULB and viewer.log.last.text == "edited: lamp bulb"
    moved = viewer.session.settings.edits
    assert len(moved) == 1, "one drag is one edit"

    shift = keys().mod_shift
    at = hand.at((x, y, z))
    change(hand, viewer, lambda: hand.drag(at, (at[0], at[1] - 50), modifier=shift, steps=4))
    px, py, pz = viewer.session.scene.lights[0].position
    assert py > 0.25 and (px, pz) == pytest.approx((x, z))
    for edits in (moved, ()):
        change(hand, viewer, lambda: viewer._do("undo"))
        assert viewer.session.settings.edits == edits
    assert np.array_equal(viewer.session.irradiance, before)
    change(hand, viewer, lambda: viewer._do("redo"))
    assert viewer.session.settings.edits == moved


@in_window(scene=lit_room)
def test_the_aim_is_dragged_over_surfaces(hand, viewer):
    viewer._do(("select lamp", SPOT))
    hand.ctx.yield_(3)
    foot, target = hand.at((0.2, 0.0, 0.6)), (0.7, 0.0, 0.9)
    change(hand, viewer, lambda: hand.drag(foot, hand.at(target), steps=5))
    spot = viewer.session.scene.lights[1]
    way = np.subtract(target, spot.position)
    assert spot.direction == pytest.approx(way / np.linalg.norm(way), abs=0.02) and spot.position == (0.2, 0.8, 0.6)
    assert is_that_of_a_new_solver(viewer.session)

    # Ctrl turns it about the vertical, where it is.
    at = hand.at(spot.position)
    change(hand, viewer, lambda: hand.drag(at, (at[0] + 80, at[1]), modifier=keys().mod_ctrl, steps=4))
    turned = viewer.session.scene.lights[1]
    assert turned.position == spot.position and turned.direction[1] == pytest.approx(spot.direction[1], abs=1e-6)
    view = viewer.viewport.view
    degrees = 80 / view.size[1] * TURN_SPEED
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, _, z = spot.direction
    assert turned.direction[::2] == pytest.approx((c * x + s * z, c * z - s * x), abs=0.03)
    change(hand, viewer, lambda: viewer._do("undo"))

    # Esc during a drag brings the light back.
    ctx, at = hand.ctx, hand.at(spot.position)
    hand.move(at)
    ctx.mouse_down(0)
    hand.move((at[0] + 40, at[1]))
    hand.move((at[0] + 50, at[1]))
    assert viewer.session.lights[SPOT].position != spot.position, "the mark follows at once"
    hand.press(keys().escape)
    ctx.mouse_up(0)
    hand.wait(lambda: not viewer.session.is_editing and viewer.reload.coming is None)
    hand.wait_for_light()
    assert viewer.session.scene.lights[1] == spot


@in_window(scene=lit_room)
def test_lamps_are_added_copied_and_removed_by_the_panel(hand, viewer, folder):
    ctx, viewport = hand.ctx, viewer.viewport
    hand.panel("Objects", "Scene")
    ctx.item_click("**/bulb/bulb###select")
    assert viewport.lamps.selected == BULB
    change(hand, viewer, lambda: ctx.item_click("**/Duplicate lamp"))
    assert [light.name for light in viewer.session.scene.lights] == ["bulb", "spot", "bulb 2"]
    assert viewport.lamps.selected == LightId("bulb 2") and viewer.log.last.text == "added: lamp bulb 2"
    copy, bulb = viewer.session.scene.lights[2], viewer.session.scene.lights[0]
    assert copy.flux == bulb.flux and copy.position[0] > bulb.position[0] + 0.01
    change(hand, viewer, lambda: ctx.item_input_value("**/##Position y", 0.6))
    assert viewer.session.scene.lights[2].position[1] == pytest.approx(0.6)
    assert is_that_of_a_new_solver(viewer.session)

    # Its flux is a number, which sets its level without an edit.
    now, edits = viewer.session, viewer.session.edits
    emitters = viewer.session.model.emitters
    full = float(luminance(emitters.flux_of_lamps[emitters.lamps.names.index("bulb 2")]))
    ctx.item_input_value("**/##Flux flux", 0.5 * full)
    hand.wait_for_light()
    assert viewer.session is now and now.edits == edits
    (level,) = now.settings.lamps
    assert level.name == "bulb 2" and level.level == pytest.approx(0.5, rel=1e-4)

    # A removed lamp keeps its level for an undo.
    change(hand, viewer, lambda: ctx.item_click("**/Remove lamp"))
    assert "bulb 2" not in viewer.session.model.emitters.lamps.names and viewport.lamps.selected is None
    assert viewer.session.settings.lamps == (level,) and viewer.log.last.text == "removed: lamp bulb 2"
    viewer.session.want(dataclasses.replace(viewer.session.settings, solo="bulb"))
    hand.wait_for_light()
    assert viewer.session.light.snapshot.levels.max(axis=1).tolist() == [0.0, 1.0, 0.0]
    viewer.session.want(dataclasses.replace(viewer.session.settings, solo=""))
    hand.wait_for_light()
    viewer.files.save(viewer.session, viewport, str(folder / "removed.toml"))
    assert saved_scene.read(str(folder / "removed.toml")).edits == viewer.session.settings.edits
    change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.light.snapshot.levels.max(axis=1) == pytest.approx([1.0, 1.0, 1.0, 0.5], rel=1e-4)

    for kind, name, x in (("panel", "panel", 0.5), ("spot", "spot 2", 0.65), ("sun", "sun", 0.8)):
        floor = hand.at((x, 0.0, 0.9))  # away from the aim of the last one
        hand.drag(floor, floor, steps=1)
        hand.wait(lambda: viewport.clicked is not None and viewport.lamps.selected is None)
        change(hand, viewer, lambda kind=kind: viewer._do(("add lamp", kind)))
        light = viewer.session.scene.lights[-1]
        assert light.name == name and viewport.lamps.selected == LightId(name) and viewport.clicked is None
        if kind != "sun":
            assert 0.9 < light.position[1] < 0.995 and light.direction == (0.0, -1.0, 0.0)
    assert is_that_of_a_new_solver(viewer.session)
    document, _ = viewer.files.save(viewer.session, viewport, str(folder / "lamps.toml"))
    read = saved_scene.read(str(document))
    assert read.edits == viewer.session.settings.edits and read.lamps == (level,)


@in_window(scene=lit_room)
def test_key_f_frames_the_selected_lamp(hand, viewer):
    for lamp, place in ((SPOT, (0.2, 0.8, 0.6)), (LightId("lamp"), (0.5, 0.995, 0.5))):
        viewer._do(("select lamp", lamp))
        hand.press(keys().f)
        hand.wait(lambda place=place: viewer.viewport.view.camera.pivot == pytest.approx(place, abs=1e-3))
    hand.wait(lambda: not viewer.viewport.control.is_moving)
    near = viewer.viewport.view.camera.distance
    viewer._do(("select lamp", None))
    hand.press(keys().f)
    hand.wait(lambda: viewer.viewport.view.camera.distance > 2 * near)


@in_window(scene=lit_room)
def test_surfaces_that_shine_become_a_panel(hand, viewer):
    before = viewer.session.irradiance
    viewer._do(("select lamp", LightId("lamp")))
    hand.ctx.yield_(2)
    viewer._do("duplicate lamp")
    assert "make the lamp movable first" in viewer.log.last.text
    change(hand, viewer, lambda: viewer._do("replace lamp"))
    session = viewer.session
    assert viewer.log.last.text == "made movable: lamp"
    panel = session.lights[LightId("lamp")]
    assert panel.position == pytest.approx((0.5, 0.995, 0.5), abs=2e-3) and panel.size == pytest.approx((0.3, 0.3))
    assert panel.direction == pytest.approx((0.0, -1.0, 0.0)) and not any(
        max(m.emission) for m in session.scene.materials
    )
    assert session.model.emitters.total_flux == pytest.approx(Solver(lit_room(), photons=0).model.emitters.total_flux)
    # It gives the same light, within the noise of 20,000 photons, and one that is removed leaves none.
    mean = session.irradiance.mean(axis=0) / before.mean(axis=0)
    assert mean == pytest.approx(np.ones(3), abs=0.05)
    change(hand, viewer, lambda: viewer._do("remove"))
    assert viewer.session.model.emitters.lamps.names == ("bulb", "spot")
    for lamp in ("bulb", "spot"):
        viewer._do(("select lamp", LightId(lamp)))
        hand.ctx.yield_(2)
        if lamp == "bulb":
            change(hand, viewer, lambda: viewer._do("remove lamp"))
        else:
            viewer._do("remove lamp")
    assert "the last lamp stays" in viewer.log.last.text and len(viewer.session.scene.lights) == 1


@in_window(scene=lit_room, problems=None)
def test_a_photometric_file_is_dropped_on_a_lamp_and_on_the_floor(hand, viewer, folder):
    gammas, planes = [0.0, 30.0, 60.0, 90.0], [0.0]
    file = write_ies(folder / "down.ies", gammas, planes, np.array([[900.0, 600.0, 100.0, 0.0]]))
    hand.move(hand.at((0.8, 0.2, 0.8)))
    assert tuple(imgui.get_mouse_pos()) == pytest.approx(hand.at((0.8, 0.2, 0.8)), abs=1)
    change(hand, viewer, lambda: viewer.reload.dropped.append(str(file)))
    bulb = viewer.session.scene.lights[0]
    assert bulb.name == "bulb" and bulb.position == (0.8, 0.2, 0.8) and bulb.flux == (4.0, 4.0, 8.0)
    assert bulb.gammas_degrees.tolist() == gammas and viewer.viewport.lamps.selected is None
    hand.move(hand.at((0.2, 0.0, 0.8)))
    change(hand, viewer, lambda: viewer.reload.dropped.append(str(file)))
    down = viewer.session.scene.lights[-1]
    assert down.name == "down" and down.position == pytest.approx((0.2, 0.99, 0.8), abs=0.02)
    assert viewer.session.file_of(viewer.viewport.lamps.selected) == str(file) and max(down.flux) > 0
    assert str(file) in viewer.files._watch._files, "a changed file is read again"
    assert is_that_of_a_new_solver(viewer.session)
    document, _ = viewer.files.save(viewer.session, viewer.viewport, str(folder / "file.toml"))
    assert 'file = "down.ies"' in document.read_text() and str(folder) not in document.read_text()
    assert saved_scene.read("file.toml").edits[1] == Light("down", viewer.session.edits[1].light, str(file))

    # A file that cannot be used leaves one sentence.
    (folder / "bad.ies").write_text("no photometry")
    actions.use_file(viewer, None, str(folder / "bad.ies"))
    hand.wait(lambda: not viewer.session.is_editing)
    assert "an IES file must have a line TILT" in viewer.log.last.text
    asked: list = []
    viewer.files.dialog.open = lambda *given: asked.append(given)
    viewer._do(("add lamp", FILE))
    viewer._do("lamp file")
    assert [title for title, *_ in asked] == ["Choose a luminaire"] * 2
    assert all("bad.ies" in error for error in errors(viewer))


@in_window(scene=lit_room)
def test_angles_of_the_panel_turn_a_lamp(hand, viewer):
    ctx = hand.ctx
    hand.panel("Objects", "Scene")
    viewer._do(("select lamp", SPOT))
    hand.ctx.yield_(2)
    change(hand, viewer, lambda: ctx.item_input_value("**/##Tilt angle", 90.0))
    assert viewer.session.scene.lights[1].direction[1] == pytest.approx(0.0, abs=1e-6)
    flux = viewer.session.model.emitters.flux_of_lamps[2]
    change(hand, viewer, lambda: ctx.item_input_value("**/##Outer cone angle", 50.0))
    spot = viewer.session.scene.lights[1]
    assert spot.outer_degrees == 50.0 and spot.inner_degrees == 10.0
    assert viewer.session.model.emitters.flux_of_lamps[2] == pytest.approx(flux)
    change(hand, viewer, lambda: viewer._do(("change light", BULB, (("position", (0.1, 0.1, 0.1)),))))
    assert viewer.session.scene.lights[0].position == (0.1, 0.1, 0.1)
    viewer._do("lamp marks")
    hand.move(hand.at(spot.position))
    assert not viewer.viewport.lamps.takes_mouse and not viewer.viewport.lamps.are_shown


@in_window(scene=lit_room)
def test_each_number_of_a_lamp_has_a_label_and_its_unit(hand, viewer, monkeypatch):
    """Three angles stood in one row without names, and sides without metres."""
    drawn, fields = {}, ui.fields
    monkeypatch.setattr(ui, "fields", lambda name, *given: (drawn.update({name: given}), fields(name, *given))[1])
    ctx = hand.ctx
    hand.panel("Objects", "Scene")
    drawn.clear()
    change(hand, viewer, lambda: viewer._do(("add lamp", PANEL)))
    name = viewer.viewport.lamps.selected
    assert name.name == PANEL
    for label, number in (("Tilt", 60.0), ("Heading", 40.0), ("Turn", 20.0)):
        change(hand, viewer, lambda: ctx.item_input_value(f"**/##{label} angle", number))  # noqa: B023
    assert aim_of(viewer.session.lights[name], viewer.session.scene.up) == pytest.approx((60.0, 40.0, 20.0))
    units = {label: given[2] for label, given in drawn.items()}
    assert units == {
        "Flux": "%.5g W", "Watts": "%.5g W", "Position": "%.3f", "Tilt": "%.1f°", "Heading": "%.1f°", "Turn": "%.1f°",
        "Size": "%.3f m",
    }  # fmt: skip
    ctx.item_input_value("**/##Watts watts", 44.0)
    ctx.yield_(2)
    assert viewer.session.settings.watts == ((PANEL, 44.0),) and viewer.session.power.of_lamp == {PANEL: 44.0}
    drawn.clear()
    viewer._do(("select lamp", SPOT))
    ctx.yield_(2)
    assert set(drawn) == {"Flux", "Watts", "Position", "Tilt", "Heading", "Inner cone", "Outer cone"}


@in_window(scene=lit_room)
def test_of_a_lamp_alone_that_is_removed_the_others_come_back(hand, viewer):
    viewer.session.want(dataclasses.replace(viewer.session.settings, solo="bulb"))
    hand.wait_for_light()
    assert viewer.session.light.snapshot.levels.max(axis=1).tolist() == [0.0, 1.0, 0.0]
    viewer._do(("select lamp", BULB))
    hand.ctx.yield_(2)
    change(hand, viewer, lambda: viewer._do("remove"))
    assert viewer.session.light.snapshot.levels.max(axis=1).tolist() == [1.0, 1.0]


BULBS = tuple(PointLight(f"bulb {k}", (0.1 + 0.04 * k, 0.9, 0.5), (1.0 + k, 1.0, 1.0)) for k in range(20))


@in_window(scene=lambda: dataclasses.replace(support.room(), lights=BULBS))
def test_the_weaker_lamps_together_cannot_be_edited(hand, viewer):
    viewer._do(("select lamp", LightId(OTHERS)))
    for action in ("remove lamp", "duplicate lamp", "replace lamp"):
        hand.ctx.yield_(3)
        viewer._do(action)
        assert "select one by its mark" in viewer.log.last.text and viewer.session.edits == ()
    viewer._do(("select lamp", LightId("bulb 0")))
    hand.ctx.yield_(3)
    assert "bulb 0" not in viewer.session.model.emitters.lamps.names
    viewer._do("remove lamp")
    assert viewer.session.edits == (Darken("bulb 0"),)


def test_levels_of_a_removed_lamp_are_no_mistake(folder):
    """The window saves them for an undo after the scene is opened again."""
    (folder / "a.toml").write_text(
        'scene = "office"\nedits = [{ kind = "darken", name = "pendant" }]\n[lamps]\npendant = 0.5\n'
    )
    settings = saved_scene.read("a.toml")
    assert settings.lamps == (LampLevel("pendant", 0.5),)
    solver = make_solver(open_scene(settings), settings)
    assert "pendant" not in solver.lamps.names


@in_window(scene=lit_room)
def test_a_new_lamp_hangs_off_the_wall_that_it_is_over(hand, viewer):
    """The middle of the picture was on the back wall: half of a luminaire was inside it. The floor is no wall."""
    hand.click((0.5, 0.6, 0.0))
    assert viewer.viewport.clicked.point == pytest.approx((0.5, 0.6, 0.0), abs=0.02)
    change(hand, viewer, lambda: viewer._do(("add lamp", PANEL)))
    x, y, z = viewer.session.scene.lights[-1].position
    assert (x, z) == pytest.approx((0.5, 1 / 3), abs=0.02) and y > 0.9


@in_window(scene=lit_room)
def test_a_lamp_of_much_more_light_says_that_the_exposure_stays(hand, viewer):
    """A luminaire of 2,000 lm in a room of 147 lm left a white picture without a word."""
    change(hand, viewer, lambda: viewer._do(("change light", BULB, (("flux", (400.0,) * 3),))))
    hand.ctx.yield_(2)
    assert viewer.log.last.text == "edited: lamp bulb; the exposure stays as it was: key A meters it"
    change(hand, viewer, lambda: viewer._do(("change light", BULB, (("flux", (500.0,) * 3),))))
    hand.ctx.yield_(2)
    assert viewer.log.last.text == "edited: lamp bulb"


@in_window(scene=lit_room)
def test_a_dropped_file_whose_name_is_no_utf8_becomes_a_lamp(hand, viewer, folder):
    """glfw's wrapper read the name as UTF-8: the window ended with a traceback."""
    import glfw

    write_ies(folder / "down.ies", [0.0, 60.0, 90.0], [0.0], np.array([[9.0, 6.0, 0.0]]))
    name = os.fsencode(folder) + b"/sp\xf6t.ies"
    try:
        os.rename(folder / "down.ies", name)
    except OSError:
        pytest.skip("this file system has UTF-8 names alone")

    def drop():
        window, call = glfw.get_current_context(), glfw._glfw.glfwSetDropCallback
        callback = call(window, glfw._GLFWdropfun(0))
        call(window, callback)
        callback(window, 1, (ctypes.c_char_p * 1)(name))

    hand.move(hand.at((0.2, 0.0, 0.8)))
    change(hand, viewer, lambda: hand._jobs.append(drop))
    light = viewer.session.scene.lights[-1]
    assert light.name == "sp\ufffdt" and max(light.flux) > 0
    document, copies = viewer.files.save(viewer.session, viewer.viewport, str(folder / "saved.toml"))
    assert copies and saved_scene.read(str(document)).edits
