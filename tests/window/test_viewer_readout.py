"""The light under the cursor, in the window."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app.cli import saved_scene
from app.draw.colour_map import sequential_colours
from app.draw.picking import Picker
from app.rest.jobs import SurfacesJob
from app.session.log import Log
from app.session.reload import settings_for
from app.values import LampLevel
from app.window import legend as module
from app.window import overlay, readout_marks, spot_card, view_content
from gi_core.gather.origins import BOUNCES
from gi_core.scene import CalculationSurface, Camera, Material, Mobile, PointLight, Pose, Scene
from tests.support import closed_form
from tests.support import viewer_support as support
from tests.support.scene_builders import merge, quad
from tests.support.viewer_hand import BLOCK_FRONT, errors, in_window, keys

INTENSITY, HEIGHT = 500.0, 2.0  # [cd], [m]


def lamp_over_floor() -> Scene:
    """A floor of 4 m under a point lamp, in photometric units, and a tile on it, out of the way."""
    lamp = PointLight("lamp", (0, 0, HEIGHT), (4 * math.pi * INTENSITY,) * 3)
    tile = Mobile("tile", quad((-0.2, -0.2, 0), (0.4, 0, 0), (0, 0.4, 0), (2, 2), 1), Pose((1.4, 1.2, 0.01)))
    rim = quad((-2, 1.9, 0), (0.1, 0, 0), (0, 0, 0.1), material=1)  # a bounce, so that gathered light has some noise
    return Scene(
        merge(quad((-2, -2, 0), (4, 0, 0), (0, 4, 0), (40, 40)), rim),
        (Material("oak", (0.5,) * 3), Material("slate", (0.2,) * 3)),
        (tile,),
        (lamp,),
        camera=Camera((0.3, -2.5, 3.0), (0, 0, 0), 60.0),
        up=(0.0, 0.0, 1.0),
        units="photometric",
        name="lamp over a floor",
    )


@in_window(scene=lamp_over_floor, light="best")
def test_illuminance_under_the_cursor_is_the_closed_form(hand, viewer, monkeypatch):
    """Gathered direct light is exact at vertices. One ray per new place, none while the mouse rests."""
    written, draw, rays, pick = [], overlay.draw_status, [], Picker.pick
    monkeypatch.setattr(overlay, "draw_status", lambda *given: (written.append(given[1]), draw(*given)))
    monkeypatch.setattr(Picker, "pick", lambda *given: (rays.append(1), pick(*given))[1])
    viewport = viewer.viewport
    hand.wait(lambda: viewer.session.light.all_done)
    for x, y in ((0.0, 0.0), (0.33, -0.21), (-0.9, 0.62)):
        hand.move(hand.at((x, y, 0.0)))
        E = closed_form.point_over_plane(INTENSITY, HEIGHT, math.hypot(x, y))
        reading = viewport.pointer.reading
        assert reading.irradiance == pytest.approx(E, rel=0.02)
        assert reading.radiance == pytest.approx(0.5 * reading.irradiance / math.pi, rel=1e-5)
    written.clear()
    rays.clear()
    hand.ctx.yield_(10)
    assert not rays, "the mouse rests"
    text = viewport.pointer.reading.text()
    assert written.count(text) >= 10
    assert " lx  ·  luminance " in text and text.endswith("static part, oak")

    tile = hand.at((1.4, 1.2, 0.01))
    size = viewport.view.size
    hand.move(tile)
    assert (viewport.pointer.reading.object, viewport.pointer.reading.material) == ("tile", "slate")
    hand.ctx.mouse_down(0)
    hand.move((tile[0] - 30, tile[1]))
    assert viewport.mobile_drag.grab is not None and viewport.readout() == ""
    hand.ctx.mouse_up(0)
    hand.ctx.yield_(3)
    assert viewport.readout() and viewport.view.size == size
    hand.move((viewport.view.origin[0] + 3, viewport.view.origin[1] + 3))
    assert viewport.pointer.reading is None, "no surface"


@in_window(scene=lambda: replace(lamp_over_floor(), units="radiometric"))
def test_units_are_chosen_in_the_panel(hand, viewer, folder):
    """Read-out, lamps, saved scene and false colours follow at once; the light stays, and another scene has its own."""
    light, viewport = viewer.session.irradiance, viewer.viewport
    hand.move(hand.at((0.3, -0.2, 0.0)))
    assert " W/m²" in viewport.readout() and viewport.picture.units.per_area == "W/m²"
    hand.ctx.set_ref("Panel")
    hand.ctx.combo_click("##Units/lx, cd\\/m², lm")
    hand.move(hand.at((0.3, -0.2, 0.0)))
    assert " lx  ·  luminance" in viewport.readout()
    assert viewport.picture.units.per_area == "lx" and viewer.session.irradiance is light
    saved_scene.write(folder / "saved.toml", viewer.session.settings)
    assert saved_scene.read(str(folder / "saved.toml")).units == "photometric"
    assert "--units photometric" in saved_scene.command_line(viewer.files.settings_now(viewer.session, viewport))
    assert settings_for(viewer.session, "cornell", ()).units is None
    hand.ctx.combo_click("##Units/W\\/m², W\\/m²\\/sr, W")
    hand.ctx.yield_(2)
    assert viewer.session.scene.units == "radiometric"


@in_window(scene=lamp_over_floor, light="best")
def test_false_colours_show_the_closed_form_and_keep_their_scale_in_motion(hand, viewer):
    """A pixel has the colour of the illuminance at its place. The scale is fitted at rest, not during a drag."""
    settings = replace(support.SETTINGS, light="best")
    viewport = viewer.viewport
    hand.wait(lambda: viewer.session.light.all_done)
    assert viewport.picture.scale is None
    hand.ctx.set_ref("Panel")
    hand.ctx.combo_click("##Show/Illuminance in lx")
    hand.wait(lambda: viewport.picture.scale is not None)
    hand.ctx.yield_(25)
    scale, picture = viewport.picture.scale, hand.pixels()
    assert scale.high > 100 and viewport.picture.units.per_area == "lx"
    for x, y in ((0.0, 0.0), (0.33, -0.21), (-0.9, 0.62)):
        E = closed_form.point_over_plane(INTENSITY, HEIGHT, math.hypot(x, y))
        expected = 255 * sequential_colours(scale.position(np.array([E])))[0]
        column, row = (int(c - o) for c, o in zip(hand.at((x, y, 0.0)), viewport.view.origin, strict=True))
        assert np.abs(picture[row, column] - expected).max() <= 6, (E, picture[row, column])

    hand.press(keys().p)
    saved = np.asarray(Image.open("gi-viewer-001.png"))
    top, left = (round(0.4 * n) for n in saved.shape[:2])
    assert saved.shape == picture.shape and np.abs(saved[:top, :left].astype(int) - picture[:top, :left]).mean() < 2
    plate = (saved[top:, left:].max(axis=2) < 40).mean()
    assert plate > 0.05 and (picture[top:, left:].max(axis=2) < 40).mean() < plate / 2, "the legend is in the file"

    read, settings = viewport.read, viewer.session.settings
    viewport.read = lambda at_rest: read(False)  # the scale of another lamp does not wait for rest
    viewer.session.want(replace(settings, lamps=(LampLevel("lamp", 0.25),)))
    hand.wait(lambda: viewport.picture.scale.high < 0.5 * scale.high)
    viewer.session.want(settings)
    hand.wait(lambda: viewport.picture.scale == scale)
    viewport.read = read
    tile = hand.at((1.4, 1.2, 0.01))
    hand.move(tile)
    hand.ctx.mouse_down(0)
    viewer.viewport.scale_fit.scale = kept = scale._replace(high=4 * scale.high)
    for k in range(4):
        hand.move((tile[0] - 10 * k, tile[1]))
        assert viewport.picture.scale is kept
    hand.ctx.mouse_up(0)
    hand.wait(lambda: viewport.picture.scale == scale)

    viewer.session.want(replace(viewer.session.settings, illuminance_range=(10.0, 1000.0)))
    hand.wait(lambda: viewport.picture.scale == (10.0, 1000.0, True, (), "illuminance"))

    # Luminance of the diffuse floor, without a lamp in view: rho E / pi.
    hand.ctx.combo_click("##Show/Luminance in cd\\/m²")
    hand.wait(lambda: viewport.picture.scale is not None and viewport.picture.scale.quantity == "luminance")
    hand.ctx.yield_(25)
    scale, picture = viewport.picture.scale, hand.pixels()
    assert viewport.legend.lines[0] == "Luminance [cd/m²]"
    for x, y in ((0.33, -0.21), (-0.9, 0.62)):
        L = 0.5 * closed_form.point_over_plane(INTENSITY, HEIGHT, math.hypot(x, y)) / math.pi
        expected = 255 * sequential_colours(scale.position(np.array([L])))[0]
        column, row = (int(c - o) for c, o in zip(hand.at((x, y, 0.0)), viewport.view.origin, strict=True))
        assert np.abs(picture[row, column] - expected).max() <= 6, (L, picture[row, column])
    hand.ctx.combo_click("##Show/Illuminance in lx")
    hand.wait(lambda: viewport.picture.scale == (10.0, 1000.0, True, (), "illuminance"))

    # Lines of equal light are circles about the lamp's foot, on known radii.
    hand.ctx.item_check("Isolines")
    hand.ctx.item_input_value("##isolines", "60, 100")
    hand.wait(lambda: viewport.picture.scale.lines == (60.0, 100.0))
    hand.ctx.item_input_value("##isolines", "60; many")
    hand.ctx.yield_(3)
    assert viewer.log.last.text == "isolines: they must be auto, or up to 16 numbers over 0: E1,E2,..., got 60,many"
    hand.ctx.yield_(25)
    lined = hand.pixels().astype(int)
    for E in (60.0, 100.0):
        radius = math.sqrt((INTENSITY * HEIGHT / E) ** (2 / 3) - HEIGHT**2)
        for turn in (0.3, 2.0, 4.4):
            at = hand.at((radius * math.cos(turn), radius * math.sin(turn), 0.0))
            column, row = (int(c - o) for c, o in zip(at, viewport.view.origin, strict=True))
            assert lined[row - 2 : row + 3, column - 2 : column + 3].min(axis=2).max() > 180, (E, turn)
    beside = hand.at((0.0, 0.0, 0.0))
    column, row = (int(c - o) for c, o in zip(beside, viewport.view.origin, strict=True))
    assert lined[row, column].min() < 170, "no line where the light has another value"


@in_window(scene=lamp_over_floor, show="illuminance", lit=False)
def test_nothing_is_measured_again_while_false_colours_rest(hand, viewer, monkeypatch):
    calls, visible = [], module.visible_light

    def counted(*given):
        calls.append(given)
        return visible(*given)

    monkeypatch.setattr(module, "visible_light", counted)
    monkeypatch.setattr("app.window.viewer.LINGER", 0.0)
    viewer.clock.awake_until = 0.0  # of earlier input
    hand.wait_for_light()
    hand.wait(lambda: viewer.session.light.all_done)
    hand.wait(lambda: viewer._is_still)
    hand.ctx.yield_(30)
    calls.clear()
    hand.ctx.yield_(30)
    assert not calls and viewer._is_still
    for _ in range(5):  # the wheel turns
        viewer.viewport.view.camera = viewer.viewport.view.camera.dolly(0.2)
        hand.ctx.yield_()
    hand.ctx.yield_(30)
    assert len(calls) == 1


def test_pins_read_the_light_of_the_picture_and_are_undone_saved_and_removed(play, tmp_path):
    def script(hand, viewer):
        viewport, session = viewer.viewport, viewer.session
        hand.wait_for_light()
        hand.wait(lambda: session.light.all_done)
        place = (0.33, -0.21, 0.0)
        hand.move(hand.at(place))
        light = viewport.pointer.reading.irradiance
        hand.press(keys().i)
        (pinned,) = viewport.pins.shown
        assert pinned.pin.name == "pin 1" and pinned.pin.normal == (0.0, 0.0, 1.0)
        assert np.abs(pinned.position - place).max() < 0.01  # the cursor stands on whole pixels
        E = closed_form.point_over_plane(INTENSITY, HEIGHT, math.hypot(*place[:2]))
        assert pinned.reading.irradiance == pytest.approx(light, rel=1e-4) == pytest.approx(E, rel=0.02)
        assert pinned.reading.radiance == pytest.approx(0.5 * E / math.pi, rel=0.02)
        assert pinned.reading.material == "oak"

        hand.ctx.item_click("//Panel/**/Pin a read-out")  # the button: then a click in the picture
        assert viewport.pins.waiting and "Click a surface" in viewport.hint()
        tile, camera = hand.at((1.4, 1.2, 0.01)), viewport.view.camera
        hand.move(tile)
        hand.ctx.mouse_click(0)
        hand.ctx.yield_(3)
        assert len(viewport.pins.shown) == 2 and viewport.pins.shown[1].pin.object == "tile"
        assert viewport.view.camera == camera and not session.moved, "the click moves nothing"
        before = viewport.pins.shown[1].position
        pose = session.poses["tile"]
        session.move({"tile": pose._replace(position=(1.0, 1.2, 0.01))})
        hand.wait_for_light()
        assert viewport.pins.shown[1].position == pytest.approx(before - (0.4, 0, 0)), "it follows its object"
        E = closed_form.point_over_plane(INTENSITY, HEIGHT - 0.01, math.hypot(*viewport.pins.shown[1].position[:2]))
        assert viewport.pins.shown[1].reading.irradiance == pytest.approx(E, rel=0.05)

        viewer._do("undo")  # the second pin; the move above was no step
        hand.ctx.yield_(3)
        assert [p.pin.name for p in viewport.pins.shown] == ["pin 1"]
        viewer._do("redo")
        hand.ctx.yield_(3)
        assert [p.pin.name for p in viewport.pins.shown] == ["pin 1", "pin 2"]

        hand.ctx.item_input_value("//Panel/**/pin 0/##name", "desk")
        hand.ctx.yield_(3)
        assert [p.pin.name for p in viewport.pins.shown] == ["desk", "pin 2"]
        table = view_content.readouts_csv(session, viewport.pins.shown).splitlines()
        assert table[1].startswith("pin,desk,0.3") and table[1].endswith("static part,oak,")

        assert viewer.files.has_changed(session)
        viewer.files.save(session, viewport, str(tmp_path / "a.toml"))
        assert saved_scene.read(str(tmp_path / "a.toml")).pins == session.settings.pins

        hand.move(hand.at(viewport.pins.shown[0].position))
        hand.press(keys().delete)
        assert [p.pin.name for p in viewport.pins.shown] == ["pin 2"], "the one under the cursor"
        hand.ctx.item_click("//Panel/**/pin 0/x")
        hand.ctx.yield_(3)
        assert viewport.pins.shown == () and session.settings.pins == ()

    scene = tmp_path / "lamp.glb"
    scene.touch()
    settings = replace(support.SETTINGS, light="best", scene=str(scene))
    assert errors(play(script, settings, support.opening(lamp_over_floor()))) == []


SURFACE = CalculationSurface("desk", "", (0.0, 0.0), (2.0, 1.0), 0.75, points=(5, 3))


@in_window(scene=lamp_over_floor, light="photons")
def test_a_surface_is_measured_at_rest_and_again_after_a_move(hand, viewer, monkeypatch):
    """The window's thread traces none of its paths."""
    threads, step = set(), SurfacesJob.step
    monkeypatch.setattr(SurfacesJob, "step", lambda job: (threads.add(threading.current_thread().name), step(job))[1])
    session = viewer.session
    hand.ctx.set_ref("Panel")
    hand.ctx.item_click("Add a surface")
    hand.ctx.yield_(2)
    assert [x.name for x in session.settings.surfaces] == ["surface 1"]
    session.edit(surfaces=(SURFACE,))

    def light():
        return next(iter(session.light.snapshot.rest.surfaces), None)

    hand.wait(lambda: light() is not None and light().surface == SURFACE and light().fraction == 1)
    points = light().grid.positions
    E = closed_form.point_over_plane(INTENSITY, HEIGHT - 0.75, np.hypot(*points[:, :2].T))
    assert light().values == pytest.approx(E, rel=0.02)
    assert light().rows()[3][1] == pytest.approx(E.min() / E.mean(), rel=0.02)
    hand.ctx.yield_(2)
    rest = f"{light().numbers.points}"
    assert rest == "15"
    table = view_content.readouts_csv(session, ()).splitlines()
    assert sum(line.startswith("surface point,") for line in table) == 15

    pose = session.poses["tile"]
    below = pose._replace(position=(0.0, 0.0, 1.5), quaternion=(0.0, 1.0, 0.0, 0.0))  # its front faces the plane
    session.move({"tile": below})
    hand.wait(lambda: light().is_current and light().fraction == 1 and light().values.min() < 1)
    middle = light().values.reshape(5, 3)[2, 1]
    assert middle < 0.2 * E.max() and light().values.reshape(5, 3)[0] == pytest.approx(E.reshape(5, 3)[0], rel=0.1)
    assert "surface point" not in view_content.readouts_csv(session, ()) or light().is_current

    for section in ("Objects", "Lamps", "Picture"):
        hand.ctx.item_close(section)
    hand.ctx.item_click("**/Remove surface")
    hand.wait(lambda: light() is None)
    hand.press(int(keys().mod_ctrl) | int(keys().z))
    assert session.settings.surfaces == (SURFACE,)
    assert threads == {"solver"}


