"""The panel: every control works and has a tooltip, no slider delays a frame, drags keep the budget."""

import re
import threading
from dataclasses import replace

import numpy as np
import pytest
from imgui_bundle import imgui

from app.draw.tonemap import UNLIT
from app.session import session as session_module
from app.window import label, overlay, view_content
from app.window.panel import quality, widgets
from app.window.panel import widgets as ui
from gi_core.bsdf.models import lobe
from gi_core.discs.search import SEARCHES
from gi_core.estimators import ESTIMATORS
from gi_core.frames.light_setting import ALL_RAYS, LIST, OPENED, QUADTREE
from gi_core.instruments import compile_ahead
from tests.support import viewer_support as support
from tests.support.viewer_hand import BLOCK_FRONT, errors, in_window, keys


@in_window()
def test_panel_controls(hand, viewer):
    K = keys()
    session, ctx = viewer.session, hand.ctx
    names = list(ESTIMATORS)

    # Estimators by combo and by key, without tracing anything again.
    before = hand.pixels()
    hand.open_research()
    ctx.combo_click(f"##Estimator/{names[-1].replace('_', ' ').capitalize()}")
    hand.wait_for_light()
    assert session.light._solver.setting.estimator == session.settings.estimator == names[-1]
    assert (hand.pixels() != before).any()
    for k, name in enumerate(names[:3]):
        hand.press((K._1, K._2, K._3)[k])
        hand.wait_for_light()
        assert session.light._solver.setting.estimator == name

    # Values typed in.
    hand.press((K._1, K._2, K._3)[names.index("photon_map")])
    hand.wait_for_light()
    ctx.item_input_value("##Radius", 0.1)
    ctx.item_input_value("##Neighbours k", 12)
    ctx.item_input_value("##Photons", 30_000)
    hand.wait_for_light()
    assert session.light._solver.setting.radius == pytest.approx(0.1)
    assert session.light._solver.setting.neighbours == 12
    assert session.light._solver.frame.photons == 30_000

    # Artifact control: the corners of the room are darker without.
    hand.press(K._1)
    hand.wait_for_light()
    lit = session.irradiance
    ctx.item_click("Bias correction")
    ctx.item_uncheck("Artifact control")
    hand.wait_for_light()
    assert session.light._solver.setting.control is session.settings.control is False
    assert (session.irradiance < 0.9 * lit).any()

    # Border correction and the textbook's k: more light where three walls meet, and everywhere.
    hand.press(K._1 if names[0] == "photon_map" else K._2)
    hand.wait_for_light()
    lit = session.irradiance
    ctx.item_uncheck("Border correction")
    hand.wait_for_light()
    assert (session.irradiance != lit).any() and not session.light._solver.setting.border_correction
    lit = session.irradiance
    ctx.item_check("Count k-th hit")
    hand.wait_for_light()
    assert session.irradiance.mean() > lit.mean() and session.light._solver.setting.textbook

    # Exposure by slider, then metered again.
    metered = session.settings.exposure
    ctx.item_input_value("##Exposure", metered - 2)
    dark = hand.pixels()
    ctx.item_click("Meter exposure")
    ctx.yield_(2)
    assert session.settings.exposure == pytest.approx(metered, abs=0.3)
    assert hand.pixels().mean() > dark.mean() + 20

    ctx.combo_click("##Tone map/Clip")
    ctx.combo_click("##Show/Light alone")
    ctx.item_uncheck("Back-face culling")
    ctx.yield_(2)
    s = session.settings
    assert (s.tone_map, s.show, s.cull) == ("clip", "irradiance", False)
    grey = np.round(255 * np.array(UNLIT)).astype(int)
    middle = hand.pixels()[viewer.painter.renderer.size[1] // 2, viewer.painter.renderer.size[0] // 2]
    assert np.array_equal(middle, grey), f"{middle}, not {grey}: the closed room from outside, its walls drawn"

    # Every control has a tooltip.
    refs = "##Estimator ##Photons ##Radius ##Neighbours_k ##Light Artifact_control Border_correction Count_k-th_hit"
    refs += " ##Exposure Meter_exposure ##Tone_map ##Show ##Scale White_balance Back-face_culling ##Quality"
    refs += " ###Play Reset_poses Reset_view ##Time_budget Research"
    for ref in refs.split():
        ctx.mouse_move(ref.replace("_", " "))
        ctx.sleep_no_skip(0.7, 0.1)
        windows = [w for w in imgui.get_current_context().windows if w.name.startswith("##Tooltip") and w.active]
        assert windows, f"{ref} has no tooltip"


@in_window()
def test_controls_without_an_effect_are_grey_and_say_why(hand, viewer, monkeypatch):
    reasons: set[str] = set()
    explained = widgets.explained
    monkeypatch.setattr(widgets, "explained", lambda text: (reasons.add(explained(text)), explained(text))[1])
    of_hits = "##Neighbours k", "Border correction", "Count k-th hit"
    of_display = "##Exposure", "##Tone map", "White balance"
    ctx, s = hand.ctx, viewer.session

    def grey(*names) -> list[bool]:
        ctx.yield_(3)
        return [bool(ctx.item_info(n).item_flags & imgui.ItemFlags_.disabled) for n in names]

    hand.open_research()
    ctx.item_click("Bias correction")
    assert grey("Artifact control", *of_hits, "##Light", "##Radius") == [False, True, True, True, False, False]
    reasons.clear()
    ctx.mouse_move("Border correction")
    ctx.sleep_no_skip(0.7, 0.1)
    assert any(text.endswith("\nNo effect now: only photon_map uses it.") for text in reasons)
    s.want(replace(s.settings, estimator="photon_map"))
    assert grey("Artifact control", *of_hits, "##Light") == [True, False, False, False, False]
    assert grey(*of_display, "##Scale", "Isolines") == [False, False, False, True, True]
    s.want(replace(s.settings, show="illuminance"))
    assert grey(*of_display, "##Scale", "Isolines") == [True, True, True, False, False]
    assert grey("##Time budget") == [not s.scene.mobiles] == [False]


@in_window(lit=False)
def test_all_searches_show_the_same_light(hand, viewer):
    """The section "Disc search": another search gives the same bits in the window."""
    session, ctx = viewer.session, hand.ctx
    hand.press(keys()._1)
    hand.wait_for_light()
    hand.open_research()
    ctx.item_open("Disc search")
    lit, summary = session.irradiance, session.light._solver.frame.search_summary
    assert summary.startswith("disc_index: cells of")
    for search in [*SEARCHES][::-1]:
        ctx.combo_click(f"##Search/{search.replace('_', ' ').capitalize()}")
        hand.wait_for_light()
        assert session.light._solver.setting.search == session.settings.search == search
        assert session.light._solver.frame.search_summary.startswith(search)
        assert np.array_equal(session.irradiance, lit)


def glossy_room():
    room = support.room()
    satin = lobe("ward", {"kd": 0.3, "ks": 0.5, "ax": 0.25, "ay": 0.25})
    return replace(room, materials=(room.materials[0]._replace(brdf=(satin,), scaled=True), *room.materials[1:]))


@in_window(scene=glossy_room)
def test_the_combo_of_gloss_changes_the_rays_of_the_picture(hand, viewer):
    """Cells, list, all rays and cells again: the same photons, other rays, another picture, and no other irradiance."""
    hand.open_research()
    session, pictures, lit = viewer.session, [], viewer.session.irradiance
    for name, way in (("List", LIST), ("QuadTree (all rays)", ALL_RAYS), ("QuadTree (summarised)", QUADTREE)):
        pictures.append(hand.pixels().astype(int))
        hand.ctx.combo_click(f"##Gloss/{name}")
        hand.wait_for_light()
        light = session.light.snapshot.gloss
        assert viewer.session is session and session.settings.gloss == way
        assert (light.tree is None) == (way == QUADTREE) and light.opened == OPENED[way]
        assert light.tree is None or len(light.tree.rays) > 1000
        assert np.array_equal(session.irradiance, lit)
    cells, rays, both = pictures
    again = hand.pixels().astype(int)
    assert (np.abs(rays - cells) > 2).sum() > 0
    assert np.abs(rays - cells).sum() > np.abs(both - rays).sum() > 0
    assert np.array_equal(again, cells)


@in_window()
def test_another_structure_of_rays_opens_the_scene_again(hand, viewer, monkeypatch):
    """The section "Rays": poses and settings stay, and the light is the same but for stray rays."""
    monkeypatch.setattr(compile_ahead, "is_warm", lambda *of: True)  # compiles only the kernels that run
    first, lit = viewer.session, viewer.session.irradiance
    hand.open_research()
    hand.ctx.item_open("Rays")
    hand.ctx.combo_click("##Structure/BVH")
    hand.wait(lambda: viewer.session is not first)
    hand.wait_for_light()
    assert viewer.session.settings == replace(first.settings, rays="bvh")
    assert viewer.session.light._solver.model.accelerator.rays == "bvh"
    np.testing.assert_allclose(viewer.session.irradiance.mean(), lit.mean(), rtol=1e-3)

    # Cells over the picture: of this structure, and the ray under the cursor visits some.
    assert not viewer.painter.ray_cells.text
    hand.ctx.combo_click("##Cells/Ray under the cursor")
    viewport = viewer.viewport
    middle = tuple(o + s / 2 for o, s in zip(viewport.view.origin, viewport.view.size, strict=True))
    viewer.painter.ray_cells.update(viewport, middle)
    hand.ctx.yield_(2)
    found = re.search(r"bvh: ([\d,]+) cells of .* cells on the ray: (\d+)", viewer.painter.ray_cells.text)
    assert found and int(found[2]) > 0


@in_window()
def test_slider_drag_never_delays_a_frame(hand, viewer, monkeypatch):
    """The solver is not configured during a drag of Radius; its steps run outside the window's thread.

    test_session.py measures a frame's waiting time, on a test clock.
    """
    monkeypatch.setattr(session_module, "SETTLE", 60.0)  # on a busy machine every value rests for a moment
    threads, configured = set(), []
    session, ctx = viewer.session, hand.ctx
    solver = session.light._solver
    configure, solve_steps, tick = solver.configure, solver.solve_steps, session.tick

    def watched_steps():
        for progress in solve_steps():
            threads.add(threading.get_ident())
            yield progress

    def watched_tick(*arguments):
        tick(*arguments)
        windows_thread.add(threading.get_ident())

    windows_thread = set()
    hand.open_research()
    solver.configure = lambda **changes: (configured.append(changes), configure(**changes))
    solver.solve_steps, session.tick = watched_steps, watched_tick
    ctx.mouse_move("##Radius")  # scrolls
    info = ctx.item_info("//Panel/##Radius")
    low, high = info.rect_full.min, info.rect_full.max
    y = (low.y + high.y) / 2
    ctx.mouse_move_to_pos((low.x + 40, y))
    ctx.mouse_down(0)
    for k in range(40):
        ctx.mouse_move_to_pos((low.x + 40 + (high.x - low.x - 80) * (k % 20) / 20, y))
    assert configured == [] and threads == set(), "not while it moves"
    ctx.mouse_up(0)
    ctx.yield_(3)
    hand.wait(lambda: not session.refining)
    assert len(configured) == 1 and list(configured[0]) == ["radius"]
    assert session.light._solver.setting.radius == session.settings.radius != support.SETTINGS.radius
    assert threads and not threads & windows_thread


@in_window()
def test_drag_keeps_the_budget_and_panel_shows_its_photons(hand, viewer, monkeypatch):
    """With a budget for the fewest photons, a drag shows the fewest, and rest shows all."""
    monkeypatch.setattr(session_module, "STILL", 60.0)  # a busy machine holds it still for us
    rows = []
    number = widgets.number
    monkeypatch.setattr(
        widgets, "number", lambda label, value, tip: (rows.append((label, value)), number(label, value, tip))
    )
    session, ctx = viewer.session, hand.ctx
    hand.open_research()
    ctx.item_input_value("##Time budget", 20)
    ctx.yield_(2)
    assert session.settings.budget == 20 and session.light.budget == 0.02
    solver = session.light._solver
    few = solver.frame.subsets[-2]
    assert few < support.SETTINGS.photons == solver.frame.subsets[-1]
    solver.budget.within = lambda *_: (few, None)

    at = hand.at(BLOCK_FRONT)
    hand.move(at)
    ctx.mouse_down(0)
    for k in range(1, 4):
        hand.move((at[0] + 15 * k, at[1]))
    hand.wait(lambda: session.light.snapshot.photons == few)
    ctx.yield_(2)
    assert ("Photons shown", f"{few:,} of 8,192") in rows
    monkeypatch.setattr(session_module, "STILL", 0.05)
    hand.wait(lambda: session.light.snapshot.photons == 8_192)
    assert session.motion.dragging, "held still for a while"
    session.light.all_done = False
    hand.wait(lambda: session.light.all_done)  # its pose rests: shadows had the teeth of motion until the release
    monkeypatch.setattr(session_module, "STILL", 60.0)
    hand.move((at[0] + 90, at[1]))
    hand.wait(lambda: session.light.snapshot.photons == few)
    ctx.mouse_up(0)
    hand.wait_for_light()
    assert session.light.snapshot.photons == 8_192 and rows[-1] is not None
    assert hand.light_is_that_from_scratch()
    rows.clear()
    ctx.yield_(2)
    assert ("Photons shown", "8,192 of 8,192") in rows

    # Off: all photons, for any prediction.
    ctx.item_input_value("##Time budget", 101)
    ctx.yield_(2)
    assert session.settings.budget == 0
    at = hand.at(session.poses["block"].position)
    hand.move(at)
    ctx.mouse_down(0)
    for k in range(1, 4):
        hand.move((at[0] - 15 * k, at[1]))
        assert session.light.snapshot.photons == 8_192
    ctx.mouse_up(0)
    ctx.yield_(2)


def test_sections_and_the_research_switch_keep_their_state(play):
    """The method starts hidden; a second window opens as the first one closed."""
    unfolded = {}

    def look(hand, viewer):
        hand.ctx.yield_(2)
        unfolded.update(viewer.folds._unfolded)

    def first(hand, viewer):
        hand.wait_for_light()
        hand.ctx.set_ref("Panel")
        assert hand.ctx.item_exists("##Estimator") and hand.ctx.item_exists("##Quality")
        assert not hand.ctx.item_exists("##Radius") and not hand.ctx.item_exists("Timings")
        hand.open_research()
        look(hand, viewer)
        assert unfolded["Method"] and unfolded["Quality"] and not unfolded["Timings"] and not unfolded["Statistics"]
        assert hand.ctx.item_exists("##Radius") and not hand.ctx.item_exists("##Search")
        hand.ctx.item_click("Method")
        hand.ctx.item_click("Timings")
        look(hand, viewer)
        assert unfolded["Timings"] and not unfolded["Method"]
        assert not hand.ctx.item_exists("##Radius")

    def second(hand, viewer):
        hand.wait_for_light()
        look(hand, viewer)
        assert unfolded["Timings"] and unfolded["Quality"] and not unfolded["Method"] and not unfolded["Statistics"]
        hand.ctx.set_ref("Panel")
        assert hand.ctx.item_exists("Timings")

    assert errors(play(first, keep_ini=True)) == []
    assert errors(play(second, keep_ini=True)) == []


@in_window(measure_errors=True, photons=20_000)
def test_quality_slider_sets_photons_and_budget_and_the_status_line_tells_their_light(hand, viewer, monkeypatch):
    written, draw = [], overlay.draw_status
    monkeypatch.setattr(overlay, "draw_status", lambda *given: (written.append(given[2]), draw(*given)))
    session, ctx = viewer.session, hand.ctx
    ctx.set_ref("Panel")
    assert quality.level_of(session.settings, 20_000) == ("balanced", 2)
    ctx.item_input_value("##Quality", 2)
    hand.wait_for_light()
    assert (session.settings.photons, session.settings.budget) == (5_000, 11)
    assert session.light._solver.frame.photons == 5_000
    hand.wait(lambda: session.light.all_done)
    ctx.yield_(2)
    assert written[-1].startswith("converged, ") and not written[-1].endswith(" frames/s")
    at = hand.at(BLOCK_FRONT)
    hand.move(at)
    ctx.mouse_down(0)
    hand.move((at[0] + 20, at[1]))
    assert written[-1].startswith("in motion")
    ctx.mouse_up(0)


@in_window(problems=None)
def test_long_messages_are_read_whole_and_texts_are_apart(hand, viewer, monkeypatch):
    """The end of a sentence lay outside the window; a legend lay on the progress, a value on its name."""
    plates, rows, draw, number = {}, {}, label.draw, ui.number
    monkeypatch.setattr(label, "draw", lambda text, at, *more: (plates.__setitem__(text, at), draw(text, at, *more)))
    monkeypatch.setattr(view_content, "_coming", lambda *_: "reference: computing")
    hand.press(keys().c)
    problem = "opening: " + "a long sentence about a file " * 20
    viewer.log(problem, "error")
    hand.wait(lambda: viewer.log.entries[-1].text in plates)
    left, top, right, bottom = plates[viewer.log.entries[-1].text]
    (x, y), (w, h) = viewer.viewport.view.origin, viewer.viewport.view.size
    assert x <= left < right <= x + w and y <= top < bottom <= y + h
    hand.wait(lambda: {"path traced", "reference: computing"} <= set(plates))
    assert plates["reference: computing"][3] <= plates[view_content.RECOMPUTED_NAMES[0]][1]

    def measured(name, value, about):
        wide = name == "Costs per move"
        number(name, "9 " * 60 if wide else value, about)
        rows[name] = imgui.get_item_rect_size().y

    monkeypatch.setattr(ui, "number", measured)
    hand.wait(lambda: "Error at rest" in rows)
    assert rows["Costs per move"] > 1.8 * rows["Error at rest"], "below its name"


@in_window()
def test_the_tooltips_of_the_exposure_say_what_key_a_does(hand, viewer, monkeypatch):
    """They spoke of the metering at load, where the file may give the exposure."""
    tips, explained = [], ui.explained
    monkeypatch.setattr(ui, "explained", lambda text: (tips.append(text), explained(text))[1])
    hand.panel("Objects", "Lamps")
    for item, words in (("##Exposure", "metered by key A"), ("Meter exposure", "by the present view and light")):
        hand.ctx.mouse_move(item)
        hand.wait(lambda: any(words in tip for tip in tips))  # noqa: B023
    assert not any("at load" in tip for tip in tips)


@in_window(light="photons")
def test_typed_numbers_are_read_as_options_are(hand, viewer):
    """1e6 and 1,800,000, as the panel writes it, were one photon; an exposure of 500 saved a file that no one opens."""
    session, ctx = viewer.session, hand.ctx
    hand.open_research()

    def typed(item: str, text: str):
        ctx.item_input_value(f"##{item}", text)
        ctx.yield_(2)
        return session.settings

    assert typed("Photons", "12,000").photons == 12_000 and typed("Photons", "1.5e4").photons == 15_000
    assert typed("Photons", "few").photons == typed("Photons", "1e99").photons == 15_000
    assert typed("Radius", "0,15").radius == typed("Radius", "-3").radius == 0.15
    assert typed("Neighbours k", "1e9").neighbours == session.chosen.neighbours
    exposure = session.settings.exposure
    assert typed("Exposure", "500").exposure == exposure and typed("Exposure", "-1.5").exposure == -1.5
    assert typed("Time budget", "-5").budget == 8.0
    hand.wait_for_light()
    assert session.light.snapshot.photons == 15_000
