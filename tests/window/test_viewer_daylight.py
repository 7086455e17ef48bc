"""The panel's daylight: date and hour change sun and sky, undone and saved as other edits."""

import dataclasses
import math

import numpy as np
import pytest

from app.cli import saved_scene
from app.session.cities import cities
from app.session.lights import DAYLIGHT, NEW_DAYLIGHT, north_angle
from app.settings import LampLevel
from app.window import readout_marks
from gi_core.files.edits import Darken
from gi_core.files.edits import Daylight as ChangeDaylight
from gi_core.lights.daylight import daylit, sun_of
from gi_core.scene.types import Daylight, DirectionalLight, PointLight
from tests.support import viewer_support as support
from tests.support.lit_from_outside import sky_room
from tests.support.viewer_hand import in_window, keys
from tests.window.test_viewer_edits import built, change

MADRID = Daylight((40.4, -3.7), "2026-06-21", 14.0, 2.0)


def sunny_room():
    """The room without its lamp and with a sun high in the sky."""
    return daylit(support.room(), MADRID, "room")


def is_that_of_a_new_solver(session) -> bool:
    return np.array_equal(session.irradiance, built(session, sunny_room))


@in_window(scene=sunny_room)
def test_date_and_hour_move_the_sun(hand, viewer, folder):
    ctx = hand.ctx
    hand.panel("Objects", "Scene", "Lamps")
    before = viewer.session.irradiance
    change(hand, viewer, lambda: ctx.item_input_value("**/##Hour", 10.5))
    assert viewer.session.settings.edits == (ChangeDaylight((("hour", 10.5),)),)
    assert viewer.session.scene.daylight == viewer.session.daylight == MADRID._replace(hour=10.5)
    assert viewer.log.last.text == "edited: daylight"
    assert not np.array_equal(viewer.session.irradiance, before) and np.array_equal(
        viewer.session.irradiance, built(viewer.session, sunny_room)
    )
    change(hand, viewer, lambda: ctx.item_input_value("**/##Date", "2026-03-21"))
    change(hand, viewer, lambda: ctx.item_input_value("**/##Place latitude", 52.0))
    wanted = MADRID._replace(hour=10.5, date="2026-03-21", place=(52.0, -3.7))
    assert viewer.session.scene.daylight == wanted and sun_of(wanted).altitude == pytest.approx(24.2, abs=8)

    path = folder / "saved.toml"
    saved_scene.write(path, viewer.session.settings)
    assert saved_scene.read(str(path)).edits == viewer.session.settings.edits

    for _ in range(3):
        change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.scene.daylight == MADRID and np.array_equal(viewer.session.irradiance, before)


@in_window(scene=sunny_room)
def test_night_comes_and_goes_though_the_sun_is_dimmed(hand, viewer):
    """A lamp without light has no row: its level must not be refused."""
    viewer.session.want(dataclasses.replace(viewer.session.settings, lamps=(LampLevel("sun", 0.5),)))
    hand.wait_for_light()
    dimmed = viewer.session.irradiance
    hand.ctx.set_ref("Panel")
    change(hand, viewer, lambda: hand.ctx.item_input_value("**/##Hour", 1.0))
    assert "sun" not in viewer.session.model.emitters.lamps.names and np.array_equal(
        viewer.session.irradiance, built(viewer.session, sunny_room)
    )
    assert "below the horizon" in viewer.session.scene.notes[-1]
    change(hand, viewer, lambda: viewer._do("undo"))
    assert np.array_equal(viewer.session.irradiance, dimmed)


def room_with_a_sun():
    """The room, whose file has a sun of its own."""
    return dataclasses.replace(support.room(), lights=(DirectionalLight("sun", (0.2, -1.0, 0.1), (3.0,) * 3),))


