"""Files in the window: saving, opening, recent files, changes on disk, the question before it closes."""

import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from imgui_bundle import imgui

from app import __main__ as cli
from app.cli import saved_scene
from app.cli.options import settings_of
from app.session.opening import Opening
from app.settings import Settings, open_scene
from app.window import dialogs
from app.window.actions.lamps import use_file
from app.window.files import Files, Watch
from gi_core.scene import Camera, Pose
from tests.support import viewer_support as support
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb, write_textured_room
from tests.support.photometry import write_ies
from tests.support.viewer_hand import errors, in_window, keys

pytestmark = pytest.mark.usefixtures("folder")

AWAY = Pose((0.7, 0.4, 0.6))


@pytest.fixture(autouse=True)
def typed_paths(monkeypatch):
    monkeypatch.setattr(dialogs, "has_native", lambda: False)


class Loader:
    """Opens the small room for any settings, and lists them."""

    def __init__(self) -> None:
        self.asked: list[Settings] = []

    def __call__(self, settings):
        self.asked.append(settings)
        return Opening(settings, load=lambda settings: replace(support.room(), files=((settings.scene,),)))


def enter(hand, title: str, path, stays: bool = False) -> None:
    """Write a path into the dialog and confirm it; stays: the dialog refuses it or asks."""
    hand.wait(lambda: hand.viewer.files.dialog.is_open)
    hand.ctx.yield_(3)
    hand.ctx.set_ref(f"//{title}###File")
    hand.ctx.item_input_value("##path", str(path))
    hand.ctx.yield_(5)
    hand.wait(lambda: stays or not hand.viewer.files.dialog.is_open)
    assert hand.viewer.files.dialog.is_open == stays


@in_window()
def test_the_field_asks_before_it_replaces_a_file_and_ends_with_one_esc(hand, viewer, folder):
    K, other = keys(), folder / "project.toml"
    other.write_text("[project]\n")
    save = int(K.mod_ctrl) | int(K.mod_shift) | int(K.s)
    hand.press(save)
    hand.wait(lambda: viewer.files.dialog.is_open)
    hand.ctx.yield_(3)
    hand.press(K.escape)
    hand.ctx.yield_(3)
    assert not viewer.files.dialog.is_open
    for path in (other, folder / "project"):  # the suffix is added
        hand.press(save)
        enter(hand, "Save the scene", path, stays=True)
        assert other.read_text() == "[project]\n"
        hand.ctx.item_click("Cancel")
        hand.ctx.yield_(3)
    hand.press(save)
    enter(hand, "Save the scene", other, stays=True)
    hand.ctx.item_click("OK")
    hand.wait(lambda: not viewer.files.dialog.is_open)
    assert Path(saved_scene.read(str(other)).scene).name == "room"


@in_window()
def test_keys_do_not_reach_the_scene_behind_a_dialog(hand, viewer, folder):
    """The field has lost the focus, as by a click beside it: Shift+Del does nothing, Return confirms the dialog."""
    K = keys()
    viewer.viewport.select(("block",))
    hand.press(int(K.mod_ctrl) | int(K.mod_shift) | int(K.s))
    hand.wait(lambda: viewer.files.dialog.is_open)
    hand.ctx.yield_(3)
    hand._jobs.append(imgui.internal.clear_active_id)
    hand.ctx.yield_(3)
    assert not imgui.get_io().want_text_input
    hand.press(int(K.mod_shift) | int(K.delete))
    hand.wait_for_light()
    assert list(viewer.session.poses) == ["block"] and viewer.files.dialog.is_open
    hand.press(K.enter)
    hand.wait(lambda: not viewer.files.dialog.is_open)


def close_by_button(hand) -> None:
    import glfw

    hand._jobs.append(lambda: glfw.set_window_should_close(glfw.get_current_context(), True))
    hand.ctx.yield_(3)