HELD = SURFACE._replace(name="held", targets=(("mean", 60.0),))


@in_window(scene=lamp_over_floor, light="best")
def test_lamps_hold_a_target_and_undo_brings_levels_back(hand, viewer, monkeypatch):
    """The switch dims the lamp at rest and in motion; the surface has the light of the frame; undo is as before."""
    session = viewer.session
    session.edit(surfaces=(HELD,))
    hand.panel("Scene", "Objects", "Lamps", "Picture")
    before = session.light.snapshot.levels
    hand.ctx.item_click("**/Hold targets")
    hand.wait(lambda: session.light.snapshot.rest.held is not None)
    snapshot = session.light.snapshot
    assert (snapshot.levels < before).all() and not snapshot.rest.held.missing
    mean, error = snapshot.rest.surfaces[0].numbers.mean
    assert mean == pytest.approx(60.0 + 2.05 * error, abs=0.2 * error + 1e-3)
    assert snapshot.rest.surfaces[0].is_current and snapshot.rest.surfaces[0].verdicts == {"mean": "pass"}
    session.move({"tile": Pose((0.0, 0.0, 1.5), (0.0, 1.0, 0.0, 0.0))})  # its front faces the plane
    hand.wait(lambda: (session.light.snapshot.levels > 1.2 * snapshot.levels).all())
    hand.press(int(keys().mod_ctrl) | int(keys().z))
    hand.wait(lambda: session.light.snapshot.rest.held is None)
    assert not session.settings.hold and (session.light.snapshot.levels == before).all()


