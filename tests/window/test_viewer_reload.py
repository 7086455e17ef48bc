"""Reloads and dropped scenes: settings that stay, settings that go, and the state after a failure."""

import ctypes
import gc
import os
import threading
import weakref
from dataclasses import replace

import numpy as np
import pytest

from app.draw import renderer
from app.session.opening import Opening
from app.window import window
from gi_core.scene import Camera, Pose, SceneError
from tests.support import viewer_support as support
from tests.support.viewer_hand import errors, keys

AWAY = Pose((0.7, 0.4, 0.6))
LOADS = 8


class Files:
    """A scene file for the loader; its contents may change between two readings."""

    def __init__(self, **defaults) -> None:
        self.scene, self.problem, self.read, self.gate = support.room(), None, [], threading.Event()
        self.scene = replace(self.scene, defaults=self.scene.defaults._replace(**defaults))
        self.gate.set()

    def load(self, settings):
        self.read.append(settings)
        self.gate.wait(support.PATIENCE)
        if self.problem is not None:
            raise self.problem
        return self.scene

    def open(self, settings):
        return Opening(settings, load=self.load)


def again(hand, viewer) -> None:
    """Reload and wait for success or failure."""
    before = viewer.session
    hand.press(keys().f5)
    hand.wait(lambda: viewer.reload.coming is None)
    hand.wait_for_light()
    assert (viewer.session is not before) != bool(viewer.reload.problem)


@pytest.fixture
def drop():
    """Return a function that drops files on the window: it calls the function as GLFW does."""

    def drop(hand, *files: str) -> None:
        window._dropped[0](None, len(files), (ctypes.c_char_p * len(files))(*map(os.fsencode, files)))
        hand.ctx.yield_(3)

    return drop


def test_reload_keeps_the_users_settings_and_poses(play):
    files = Files()

    def script(hand, viewer):
        hand.wait_for_light()
        first = viewer.session
        first.want(replace(first.settings, photons=30_000, tone_map="clip", exposure=1.25))
        first.move({"block": AWAY})
        hand.wait_for_light()
        viewer.viewport.view.camera = viewer.viewport.view.camera.dolly(2.0)
        camera, light = viewer.viewport.view.camera, first.irradiance
        again(hand, viewer)
        session = viewer.session
        assert session.poses == {"block": AWAY} == session.light._solver.poses
        assert (session.settings.photons, session.settings.tone_map, session.settings.exposure) == (
            30_000,
            "clip",
            1.25,
        )
        assert session.light._solver.photons == 30_000 and viewer.viewport.view.camera == camera
        assert np.array_equal(session.irradiance, light), "the same files: the same bits"

        # The files change: brighter walls, a second block, another camera.
        old = files.scene
        other = old.mobiles[0]._replace(name="second", pose=Pose((0.3, 0.2, 0.3)))
        white = old.materials[0]._replace(reflectance=(0.9, 0.9, 0.9))
        files.scene = replace(
            old,
            materials=(white, *old.materials[1:]),
            mobiles=(*old.mobiles, other),
            camera=Camera((0.5, 0.5, 3.5), (0.5, 0.5, 0.5)),
        )
        again(hand, viewer)
        session = viewer.session
        assert session.poses == {"block": AWAY, "second": other.pose} and len(viewer.painter.renderer._objects) == 3
        assert session.irradiance[: len(light)].mean() > light.mean()
        assert viewer.viewport.view.camera == camera, "where the user looks"
        hand.press(keys().home)
        hand.wait(lambda: viewer.viewport.view.camera == viewer.viewport.control.home)
        assert viewer.viewport.control.home.eye()[2] == pytest.approx(3.5)

        # The moved mobile is missing: the other keeps its pose.
        files.scene = replace(files.scene, mobiles=(other,))
        again(hand, viewer)
        assert viewer.session.poses == {"second": other.pose}
        assert hand.light_is_that_from_scratch()
        hand.press(keys().r)
        assert viewer.log.last.text == "reloaded: room"

    assert errors(play(script, open_with=files.open)) == []