def test_return_saves_before_the_window_closes(play, folder):
    K = keys()

    def script(hand, viewer):
        hand.wait_for_light()
        hand.press(int(K.mod_ctrl) | int(K.s))
        enter(hand, "Save the scene", folder / "mine")
        viewer.session.want(replace(viewer.session.settings, exposure=1.25))
        hand.wait_for_light()
        close_by_button(hand)
        assert viewer.files.question.is_open and not viewer.params.app_shall_exit
        hand.press(K.enter)

    viewer = play(script, quits=True)
    assert errors(viewer) == [] and viewer.params.app_shall_exit
    assert saved_scene.read(str(folder / "mine.toml")).exposure == 1.25


def test_changes_are_saved_and_asked_about_before_the_window_closes(play, folder, monkeypatch):
    K, seen, titles = keys(), {}, []
    monkeypatch.setattr("glfw.set_window_title", lambda window, title: titles.append(title))

    def script(hand, viewer):
        hand.wait_for_light()
        session = viewer.session
        assert not viewer.files.has_changed(session)
        hand.press(K._2)
        assert not viewer.files.has_changed(session), "another look at the scene is no change"
        hand.press(K._1)
        session.move({"block": AWAY})
        hand.wait_for_light()
        hand.press(int(K.mod_ctrl) | int(K.q))
        assert viewer.files.question.is_open and not viewer.params.app_shall_exit
        hand.press(K.escape)
        assert not viewer.files.question.is_open and not viewer.params.app_shall_exit

        # The first save asks for a name, the next one does not.
        hand.press(int(K.mod_ctrl) | int(K.s))
        enter(hand, "Save the scene", folder / "mine")
        assert not viewer.files.has_changed(session) and session.settings.document == str(folder / "mine.toml")
        assert titles == ["mine - gi-viewer"]
        session.want(replace(session.settings, exposure=1.25))
        hand.wait_for_light()
        assert viewer.files.has_changed(session)
        hand.press(int(K.mod_ctrl) | int(K.s))
        saved = saved_scene.read(str(folder / "mine.toml"))
        seen["saved"], seen["now"] = saved, viewer.files.settings_now(session, viewer.viewport)
        assert not viewer.files.has_changed(session)

        # The close button asks too.
        session.move({"block": Pose((0.3, 0.4, 0.6))})
        hand.wait_for_light()
        close_by_button(hand)
        assert viewer.files.question.is_open and not viewer.params.app_shall_exit
        hand.ctx.set_ref(f"//{dialogs.UNSAVED}")
        hand.ctx.item_click("Quit without saving")

    viewer = play(script, quits=True)
    assert errors(viewer) == [] and viewer.params.app_shall_exit
    for field in (*saved_scene.SAVED, "poses", "camera"):
        assert getattr(seen["saved"], field) == getattr(seen["now"], field), field
    assert dict(seen["saved"].poses) == {"block": (*AWAY.position, *AWAY.quaternion)}
    assert seen["saved"].exposure == 1.25 and viewer.files.recent == [str(folder / "mine.toml")]


