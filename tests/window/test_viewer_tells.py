"""The window says where it stands: progress, pictures of earlier settings, keys, files, sizes."""

import math
import os
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest
from imgui_bundle import imgui

from app.session.opening import Opening
from app.window import dialogs, label, menus, overlay, readout_marks
from app.window.panel import Section
from app.window.panel import widgets as ui
from app.window.panel.quality import status_of
from tests.support import viewer_support as support
from tests.support.viewer_hand import errors, in_window
from tests.support.viewer_hand import keys as named_keys

CTRL = int(named_keys().mod_ctrl)


@pytest.fixture
def written(monkeypatch):
    """Texts of the plates over the picture, with their boxes, since the last clear()."""
    seen, draw = {}, label.draw
    monkeypatch.setattr(
        label, "draw", lambda text, at, *more, **others: seen.update({text: at}) or draw(text, at, *more, **others)
    )
    return seen


@in_window()
def test_opening_another_scene_is_said_in_the_middle_of_the_picture_beside_a_hint(hand, viewer, written):
    view = viewer.viewport.view
    hand.move(hand.at((0.5, 0.3, 0.62)))
    opening = SimpleNamespace(progress=("loading scene: kitchen", None), done=False)
    viewer.reload.coming = SimpleNamespace(
        opening=opening, ready=False, problem=None, tick=lambda *_, **__: None, close=lambda *_: None
    )
    written.clear()
    hand.ctx.yield_(3)
    left, top, right, bottom = written["loading scene: kitchen"]
    x, y = (
        (c - o) / s for c, o, s in zip(((left + right) / 2, (top + bottom) / 2), view.origin, view.size, strict=True)
    )
    assert abs(x - 0.5) < 0.02 and abs(y - 0.5) < 0.1
    assert any(text.startswith("Drag block") for text in written)
    viewer.reload.coming = None


@in_window()
def test_an_estimator_chosen_is_named_in_the_picture_and_old_numbers_are_dim(hand, viewer, written, monkeypatch):
    dim, write = set(), imgui.text

    def noted(text):
        write(text)
        if imgui.get_style().alpha < 1:
            dim.add(text)

    monkeypatch.setattr(imgui, "text", noted)
    session, shapes = viewer.session, lambda: readout_marks.marks(viewer.viewport)
    hand.move(hand.at((0.2, 0.8, 0.0)))
    hand.press(named_keys().i)
    hand.ctx.yield_(3)
    assert [x.opacity for x in shapes().labels] == [1.0]
    configure = session.light.configure
    session.light.configure = lambda *_: False  # the solver stays busy
    written.clear()
    hand.press(named_keys()._2)
    hand.ctx.yield_(3)
    name = session.settings.estimator.replace("_", " ").capitalize()
    assert f"{name}: computing" in written and "probe" not in dim
    assert not session.is_current and status_of(session).text == "computing"
    assert sum(text.endswith("W/m²") for text in dim) == 2, "the numbers of probe and pin"
    assert [x.opacity for x in shapes().labels] == [readout_marks.OF_BEFORE]
    session.light.configure = configure
    hand.wait_for_light()
    hand.wait(lambda: f"{name}, photons only" in written)
    written.clear()
    hand.wait(lambda: not viewer.viewport.is_fading)
    written.clear()
    hand.ctx.yield_(3)
    assert not any(name in text for text in written)


@in_window()
def test_the_outline_of_a_clicked_surface_goes_without_input(hand, viewer):
    viewport = viewer.viewport
    wall = hand.at((0.2, 0.8, 0.0))
    hand.move(wall)
    hand.ctx.mouse_click(0)
    hand.ctx.yield_(3)
    hand.move((5, 5))
    assert viewport.surface == "white" and len(viewport.look().surface) and viewport.is_fading
    hand.wait(lambda: not viewport.is_fading)
    hand.ctx.yield_(2)
    assert viewport.surface == "white" and viewport.look().surface is None


@pytest.mark.parametrize("moving", [False, True])
@in_window()
def test_frames_per_second_are_shown_in_motion_alone(hand, viewer, monkeypatch, moving):
    states = []
    draw = overlay.draw_status
    monkeypatch.setattr(
        overlay, "draw_status", lambda log, readout, state, now: states.append(state) or draw(log, readout, state, now)
    )
    if moving:
        hand.press(named_keys().space)
    states.clear()
    hand.ctx.yield_(5)
    assert states[-1].endswith("frames/s") is moving


@pytest.mark.parametrize("size", [(1280, 800), (720, 540)])
def test_at_twice_the_size_the_panel_is_as_wide_in_letters_and_the_state_stays(play, size):
    widths = []

    def script(hand, viewer):
        hand.wait_for_light()
        hand.ctx.set_ref("##MainMenuBar")
        for percent in (100, 200, 100):
            hand.ctx.menu_click(f"View/Interface size/{percent} %")
            hand.ctx.yield_(5)
            widths.append(hand.ctx.get_window_by_ref("//Panel").size.x / imgui.get_font_size())

    assert errors(play(script, replace(support.SETTINGS, size=size))) == []
    assert widths[0] == widths[2]
    assert widths[1] == pytest.approx(widths[0] if size[0] > 1000 else 0.55 * size[0] / 32, abs=0.1)