def test_reload_updates_values_not_set_by_the_user(play):
    """A radius from the file may have changed in the file; one set by the user stays."""
    files = Files(radius=0.05, photons=9_000)

    def script(hand, viewer):
        hand.wait_for_light()
        assert (viewer.session.settings.radius, viewer.session.settings.photons) == (0.05, 9_000)
        viewer.session.want(replace(viewer.session.settings, photons=12_000))
        hand.wait_for_light()
        files.scene = replace(files.scene, defaults=files.scene.defaults._replace(radius=0.07, photons=8_000))
        again(hand, viewer)
        assert (viewer.session.settings.radius, viewer.session.settings.photons) == (0.07, 12_000)

    settings = replace(support.SETTINGS, photons=None, radius=None, neighbours=None)
    assert errors(play(script, settings, open_with=files.open)) == []


def test_failed_load_keeps_the_old_scene_and_reports_why(play):
    files = Files()
    why = "room.toml: flux must be three numbers >= 0, got [-1, 0, 2]"

    def script(hand, viewer):
        hand.wait_for_light()
        session, picture = viewer.session, hand.pixels()
        hand.press(keys()._2)
        hand.wait_for_light()
        light = session.irradiance
        files.problem = SceneError(why)
        for _ in range(3):
            again(hand, viewer)
            assert viewer.session is session and viewer.reload.problem == why
            assert errors(viewer)[-1] == f"opening: {why}" and not viewer.params.app_shall_exit
        assert np.array_equal(session.irradiance, light)

        # Everything continues: a drag, a setting and, after a repair, another load.
        start = session.poses["block"]
        hand.drag(hand.at((0.5, 0.3, 0.62)), [c + 40 for c in hand.at((0.5, 0.3, 0.62))])
        assert session.poses["block"] != start
        hand.press(keys()._1)
        hand.wait_for_light()
        assert hand.light_is_that_from_scratch()
        assert not np.array_equal(hand.pixels(), picture)
        files.problem = None
        hand.ctx.item_click("//Panel/Reload")
        hand.wait(lambda: viewer.session is not session)
        assert viewer.reload.problem == ""

    play(script, open_with=files.open)


def test_failed_upload_keeps_the_old_scene(play, monkeypatch):
    files = Files()

    def script(hand, viewer):
        hand.wait_for_light()
        hand.wait(lambda: viewer.painter.is_done)  # drawn with all samples
        session, objects, picture = viewer.session, viewer.painter.renderer._objects, hand.pixels()
        made = renderer.DrawnObject

        def full(*arguments):
            if len(released) == 1:
                raise MemoryError("the card is full")
            released.append(made(*arguments))
            return released[-1]

        released = []
        monkeypatch.setattr(renderer, "DrawnObject", full)
        hand.press(keys().f5)
        hand.wait(lambda: viewer.reload.problem)
        assert viewer.reload.problem == "the card is full" and viewer.reload.coming is None
        assert viewer.session is session and viewer.painter.renderer._objects is objects
        monkeypatch.setattr(renderer, "DrawnObject", made)
        viewer.viewport.redraw()
        hand.wait(lambda: viewer.painter.is_done)
        assert np.array_equal(hand.pixels(), picture)

    assert errors(play(script, open_with=files.open)) == [
        "opening: memory is full (the card is full): take fewer photons, or simplify the scene"
    ]


