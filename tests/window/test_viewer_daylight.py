"""The panel's daylight: date and hour change sun and sky, undone and saved as other edits."""

import dataclasses

import numpy as np
import pytest

from app.cli import saved_scene
from app.settings import LampLevel
from gi_core.files.edits import Daylight as ChangeDaylight
from gi_core.files.edits import edited
from gi_core.lights.daylight import daylit, sun_of
from gi_core.scene.types import Daylight
from gi_core.solver import Solver
from tests.support import viewer_support as support
from tests.support.viewer_hand import in_window
from tests.window.test_viewer_edits import change

MADRID = Daylight((40.4, -3.7), "2026-06-21", 14.0, 2.0)


def sunny_room():
    """The room without its lamp and with a sun high in the sky."""
    return daylit(support.room(), MADRID, "room")


def is_that_of_a_new_solver(session) -> bool:
    s = session.settings
    given = {"photons": s.photons, "radius": s.radius, "neighbours": s.neighbours, "light": "photons"}
    solver = Solver(edited(sunny_room(), s.edits), lamps=s.levels(()), **given)
    solver.move_all(session.poses)
    solver.solve()
    return np.array_equal(solver.irradiance, session.irradiance)


@in_window(scene=sunny_room)
def test_date_and_hour_move_the_sun(hand, viewer, folder):
    ctx = hand.ctx
    ctx.set_ref("Panel")
    for section in ("Objects", "Scene", "Lamps"):
        ctx.item_close(f"**/{section}")
    before = viewer.session.irradiance
    change(hand, viewer, lambda: ctx.item_input_value("**/##Hour", 10.5))
    assert viewer.session.settings.edits == (ChangeDaylight((("hour", 10.5),)),)
    assert viewer.session.scene.daylight == viewer.session.daylight == MADRID._replace(hour=10.5)
    assert viewer.log.last.text == "edited: daylight"
    assert not np.array_equal(viewer.session.irradiance, before) and is_that_of_a_new_solver(viewer.session)
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
    assert "sun" not in viewer.session.model.emitters.lamps.names and is_that_of_a_new_solver(viewer.session)
    assert "below the horizon" in viewer.session.scene.notes[-1]
    change(hand, viewer, lambda: viewer._do("undo"))
    assert np.array_equal(viewer.session.irradiance, dimmed)
