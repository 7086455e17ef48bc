"""Lamps in the window: levels, on, solo, colour, all drawn at once and equal to light from scratch."""

from dataclasses import replace

import numpy as np
import pytest
from imgui_bundle import imgui

from app.cli import saved_scene
from app.draw.colour_map import REC709, colour_of, factor, kelvin_of, of_luminance_one
from app.settings import LampLevel
from app.window.panel import widgets as ui
from app.window.panel.lamps import BRIGHTEST_BY_SLIDER, OF_FILE, recoloured
from gi_core.scene import PointLight
from tests.support import viewer_support as support
from tests.support.viewer_hand import BLOCK_FRONT, errors, in_window, keys


def two_lamps(flux=(4.0, 4.0, 8.0)):
    return replace(support.room(), lights=(PointLight("bulb", (0.8, 0.2, 0.8), flux),))


@in_window(scene=two_lamps, lamps=(LampLevel("lamp", 0.5), LampLevel("bulb")))
def test_lamps_at_the_level_of_the_scene_file_are_no_change(hand, viewer):
    assert not viewer.files.has_changed(viewer.session), "the panel drops a level of 1, which solo had saved"
    alone = replace(viewer.session.settings, solo="bulb").without_solo(("lamp", "bulb"))
    assert alone.lamps == (LampLevel("lamp", 0.5, on=False),)


@in_window(scene=two_lamps, light="photons")
def test_panel_dims_lamps(hand, viewer):
    session, ctx = viewer.session, hand.ctx
    full, picture = session.irradiance.copy(), hand.pixels()
    names = session.model.emitters.lamps.names
    assert names == ("lamp", "bulb")

    def lit(level: dict) -> np.ndarray:
        hand.wait_for_light()
        assert np.array_equal(session.light.snapshot.levels, [level.get(n, (1.0,) * 3) for n in names])
        assert hand.light_is_that_from_scratch()
        return session.irradiance

    ctx.item_close("**/Objects")  # items out of the panel's view cannot be found by name
    section = f"**/{session.model.emitters.lamps.names[1]}"
    ctx.item_input_value(f"{section}/##level", 200.0)
    brighter = lit({"bulb": (2.0,) * 3})
    assert (brighter >= full - 1e-12).all() and brighter.sum() > 1.05 * full.sum()
    ctx.item_uncheck(f"{section}/##on")
    without = lit({"bulb": (0.0,) * 3})
    assert without + (brighter - full) == pytest.approx(full, rel=1e-9, abs=1e-12)
    ctx.item_check(f"{section}/##on")
    ctx.item_click(f"{section}/Solo")
    alone = lit({"lamp": (0.0,) * 3, "bulb": (2.0,) * 3})
    assert alone == pytest.approx(2 * (full - without), rel=1e-9, abs=1e-12)
    mesh = session.meshes[0]
    assert not mesh.emission.any(), "the face of a lamp that is off is dark"
    assert (hand.pixels() != picture).any()
    ctx.item_click(f"{section}/All")
    lit({"bulb": (2.0,) * 3})
    ctx.item_click("**/Reset lamps")
    assert np.array_equal(lit({}), full)
    assert session.meshes[0].emission.any() and session.settings.lamps == ()

    # A light scene, kept and chosen again; the first one moves no row of a lamp.
    ctx.item_input_value(f"{section}/##level", 50.0)
    lit({"bulb": (0.5,) * 3})
    ctx.item_input_value("**/##Keep as", "evening")
    before = ctx.item_info(f"{section}/##level").rect_full
    ctx.item_click("**/Keep")
    hand.ctx.yield_(2)
    assert ctx.item_info(f"{section}/##level").rect_full.min.y == before.min.y
    ctx.item_click("**/Reset lamps")
    lit({})
    (evening,) = dict(session.settings.light_scenes).values()
    session.want(session.settings.in_light_scene(evening))
    hand.wait(lambda: session.light.snapshot.levels[1][0] == 0.5)
    lit({"bulb": (0.5,) * 3})
    assert not errors(viewer)