def test_old_scene_stays_usable_while_the_new_one_loads(play):
    """Frames, drags and settings continue; changes made meanwhile stay; the new scene waits for a drag to end."""
    files = Files()

    def script(hand, viewer):
        hand.wait_for_light()
        session = viewer.session
        files.gate.clear()
        hand.press(keys().f5)
        frames = viewer.clock.frames
        front = hand.at((0.5, 0.3, 0.62))
        hand.move(front)
        hand.ctx.mouse_down(0)
        for k in range(1, 6):
            hand.move((front[0] + 8 * k, front[1]))
        assert viewer.clock.frames > frames + 5 and viewer.session is session and session.motion.dragging
        assert viewer.reload.progress[0] == "loading scene: room"
        session.want(replace(session.settings, tone_map="reinhard"))
        files.gate.set()
        hand.wait(lambda: viewer.reload.progress and viewer.reload.progress[0] == "computing light")
        hand.ctx.yield_(10)
        assert viewer.session is session, "never under a hand"
        there = session.poses["block"]
        hand.ctx.mouse_up(0)
        hand.wait(lambda: viewer.session is not session)
        assert viewer.session.poses["block"] == there and viewer.session.settings.tone_map == "reinhard"
        hand.wait_for_light()

    assert errors(play(script, open_with=files.open)) == []


def test_many_loads_leave_nothing_of_the_old_scenes(play):
    """Solvers and drawn objects are freed without the cycle collector, and threads end."""
    files = Files()

    def script(hand, viewer):
        hand.wait_for_light()
        gone, threads = [], threading.active_count()
        gc.collect()
        gc.disable()
        try:
            for _ in range(LOADS):
                gone.append(weakref.ref(viewer.session.light._solver))
                gone += map(weakref.ref, viewer.painter.renderer._objects)  # moderngl frees what has no references
                again(hand, viewer)
            hand.wait(lambda: not any(ref() is not None for ref in gone))
        finally:
            gc.enable()
        hand.wait_for_light()
        hand.wait(lambda: not viewer.painter.renderer.ctx.objects)  # nothing waits to be freed
        assert threading.active_count() <= threads + 1
        assert len(files.read) == LOADS + 1

    assert errors(play(script, open_with=files.open)) == []


def test_a_file_dropped_on_the_window_is_opened(play, drop):
    files = Files(photons=20_000)

    def script(hand, viewer):
        hand.wait_for_light()
        session = viewer.session
        session.want(replace(session.settings, tone_map="clip", exposure=3.0, radius=0.2))
        hand.wait_for_light()
        viewer.viewport.view.camera = viewer.viewport.view.camera.dolly(2.0)
        drop(hand, "/somewhere/hall.glb", "/somewhere/chair.obj")
        assert viewer.files.question.is_open and viewer.reload.coming is None, "the settings have changed"
        hand.ctx.set_ref("//Unsaved changes")
        hand.ctx.item_click("Open without saving")
        hand.wait(lambda: viewer.session is not session)
        hand.wait_for_light()
        asked, now = files.read[-1], viewer.session.settings
        assert (asked.scene, asked.mobiles) == ("/somewhere/hall.glb", ("/somewhere/chair.obj",))
        assert asked.radius is None and asked.photons is None and asked.exposure is None and asked.poses == ()
        assert now.tone_map == "clip" and now.exposure != 3.0
        assert viewer.viewport.view.camera == viewer.viewport.control.home
        drop(hand, "/somewhere/chair.obj", "/somewhere/room.toml")
        hand.wait(lambda: files.read[-1].scene == "/somewhere/room.toml")
        assert files.read[-1].mobiles == ("/somewhere/chair.obj",)
        hand.wait(lambda: viewer.reload.coming is None)
        assert viewer.log.last.text == "opened: /somewhere/room.toml"

    assert errors(play(script, open_with=files.open)) == []


def test_a_file_dropped_after_a_failed_start_is_opened(play, drop):
    files = Files(photons=20_000)
    files.problem = ZeroDivisionError("division by zero")

    def script(hand, viewer):
        hand.wait(lambda: viewer.session.problem is not None)
        files.problem = None
        drop(hand, "room.toml")
        hand.wait_for_light()
        assert viewer.session.settings.scene == "room.toml"

    assert errors(play(script, open_with=files.open)) == ["opening: division by zero"]