@in_window(size=(720, 900))
def test_a_click_in_the_picture_leaves_the_panels_rows_where_they_are(hand, viewer):
    """A surface in place of the object with parts, then nothing: at scroll 0 rows moved up when those above went."""
    hand.panel("Scene", "Objects", opened="Material")
    hand.ctx.mouse_move("Picture")
    hand.ctx.yield_(2)
    before, surfaces = hand.ctx.item_info("Picture").rect_full.min.y, []
    for y in (0.8, 1.4, 0.8, 1.4):
        hand.click((0.2, y, 0.0))
        assert hand.ctx.item_info("Picture").rect_full.min.y == pytest.approx(before, abs=1)
        surfaces.append(viewer.viewport.surface)
    assert surfaces == ["white", "", "white", ""]


@in_window(size=(720, 900))
def test_a_click_on_a_lamps_name_leaves_its_row_under_the_mouse(hand, viewer):
    """The selected object's material went, so that a second click met "Reset lamps"."""
    hand.panel("Objects", opened="Material")
    assert viewer.viewport.selection
    hand.ctx.mouse_move("**/lamp/###select")
    before = hand.ctx.item_info("Lamps").rect_full.min.y
    hand.ctx.mouse_click(0)
    hand.ctx.yield_(4)
    assert viewer.viewport.lamps.selected is not None and not viewer.viewport.selection
    assert hand.ctx.item_info("Lamps").rect_full.min.y == pytest.approx(before, abs=1)


def test_a_key_right_after_a_chord_is_not_lost():
    """Ctrl+Z in one frame; in the next Ctrl is up and Tab down. Ctrl down, then Ctrl+Z and its release in a frame."""
    K, before = named_keys(), imgui.get_current_context()
    context = imgui.create_context()
    imgui.set_current_context(context)
    try:
        io, keyboard, seen = imgui.get_io(), menus.Keyboard(), []
        io.display_size, io.delta_time = (100, 100), 0.1
        io.set_ini_filename("")
        io.backend_flags |= imgui.BackendFlags_.renderer_has_textures
        ctrl = K.left_ctrl, K.mod_ctrl
        frames = [
            [*((k, True) for k in ctrl), (K.z, True)], [],
            [(K.z, False), *((k, False) for k in ctrl), (K.tab, True)], [(K.tab, False)],
            [(k, True) for k in ctrl], [(K.z, True), *((k, False) for k in ctrl)], [(K.z, False)],
        ]  # fmt: skip
        for events in frames:
            for event in events:
                io.add_key_event(*event)
            imgui.new_frame()
            seen.append(keyboard.pressed())
            imgui.end_frame()
        assert seen == [["undo"], [], ["toggle panel"], [], [], ["undo"], []]
    finally:
        imgui.destroy_context(context)
        if before is not None:
            imgui.set_current_context(before)


def test_a_second_ctrl_q_quits_without_saving(play):
    def script(hand, viewer):
        hand.wait_for_light()
        poses = {"block": viewer.session.poses["block"]._replace(position=(0.7, 0.4, 0.6))}
        viewer.session.move(poses)
        hand.wait_for_light()
        hand.press(CTRL | int(named_keys().q))
        assert viewer.files.question.is_open and not viewer._may_leave
        hand.press(CTRL | int(named_keys().q))
        assert viewer._may_leave

    play(script, quits=True)


@in_window()
def test_files_are_chosen_from_a_list_where_the_system_has_no_dialog(hand, viewer, folder, monkeypatch):
    opened = []
    monkeypatch.setattr(dialogs, "has_native", lambda: False)
    (folder / "rooms").mkdir()
    for name in ("kitchen.glb", "hall.OBJ", "notes.txt", ".hidden.glb"):
        (folder / "rooms" / name).write_bytes(b"")
    viewer.menus._open = viewer.open_scene = lambda path: opened.append(path)
    dialog = viewer.files.dialog
    dialog.open("Open a scene", f"{folder}/", dialogs.SCENES[:2], opened.append)
    hand.ctx.yield_(3)
    hand.ctx.set_ref("//Open a scene###File")
    hand.ctx.item_click("**/rooms\\/")
    hand.ctx.yield_(3)
    assert dialog._entries == ("hall.OBJ", "kitchen.glb")
    hand.ctx.item_click("**/kitchen.glb")
    hand.ctx.yield_(2)
    hand.ctx.item_click("OK")
    hand.ctx.yield_(2)
    assert opened == [str(folder / "rooms/kitchen.glb")]
    dialog.open("Open a scene", f"{folder}/", dialogs.SCENES[:2], opened.append)
    assert dialog._path == str(folder / "rooms") + os.sep, "that of the last file, not of the scene"