@in_window(scene=lamp_over_floor, light="photons")
def test_points_beyond_their_range_are_cut_to_it(hand, viewer):
    """500 points along an axis were refused without a word."""
    viewer.session.edit(surfaces=(SURFACE,))
    hand.panel("Objects", "Lamps", "Picture")
    hand.ctx.item_input_value("**/##points/$$0/", 500)
    hand.ctx.yield_(2)
    assert viewer.session.settings.surfaces[0].points == (100, 3)


@in_window(scene=lamp_over_floor, light="photons")
def test_glare_has_a_target_of_its_own(hand, viewer):
    """A mean of UGR was asked for in its place, or kept from illuminance; then the surface was "no longer there"."""
    session = viewer.session
    session.edit(surfaces=(HELD,))
    hand.panel("Scene", "Objects", "Lamps", "Picture")
    hand.ctx.yield_(2)
    hand.ctx.item_click("surface 0/###surface/##quantity")
    hand.ctx.item_click("//$FOCUSED/UGR")
    hand.ctx.yield_(2)
    assert session.settings.surfaces[0].targets == () and session.grids
    hand.ctx.item_input_value("**/##   UGR <= t", 19.0)
    hand.ctx.yield_(2)
    assert session.settings.surfaces[0].targets == (("maximum", 19.0),) and session.grids
    assert not hand.ctx.item_exists("**/##   mean >= t")
    hand.ctx.item_input_value("**/##   views", 4)
    hand.ctx.item_input_value("**/##Maintenance", "0.8")
    hand.ctx.yield_(2)
    assert session.settings.surfaces[0].views == 4 and session.settings.maintenance_factor == 0.8
    for _ in range(2):
        hand.press(int(keys().mod_ctrl) | int(keys().z))
    assert session.settings.surfaces[0].views == 1 and session.settings.maintenance_factor != 0.8
    assert session.settings.surfaces[0].targets == (("maximum", 19.0),)