def test_a_saved_scene_opens_in_the_window_as_it_was(play, folder, monkeypatch):
    K, titles = keys(), []
    monkeypatch.setattr("glfw.set_window_title", lambda window, title: titles.append(title))
    here = replace(support.SETTINGS, tone_map="clip", exposure=-0.5, poses=(("block", (*AWAY.position, 1, 0, 0, 0)),))
    here = replace(here, camera=Camera((0.5, 0.6, 2.5), (0.5, 0.45, 0.5), 40.0))
    saved_scene.write(folder / "mine.toml", here)
    loader = Loader()

    def script(hand, viewer):
        hand.wait_for_light()
        first = viewer.session
        first.want(replace(first.settings, show="irradiance", white_balance=False))
        hand.press(int(K.mod_ctrl) | int(K.o))
        enter(hand, "Open a scene", folder / "mine.toml")
        assert viewer.files.question.is_open and viewer.reload.coming is None
        hand.ctx.set_ref(f"//{dialogs.UNSAVED}")
        hand.ctx.item_click("Open without saving")
        hand.wait(lambda: viewer.session is not first)
        hand.wait_for_light()
        s = viewer.session.settings
        assert (s.tone_map, s.exposure, s.show, s.white_balance) == ("clip", -0.5, "radiance", True)
        assert (
            s.document == str(folder / "mine.toml")
            and Path(s.scene).name == "room"
            and loader.asked[-1].poses == here.poses
        )
        assert loader.asked[-1].camera == here.camera
        assert viewer.files.recent == [s.document] and not viewer.files.has_changed(viewer.session)
        assert f"opened: {s.document}" in [entry.text for entry in viewer.log.entries], "not the scene that it names"
        assert titles == ["mine - gi-viewer"]

        # A bad file: one sentence, and everything stays.
        Path("bad.toml").write_text('scene = "room"\n[settings]\nphotons = -3\n')
        now = viewer.session
        hand.press(int(K.mod_ctrl) | int(K.o))
        enter(hand, "Open a scene", "bad.toml")
        assert viewer.session is now and viewer.reload.coming is None
        assert viewer.reload.problem == "bad.toml: [settings]: photons must be a whole number in 1 .. 134217728, got -3"
        hand.press(int(K.mod_ctrl) | int(K.mod_shift) | int(K.s))
        enter(hand, "Save the scene", "not/there/a.toml", stays=True)
        assert viewer.files.dialog._problem == viewer.log.last.text, "with the reason, until the path is another"
        assert viewer.log.last.text == (
            "not saved: not/there/a.toml cannot be written (No such file or directory); name a file in another folder"
        )
        hand.press(K.escape)
        assert not viewer.files.dialog.is_open
        assert viewer.session.settings.document == str(folder / "mine.toml")

        # The menu: shipped and recent scenes.
        opened = []
        viewer.menus._open = opened.append
        hand.ctx.set_ref("##MainMenuBar")
        hand.ctx.menu_click("File/Shipped scenes/tree")
        hand.ctx.menu_click("File/Open recent/mine.toml##0")
        assert opened == ["tree", str(folder / "mine.toml")]

    viewer = play(script, open_with=loader)
    assert [e for e in errors(viewer) if "photons must be a whole number" not in e] == []


def test_a_room_with_a_luminaire_from_another_folder_is_saved_and_opened_again(play, folder, monkeypatch):
    """The dialog proposed the root of the disk, and refused all but folders above both files."""
    K = keys()
    for name in ("rooms", "downloads", "out"):
        (folder / name).mkdir()
    write_textured_room(folder / "rooms")
    write_ies(folder / "downloads/spot.ies", (0.0, 45.0, 90.0), (0.0,), np.array([[100.0, 60.0, 0.0]]))

    def script(hand, viewer):
        hand.wait_for_light()
        first = viewer.session
        use_file(viewer, None, str(folder / "downloads/spot.ies"))
        hand.press(int(K.mod_ctrl) | int(K.s))  # while the edit is being opened
        hand.wait(lambda: viewer.files.dialog.is_open)
        hand.ctx.yield_(3)
        assert viewer.files.dialog._path == str(folder / "rooms/room-saved.toml")
        (folder / "out/taken.toml").mkdir()
        enter(hand, "Save the scene", folder / "out/taken.toml", stays=True)
        assert viewer.files.dialog._path.endswith("/out/taken.toml/"), "a folder is listed"
        hand.ctx.item_input_value("##path", str(folder / "out/kit.toml"))
        hand.wait(lambda: not viewer.files.dialog.is_open)
        said = [entry.text for entry in viewer.log.entries if entry.text.startswith("saved ")][-1]
        assert said.endswith("with copies beside it: room.obj, room.mtl, wood.png, spot.ies")
        hand.wait(lambda: viewer.session is not first)
        assert not viewer.files.has_changed(viewer.session) and viewer.session.settings.document
        lights, second = list(viewer.session.lights), viewer.session
        assert {Path(f).name for names in second.scene.files for f in names} >= {"room.obj", "wood.png", "spot.ies"}

        # A save that fails later asks for another place.
        (folder / "out/kit.toml").unlink()
        (folder / "out/kit.toml").mkdir()
        hand.press(int(K.mod_ctrl) | int(K.s))
        enter(hand, "Save the scene", folder / "out/kit2.toml")

        for name in ("rooms", "downloads"):
            shutil.rmtree(folder / name)
        hand.press(int(K.mod_ctrl) | int(K.o))
        enter(hand, "Open a scene", folder / "out/kit2.toml")
        hand.wait(lambda: viewer.session is not second)
        hand.wait_for_light()
        assert list(viewer.session.lights) == lights and viewer.reload.problem == ""

    settings = replace(support.SETTINGS, scene=str(folder / "rooms/room.obj"))
    assert errors(play(script, settings, Opening)) == []