@in_window(scene=two_lamps, light="photons")
def test_lamps_that_solo_switches_off_look_so(hand, viewer, monkeypatch):
    """Their boxes stayed ticked."""
    tips = []
    explained = ui.explained
    monkeypatch.setattr(ui, "explained", lambda text: (tips.append(text), explained(text))[1])
    session, ctx = viewer.session, hand.ctx
    ctx.item_close("**/Objects")
    ctx.item_click("**/bulb/Solo")
    assert session.settings.solo == "bulb"
    assert ctx.item_is_checked("**/bulb/##on") and not ctx.item_is_checked("**/lamp/##on")
    ctx.item_click("**/lamp/##on")
    assert session.settings.lamps == (), "the lamp keeps its own switch"
    hand.wait(lambda: "Off because of Solo of bulb. After All it is on." in tips)
    ctx.item_click("**/bulb/All")
    assert ctx.item_is_checked("**/lamp/##on")
    ctx.item_uncheck("**/lamp/##on")
    ctx.item_click("**/bulb/Solo")
    ctx.mouse_move("**/lamp/##on")
    hand.wait(lambda: "Off because of Solo of bulb. After All it is off." in tips)
    ctx.item_click("**/bulb/All")
    assert not ctx.item_is_checked("**/lamp/##on") and not errors(viewer)


@in_window(scene=two_lamps, light="photons")
def test_a_held_slider_follows_the_mouse_in_one_step_of_undo(hand, viewer):
    session, ctx = viewer.session, hand.ctx

    def level() -> float:
        return session.settings.levels(("bulb",))["bulb"][0]

    ctx.item_close("**/Objects")
    slider = f"**/{session.model.emitters.lamps.names[1]}/##level"
    ctx.item_input_value(slider, 900.0)
    assert level() == 9.0, "typed in per cent, over the end of the slider"
    low, high = ctx.item_info(slider).rect_full.min, ctx.item_info(slider).rect_full.max
    levels = []
    ctx.mouse_move(slider)
    ctx.mouse_down(0)
    for share in (0.2, 0.4, 0.6, 0.8):
        ctx.mouse_move_to_pos((low.x + share * (high.x - low.x), 0.5 * (low.y + high.y)))
        levels.append(level())
    ctx.mouse_up(0)
    assert np.allclose(np.diff(levels), 0.2 * BRIGHTEST_BY_SLIDER, rtol=0.2)
    hand.wait_for_light()
    assert session.light.snapshot.levels[1].tolist() == [levels[-1]] * 3
    session.undo()
    assert level() == 9.0
    session.undo()
    assert level() == 1.0
    session.redo()
    session.redo()
    hand.wait_for_light()
    assert level() == levels[-1] and hand.light_is_that_from_scratch() and not errors(viewer)


@in_window(scene=two_lamps)
def test_a_lamp_is_dimmed_while_an_object_is_dragged(hand, viewer):
    session = viewer.session
    session.want(replace(session.settings, lamps=(LampLevel("bulb", 0.25),)))
    hand.drag(hand.at(BLOCK_FRONT), [c + 40 for c in hand.at(BLOCK_FRONT)])
    assert session.moved
    hand.wait_for_light()
    assert session.light.snapshot.levels[1].tolist() == [0.25] * 3
    assert hand.light_is_that_from_scratch() and not errors(viewer)