@in_window(scene=lamp_over_floor, light="photons")
def test_without_read_outs_nothing_is_exported(hand, viewer):
    """The menu wrote a file with a header alone; the panel's button is grey."""
    hand.ctx.set_ref("##MainMenuBar")
    hand.ctx.menu_click("File/Export read-outs...")
    hand.ctx.yield_(3)
    assert not viewer.files.dialog.is_open and viewer.log.last.text.startswith("there is nothing to export: key I")


def test_a_message_is_shown_once():
    """A message that has had its time does not come back where the cursor leaves the picture."""
    log = Log()
    assert overlay.message_at(log, 0.0) is None
    log("nothing to undo")
    (entry,) = log.entries
    assert overlay.message_at(log, entry.when + 1.0) == entry
    assert overlay.message_at(log, entry.when + 4.0) is None


@in_window(light="best")
def test_the_read_out_states_the_error_at_its_place(hand, viewer, rough_light):
    """The status line had the mean error of the scene alone. In motion the error is not known."""
    session, viewport = viewer.session, viewer.viewport
    hand.wait(lambda: session.light.all_done)
    deviation = session.light.snapshot.deviation
    assert deviation.shape == (len(session.irradiance),)
    hand.move(hand.at((0.2, 0.8, 0.0)))
    reading, nearest = viewport.pointer.reading, session.receiver
    assert reading.error == deviation[nearest] > 0 and reading.error < 0.1 * reading.irradiance
    assert f" ± {reading.error:.2g} W/m²" in reading.text()
    hand.press(keys().i)
    hand.wait(lambda: viewport.pins.shown)
    assert viewport.pins.shown[0].reading.error == deviation[nearest]
    (row,) = [line for line in view_content.readouts_csv(session, viewport.pins.shown).splitlines() if "pin 1" in line]
    assert float(row.split(",")[6]) == pytest.approx(deviation[nearest])
    block = hand.at(BLOCK_FRONT)
    hand.move(block)
    hand.ctx.mouse_down(0)
    hand.move((block[0] + 40, block[1]))
    moved = session.light.snapshot.deviation
    own = session.model.surfaces.receiver_range(1)
    assert moved is None or np.isnan(moved[own]).all()
    hand.ctx.mouse_up(0)