def test_the_place_proposed_is_a_folder_that_can_be_written_and_no_root(tmp_path, monkeypatch):
    files, session = Files(), SimpleNamespace(settings=Settings(scene="cornell"))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir("/")
    assert files.suggestion(session) == str(tmp_path / "cornell-saved.toml")
    monkeypatch.chdir(tmp_path)
    assert files.suggestion(session) == str(tmp_path / "cornell-saved.toml")
    (tmp_path / "read only").mkdir()
    (tmp_path / "read only/room.glb").write_bytes(b"")
    session.settings = Settings(scene=str(tmp_path / "read only/room.glb"))
    assert files.suggestion(session) == str(tmp_path / "read only/room-saved.toml")
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path / "read only")
    assert files.suggestion(session) == str(tmp_path / "room-saved.toml")


def test_the_copied_command_and_reset_settings(play, monkeypatch):
    copied = []
    monkeypatch.setattr(imgui, "set_clipboard_text", copied.append)

    def script(hand, viewer):
        hand.wait_for_light()
        session = viewer.session
        start = session.settings
        session.want(replace(start, photons=30_000, tone_map="clip", white_balance=False, budget=33.0, radius=0.05))
        session.move({"block": AWAY})
        hand.wait_for_light()
        hand.press(int(keys().mod_ctrl) | int(keys().c))
        words = shlex.split(copied[-1])
        assert words[:2] == ["gi-viewer", "room"]
        now = viewer.files.settings_now(session, viewer.viewport)
        assert settings_of(cli.parse(words[1:])) == replace(now, measure_errors=True)
        viewer._do("reset settings")
        hand.wait_for_light()
        s = session.settings
        assert (s.tone_map, s.white_balance, s.budget) == (Settings().tone_map, True, Settings().budget)
        assert session.poses == {"block": AWAY} and s.scene == "room"
        assert (s.photons, s.radius, s.exposure) == (start.photons, start.radius, pytest.approx(session.start_exposure))

    settings = replace(support.SETTINGS, photons=None, radius=None, neighbours=None, light=None)
    scene = support.room()
    scene = replace(scene, defaults=scene.defaults._replace(photons=20_000, radius=0.06, neighbours=40))
    assert errors(play(script, settings, support.opening(scene))) == []


def test_changed_files_are_read_again(play, folder, monkeypatch):
    monkeypatch.setattr("app.window.files.PERIOD", 0.0)
    file, loader = folder / "room.glb", Loader()
    file.write_bytes(b"one")

    def script(hand, viewer):
        hand.wait_for_light()
        first = viewer.session
        hand.ctx.yield_(5)
        assert len(loader.asked) == 1
        file.write_bytes(b"another")
        hand.wait(lambda: viewer.session is not first)
        hand.wait_for_light()
        assert len(loader.asked) == 2 and viewer.log.last.text == f"reloaded: {file}"
        viewer.files.watches = False
        file.write_bytes(b"a third time")
        hand.ctx.yield_(10)
        assert len(loader.asked) == 2

    assert errors(play(script, replace(support.SETTINGS, scene=str(file)), loader)) == []