@in_window(scene=two_lamps)
def test_a_frame_of_few_photons_has_no_row_about_lamps(hand, viewer, monkeypatch):
    """The row moved the panel in each drag, although no lamp was dimmed."""
    names, number = [], ui.number
    monkeypatch.setattr(ui, "number", lambda name, *others: (names.append(name), number(name, *others))[1])
    light = viewer.session.light
    hand.wait(lambda: light.all_done)
    monkeypatch.setattr(viewer.session, "tick", lambda *_, **__: None)  # else a late result replaces the numbers
    whole = light.snapshot
    for photons, effective in ((whole.photons // 4, whole.photons // 4), (whole.photons, whole.photons // 2)):
        light.snapshot = whole._replace(photons=photons, effective_photons=effective)
        names.clear()
        hand.ctx.yield_(2)
        assert "Together" in names and ("Photons that count" in names) == (effective < photons)
    light.snapshot = whole


@in_window(scene=two_lamps, light_scenes=(("dim", (LampLevel("bulb", 0.5), LampLevel("lamp", on=False))),))
def test_every_entry_of_the_light_scenes_can_be_chosen(hand, viewer):
    """The entry "-" did nothing; the levels of the scene file could not be chosen."""
    session, ctx = viewer.session, hand.ctx
    hand.panel("Objects")
    dim = (LampLevel("bulb", 0.5), LampLevel("lamp", on=False))
    for entry, lamps in (("dim", dim), (OF_FILE, ()), ("dim", dim)):
        ctx.combo_click(f"##Light scene/{entry}")
        assert session.settings.lamps == lamps
        hand.wait_for_light()
        level = 0.5 if lamps else 1.0
        assert session.light.snapshot.levels.tolist() == [[0.0 if lamps else 1.0] * 3, [level] * 3]
    assert not errors(viewer)


@in_window(scene=lambda: two_lamps((4.0, 9.0, 40.0)), light="photons", exposure=0.0)
def test_the_white_balance_stays_where_lamps_change(hand, viewer):
    """As the exposure does; a balance that followed the only lamp on would take back its colour."""
    session, ctx = viewer.session, hand.ctx
    ctx.item_close("**/Objects")
    gains = viewer.viewport.look().gains
    ctx.item_click("**/lamp/Solo")
    hand.wait_for_light()
    pictures = [hand.pixels()]
    session.want(replace(session.settings, lamps=(LampLevel("lamp", 1.0, (0.5, 1.0, 2.0)),)))
    hand.wait_for_light()
    pictures.append(hand.pixels())
    assert viewer.viewport.look().gains == gains
    red, blue = ([p[p.shape[0] // 2 :, :, c].mean() for p in pictures] for c in (0, 2))
    assert red[1] < 0.9 * red[0] and blue[1] > 1.1 * blue[0]


STRING = tuple(PointLight(f"bulb {k}", (0.1 + 0.07 * k, 0.2, 0.8), (0.4,) * 3) for k in range(11))


@in_window(scene=lambda: replace(support.room(), lights=STRING), light="photons", size=(720, 570))
def test_the_wheel_over_a_lamp_scrolls_the_panel(hand, viewer):
    """The list scrolled within itself: at its ends the wheel did nothing, and of twelve lamps four were in view."""
    ctx = hand.ctx
    ctx.item_close("**/Objects")
    ctx.item_close("**/Scene")
    rows = [ctx.item_info(f"**/{name}/##level").rect_full.min.y for name in viewer.session.model.emitters.lamps.names]
    assert len(rows) == 12 and np.diff(rows).tolist() == [imgui.get_frame_height_with_spacing()] * 11
    panel = ctx.get_window_by_ref("Panel")
    before = panel.scroll.y
    ctx.mouse_move("**/bulb 3/##level")
    for way in (-1, 1):
        for _ in range(12):
            ctx.mouse_wheel_y(way)
            ctx.yield_()
        assert panel.scroll.y == (panel.scroll_max.y if way < 0 else 0.0) != before
        before = panel.scroll.y


@in_window(scene=two_lamps, light="photons")
def test_lamps_that_are_off_keep_their_levels_in_a_saved_scene(hand, viewer, folder):
    """They were saved as lamps at level 0: a lamp off, and all but one under Solo, in light scenes too."""
    session, ctx = viewer.session, hand.ctx
    ctx.item_close("**/Objects")
    ctx.item_input_value("**/bulb/##level", 40.0)
    ctx.item_uncheck("**/bulb/##on")
    ctx.item_input_value("**/##Keep as", "evening")
    ctx.item_click("**/Keep")

    def saved():
        return saved_scene.read(str(viewer.files.save(session, viewer.viewport, "a.toml")[0]))

    off = (LampLevel("bulb", 0.4, on=False),)
    assert saved().lamps == off and saved().light_scenes == (("evening", off),)
    ctx.item_check("**/bulb/##on")
    ctx.item_click("**/lamp/Solo")
    assert saved().lamps == off
    ctx.item_click("**/Reset lamps")
    ctx.item_click("**/lamp/Solo")
    hand.wait_for_light()
    ctx.key_press(keys().f5)  # a reload forgot that a lamp was alone
    hand.wait(lambda: viewer.session is not session)
    hand.wait_for_light()
    assert viewer.session.settings.solo == "lamp"
    hand.wait(lambda: not viewer.session.light.snapshot.levels[1].any())
    assert not errors(viewer)


@pytest.mark.parametrize(
    "kelvin, x, y", [(2856.0, 0.44757, 0.40745), (4000.0, 0.38052, 0.37677), (6500.0, 0.31352, 0.32363)]
)
def test_colours_lie_on_the_planckian_locus(kelvin, x, y):
    """Chromaticities of the locus: CIE 15, table T.2 (2856 K is illuminant A)."""
    rgb = np.array(colour_of(kelvin))
    assert rgb @ REC709 == pytest.approx(1.0)
    to_xyz = np.array([(0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)])
    X, Y, Z = to_xyz @ rgb
    assert (X / (X + Y + Z), Y / (X + Y + Z)) == pytest.approx((x, y), abs=1.5e-3)
    assert kelvin_of(rgb) == pytest.approx(kelvin, rel=0.02)


def test_a_temperature_keeps_luminance_and_dark_channels():
    base = (1.2, 1.0, 0.4111)
    made = np.multiply(factor(3000.0, base), base)
    assert made @ REC709 == pytest.approx(np.dot(base, REC709))
    assert made / made[1] == pytest.approx(np.array(colour_of(3000.0)) / colour_of(3000.0)[1])
    assert factor(3000.0, (1.0, 0.0, 0.0))[1:] == (0.0, 0.0)


@in_window(scene=lambda: two_lamps((0.2, 0.2, 0.2)), light="photons")
def test_other_light_says_how_to_meter_the_exposure(hand, viewer):
    """Solo left a dark picture without a word, and so did a lamp that was out; one at half its level needs none."""
    session, ctx = viewer.session, hand.ctx
    ctx.item_close("**/Objects")
    ctx.item_input_value("**/lamp/##level", 50.0)
    hand.wait_for_light()
    assert session.log.last is None or "exposure" not in session.log.last.text
    exposure = session.settings.exposure
    ctx.item_click("**/bulb/Solo")
    hand.wait_for_light()
    hint = session.log.last
    assert hint.text == "the exposure stays as it was: key A meters it"
    assert session.settings.exposure == exposure
    ctx.item_click("**/bulb/All")
    hand.wait_for_light()
    assert session.log.last.text == hint.text and session.log.last is not hint
    hint = session.log.last
    ctx.item_input_value("**/lamp/##level", 4.0)
    hand.wait_for_light()
    assert session.log.last.text == hint.text and session.log.last is not hint


@in_window(scene=two_lamps, light="photons")
def test_rgb_is_the_colour_of_the_light(hand, viewer):
    """It was a factor on the colour in the scene file: a peach lamp read 1, 1, 1 beside a white patch."""
    ctx = hand.ctx
    ctx.item_close("**/Objects")
    base = of_luminance_one(viewer.session.model.emitters.flux_of_lamps[1])
    box = ctx.item_info("**/bulb/Solo").rect_full
    ctx.mouse_move_to_pos((box.min.x - 15, (box.min.y + box.max.y) / 2))  # the patch of the lamp's colour
    ctx.mouse_click(0)
    ctx.yield_(2)
    ctx.item_input_value("//$FOCUSED/RGB/##X", 0.25)
    hand.wait_for_light()
    (lamp,) = viewer.session.settings.lamps
    assert lamp.colour == (pytest.approx(0.25 / base[0]), 1.0, 1.0)
    assert np.allclose(viewer.session.light.snapshot.levels[1], lamp.colour)


def test_a_channel_without_light_stays_dark():
    assert recoloured((1.0, 0.5, 1.0), (2.0, 0.3, 0.0), (2.0, 0.3, 4.0), (2.0, 0.6, 0.0)) == (1.0, 0.5, 1.0)
    assert recoloured((1.0, 0.5, 1.0), (2.0, 0.3, 0.0), (1.0, 0.6, 4.0), (2.0, 0.6, 0.0)) == (0.5, 1.0, 1.0)