@pytest.mark.parametrize("objects", [0, 2])
def test_a_first_look_says_that_objects_cannot_be_dragged_yet(play, written, objects):
    seen = threading.Event()

    def slow(settings):
        assert seen.wait(support.PATIENCE)
        return support.room()

    def script(hand, viewer):
        opening = viewer.session.opening
        hand.wait(lambda: opening.phase == "loading scene")
        viewer.painter.draw_look = lambda look, settings: None
        opening.look = SimpleNamespace(models=(None,) * (1 + objects), noise=math.inf)
        hand.ctx.yield_(3)
        assert ("Objects can be dragged when it is done" in written) == bool(objects)
        width = hand.ctx.get_window_by_ref("Panel").size.x
        opening.look = None
        seen.set()
        hand.wait_for_light()
        assert abs(hand.ctx.get_window_by_ref("Panel").size.x - width) < 4, "the picture moved when the controls came"

    assert errors(play(script, open_with=lambda s: Opening(s, load=slow))) == []


def test_a_file_opened_while_the_first_kernels_compile_is_named_and_opens_after_them(play, folder, written):
    """Nothing was said for a minute, and two processes compiled the same kernels."""
    asked, go = [], threading.Event()
    (folder / "mine.toml").write_text("")

    def open_with(settings):
        asked.append(settings.scene)

        def load(_):
            assert go.wait(support.PATIENCE)
            return support.room()

        return Opening(settings, load=load)

    def script(hand, viewer):
        hand.wait(lambda: viewer.session.opening is not None)
        viewer.open_scene("mine.obj")
        hand.ctx.yield_(3)
        assert len(asked) == 1 and "Then opens: mine.obj" in written
        go.set()
        hand.wait(lambda: len(asked) == 2 and viewer._ready and viewer.reload.coming is None)
        assert asked[1] == viewer.session.settings.scene == "mine.obj" and viewer.reload.waiting == []

    assert errors(play(script, open_with=open_with)) == []


@in_window()
def test_a_long_name_leaves_the_bar_of_progress_in_sight(hand, viewer, written):
    name = "e" * 250
    assert Opening(replace(support.SETTINGS, scene=f"/a/b/{name}.toml"))._name == f"{name}.toml"
    opening = SimpleNamespace(progress=(f"loading scene: {name}", None), done=False)
    viewer.reload.coming = SimpleNamespace(
        opening=opening, ready=False, problem=None, tick=lambda *_, **__: None, close=lambda *_: None
    )
    written.clear()
    hand.ctx.yield_(3)
    left, top, right, bottom = written[f"loading scene: {name}"]
    view = viewer.viewport.view
    assert bottom <= view.origin[1] + view.size[1] / 2
    viewer.reload.coming = None


@in_window(size=(720, 900))
def test_a_section_that_is_seen_whole_unfolds_without_a_scroll(hand, viewer):
    """The panel scrolled until the section ended at its lower edge, and another button was under the mouse."""
    hand.panel("Material")
    hand.ctx.scroll_to_y("//Panel", 150.0)
    hand.ctx.yield_(2)
    before = hand.ctx.item_info("Material").rect_full.min.y
    hand.ctx.item_click("Material")
    hand.ctx.yield_(4)
    assert hand.ctx.item_info("Material").rect_full.min.y == pytest.approx(before, abs=1)


@in_window()
def test_two_clicks_of_a_slow_frame_are_a_double_click(hand, viewer, monkeypatch):
    """ImGui takes one event per frame: at 5 frames/s the second press came 0.4 s after the first."""
    seen, begin = [], viewer.clock.begin

    def slow(has_input):
        time.sleep(0.2)
        seen.append(imgui.is_mouse_double_clicked(0))
        return begin(has_input)

    monkeypatch.setattr(viewer.clock, "begin", slow)
    hand.move(hand.at((0.2, 0.8, 0.0)))
    hand.ctx.mouse_double_click(0)
    hand.ctx.yield_(2)
    monkeypatch.undo()
    assert any(seen)


@in_window(show="illuminance")
def test_colours_of_the_method_have_no_legend_of_light(hand, viewer):
    hand.wait(lambda: viewer.viewport.legend is not None)
    hand.press(named_keys().c)
    hand.wait(lambda: viewer.viewport.shown.recomputed is not None)
    assert viewer.viewport.legend is None


@in_window()
def test_values_too_long_for_a_row_wrap(hand, viewer, monkeypatch):
    """24 W ... without default lig: the rest was beyond the panel's edge."""
    ends = []

    def drawn(s, window, actions):
        ui.number("Power", "24 W, 2 W/m² of 12 m² floor; without a lamp, another lamp, of unknown watts", "")
        edge = imgui.get_window_pos().x + imgui.get_window_size().x
        ends.append((imgui.get_item_rect_max().x, edge))
        return s

    monkeypatch.setattr("app.window.panel.SECTIONS", (Section("Only", drawn),))
    hand.ctx.yield_(3)
    assert ends and all(end <= edge for end, edge in ends)