def test_a_file_counts_as_changed_once_it_rests(tmp_path):
    a, seen = tmp_path / "a.glb", Watch()
    a.write_bytes(b"1")
    seen.follow([str(a)])
    assert not seen.changed(10.0)
    a.write_bytes(b"22")
    assert not seen.changed(10.5), "not yet time for another look"
    assert not seen.changed(11.0), "it may still be written"
    assert seen.changed(12.0) and not seen.changed(13.0)
    a.unlink()
    assert not any(seen.changed(float(t)) for t in range(14, 18)), "gone: nothing to read"
    a.write_bytes(b"333")
    assert [seen.changed(float(t)) for t in range(18, 21)] == [False, True, False]


def test_all_files_of_a_scene_are_watched(tmp_path):
    """Also where a luminaire lies outside its folder, and textures; files that are gone are not."""
    (tmp_path / "room").mkdir()
    write_textured_room(tmp_path / "room")
    for name in ("room/m.glb", "x.glb"):
        write_glb(tmp_path / name, BOX * 0.1, BOX_FACES)
    write_ies(tmp_path / "spot.ies", (0.0, 45.0, 90.0), (0.0,), np.array([[100.0, 60.0, 0.0]]))
    light = (
        '{ type = "photometric", name = "spot", position = [0, 1, 0], direction = [0, -1, 0], file = "../spot.ies" }'
    )
    mobile = '{ name = "m", mesh = "m.glb" }'
    (tmp_path / "room/a.toml").write_text(
        f'units = "photometric"\nstatic = {{ mesh = "room.obj" }}\nmobile = [{mobile}]\nlight = [{light}]\n'
    )
    settings = Settings(scene=str(tmp_path / "room/a.toml"), mobiles=(str(tmp_path / "x.glb"),), allow_outside=True)
    files = [name for names in open_scene(settings).files for name in names]
    names = ["a.toml", "m.glb", "room.mtl", "room.obj", "spot.ies", "wood.png", "x.glb"]
    assert sorted(map(os.path.basename, files)) == names
    for name in names:
        seen = Watch()
        seen.follow([*files, str(tmp_path / "gone")])
        (file,) = tmp_path.rglob(name)
        os.utime(file, (1.0, 1.0))
        assert [seen.changed(10.0), seen.changed(20.0)] == [False, True], name


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a shell script stands for the system's dialog")
def test_the_systems_dialog_is_used_where_there_is_one(tmp_path):
    """In a process of its own: the library looks for the system's dialogs once."""
    program = tmp_path / "zenity"
    program.write_text(f'#!/bin/sh\necho "$@" >> {tmp_path}/arguments\necho {tmp_path}/chosen.glb\n')
    program.chmod(0o700)
    code = """
import time
from app.window import dialogs
assert dialogs.has_native()
dialog = dialogs.FileDialog()
for ask in (dialog.open, dialog.save):
    ask("Title", ".", dialogs.SCENES, print)
    while dialog.is_open:
        time.sleep(0.01)
        dialog.poll()
"""
    path = f"{tmp_path}:{os.environ['PATH']}"
    command, given = [sys.executable, "-c", code], {"PATH": path, "PYTHONPATH": str(support.ROOT)}
    ran = subprocess.run(command, env={**os.environ, **given}, text=True, capture_output=True, timeout=support.PATIENCE)
    assert ran.stdout == f"{tmp_path}/chosen.glb\n" * 2, ran.stderr
    assert (tmp_path / "arguments").read_text().count("Title") == 2