@in_window(scene=lamp_over_floor, light="photons")
def test_a_folded_surface_shows_its_name_and_mean_alone(hand, viewer):
    """Points of several surfaces covered the picture and each other."""
    session, viewport = viewer.session, viewer.viewport
    session.edit(surfaces=(SURFACE,))
    hand.panel("Objects", "Lamps", "Picture")
    hand.wait(lambda: session.light.snapshot.rest.surfaces and session.light.snapshot.rest.surfaces[0].fraction == 1)
    hand.ctx.yield_(2)
    shown = readout_marks.marks(viewport)
    assert len(shown.dots) == 15 and len(shown.lines) == 4
    hand.ctx.item_click("**/###surface")
    hand.ctx.yield_(2)
    folded = readout_marks.marks(viewport)
    mean, _ = session.light.snapshot.rest.surfaces[0].numbers.mean
    assert not folded.dots and len(folded.lines) == 4
    assert [x.text for x in folded.labels] == [f"{SURFACE.name}: {mean:.0f} lx"]
    hand.ctx.item_click("**/###surface")
    hand.ctx.yield_(2)
    assert len(readout_marks.marks(viewport).dots) == 15


@in_window(scene=lamp_over_floor, light="photons")
def test_a_surface_lies_on_a_clicked_material_and_its_rows_stay_where_they_are(hand, viewer):
    """The button was grey for a desk of the static part; rows of numbers pushed it down when they came."""
    session = viewer.session
    hand.panel("Scene", "Objects", "Lamps", "Picture")
    hand.click((0.3, -0.2, 0.0))
    hand.ctx.item_click("**/On the selection")
    hand.ctx.yield_(3)
    (surface,) = session.settings.surfaces
    assert surface == CalculationSurface("oak 1", position=(0, 0), size=(4, 4), height=0.0)
    before = hand.ctx.item_info("**/On the selection").rect_full.min.y
    hand.wait(lambda: session.light.snapshot.rest.surfaces and session.light.snapshot.rest.surfaces[0].fraction == 1)
    hand.ctx.yield_(3)
    assert hand.ctx.item_info("**/On the selection").rect_full.min.y == before