@in_window(scene=room_with_a_sun)
def test_an_architect_asks_for_the_sun_at_9_in_madrid(hand, viewer, folder):
    ctx = hand.ctx
    hand.panel("Objects", "Scene")
    before = viewer.session.irradiance
    change(hand, viewer, lambda: viewer._do(("add lamp", DAYLIGHT)))
    assert viewer.session.scene.daylight == NEW_DAYLIGHT and "added: daylight" in viewer.log.last.text
    assert [light.name for light in viewer.session.scene.lights] == ["sun", "sky"], "its sun replaces the file's"
    added = viewer.session.settings.edits

    ctx.item_close("**/Lamps")
    ctx.yield_(2)
    ctx.item_click("##City")
    ctx.yield_(2)
    ctx.key_chars("madr")

    def enter():
        ctx.key_press(keys().enter)

    change(hand, viewer, enter)
    change(hand, viewer, lambda: ctx.item_input_value("**/##Hour", 9.0))
    day = viewer.session.scene.daylight
    assert day == NEW_DAYLIGHT._replace(place=cities()["Europe/Madrid"], utc_offset=1.0, hour=9.0)
    published = [18.6519, 106.2381]  # at 40.4, -3.7, see tests/cli/test_daylight.py
    assert [sun_of(day).altitude, sun_of(day).azimuth] == pytest.approx(published, abs=0.03)
    change(hand, viewer, lambda: ctx.item_input_value("**/##Date", "2026-06-21"))
    assert viewer.session.scene.daylight.utc_offset == 2.0, "the clock of Madrid has summer time"
    day = viewer.session.scene.daylight
    right, _, forward = viewer.viewport.view.camera.basis()
    shapes, to_sun = readout_marks.marks(viewer.viewport), -np.array(viewer.session.scene.lights[0].direction)
    across, down = np.subtract(shapes.dots[0].at, np.mean([a for a, _ in shapes.lines[:32]], axis=0)) / shapes.em
    ahead = to_sun @ (forward - (0, forward[1], 0)) / np.hypot(forward[0], forward[2])
    assert math.atan2(across, -down) == pytest.approx(math.atan2(to_sun @ right, ahead), abs=1e-6)
    radius = readout_marks.COMPASS_EM * (1 - sun_of(day).altitude / 90)
    assert math.hypot(across, down) == pytest.approx(radius) and "N" in [label.text for label in shapes.labels]
    change(hand, viewer, lambda: ctx.item_input_value("**/##Clock", 5.5))
    change(hand, viewer, lambda: ctx.item_input_value("**/##North angle", 30.0))
    day = viewer.session.scene.daylight
    assert day.utc_offset == 5.5 and north_angle(day, (0, 1, 0)) == pytest.approx(30.0)
    assert viewer.session.scene.lights == daylit(support.room(), day, "room").lights

    path = folder / "saved.toml"
    saved_scene.write(path, viewer.session.settings)
    assert saved_scene.read(str(path)).edits == viewer.session.settings.edits
    for _ in range(5):
        change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.settings.edits == added
    change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.scene.daylight is None and np.array_equal(viewer.session.irradiance, before)


@in_window(scene=sunny_room)
def test_daylight_that_is_removed_can_be_added_again(hand, viewer):
    change(hand, viewer, lambda: viewer._do(("add lamp", "bulb")))
    change(hand, viewer, lambda: viewer.session.change_scene(Darken("sun")))
    assert viewer.session.scene.daylight == MADRID, "its sky stays"
    change(hand, viewer, lambda: viewer.session.change_scene(Darken("sky")))
    assert viewer.session.scene.daylight is None
    change(hand, viewer, lambda: viewer._do(("add lamp", DAYLIGHT)))
    assert viewer.session.scene.daylight == NEW_DAYLIGHT


def dim_room():
    """A room with a window, and a bulb of little light."""
    return dataclasses.replace(sky_room(0.5), lights=(PointLight("bulb", (2.0, 2.0, 2.0), (1.0, 1.0, 1.0)),))


@in_window(scene=dim_room)
def test_the_exposure_is_metered_for_new_lamps_of_much_more_light(hand, viewer):
    """Sun and sky turned a room white until a key was pressed."""
    before = viewer.session.settings.exposure
    change(hand, viewer, lambda: viewer._do(("add lamp", DAYLIGHT)))
    hand.ctx.yield_(2)
    exposure = viewer.session.settings.exposure
    assert {"added: daylight", f"metered: {exposure:+.1f} EV"} <= {e.text for e in viewer.log.entries}
    assert exposure < before - 1
    change(hand, viewer, lambda: viewer.session.change_scene(Darken("sun"), Darken("sky")))
    hand.ctx.yield_(2)
    assert viewer.log.entries[-1].text.endswith("the exposure stays as it was: key A meters it")
    assert viewer.session.settings.exposure == exposure