@in_window(scene=lamp_over_floor, light="best")
def test_a_key_asks_where_light_comes_from_until_a_click_on_its_pin(hand, viewer, monkeypatch):
    """Below the lamp all but a little is straight from it; the tile moves, and its pin with it."""
    drawn, line = [], spot_card._line
    monkeypatch.setattr(spot_card, "_line", lambda text, *given: (drawn.append(text), line(text, *given)))
    tile = (1.4, 1.2, 0.01)
    hand.move(hand.at(tile))
    hand.press(keys().j)
    hand.wait(lambda: len(viewer.viewport.pins.shown) == 1)
    (pin,) = viewer.session.settings.pins
    hand.wait(lambda: viewer.session.light.snapshot.rest.asked is not None)
    assert viewer.session.settings.asked == pin and viewer.viewport.mobile_drag.grab is None
    hand.wait(lambda: viewer.session.light.all_done)
    asked = viewer.session.light.snapshot.rest.asked
    E = closed_form.point_over_plane(INTENSITY, HEIGHT - 0.01, math.hypot(1.4, 1.2))
    straight = asked.origins.shares(BOUNCES)[0]
    assert asked.is_current and asked.origins.fraction == 1 and asked.pin == pin
    assert straight.share * asked.origins.total[0] == pytest.approx(E, rel=0.02) and straight.share > 0.9
    drawn.clear()
    hand.ctx.yield_(2)
    assert drawn[0].startswith("pin 1: ") and drawn[1] == "by lamp" and drawn[2].name == "lamp"

    viewer.session.begin_drag()
    viewer.session.move({"tile": Pose((0.5, 0.0, 0.01))})
    hand.ctx.yield_(2)
    assert not viewer.session.light.snapshot.rest.asked.is_current
    viewer.session.end_drag()
    hand.wait(lambda: (now := viewer.session.light.snapshot.rest.asked) is not None and now.is_current)
    hand.wait(lambda: viewer.session.light.all_done)
    E = closed_form.point_over_plane(INTENSITY, HEIGHT - 0.01, 0.5)
    assert viewer.session.light.snapshot.rest.asked.origins.total[0] == pytest.approx(E, rel=0.02)
    hand.click((0.5, 0.0, 0.01))
    hand.wait(lambda: viewer.session.settings.asked is None)
    hand.wait(lambda: viewer.session.light.snapshot.rest.asked is None)
    assert not viewer.files.has_changed(viewer.session) or viewer.session.settings.pins, "a question is not saved"
