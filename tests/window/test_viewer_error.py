"""Errors in the window: numbers, map and legend, the reference by a key, the chart."""

from dataclasses import replace

import numpy as np
import pytest

from app.draw.colour_map import signed_colours
from app.rest import live_error
from app.rest.results import MeasuredPoint
from app.settings import LampLevel
from app.window import legend, view_content
from app.window.panel import chart
from app.window.panel.chart import caption, limits
from gi_core.estimators.base import Setting
from gi_core.files.edits import Finish, Remove
from gi_core.geometry.error import luminance
from gi_core.scene.types import CalculationSurface
from tests.support import viewer_support as support
from tests.support.viewer_hand import in_window, keys

MEASURED = replace(support.SETTINGS, measure_errors=True, size=(960, 640))


@pytest.fixture(autouse=True)
def rough_reference(monkeypatch):
    """References of 4 % noise: the tests compare pictures of it with themselves."""
    monkeypatch.setattr(live_error, "PICTURE_NOISE", 0.04)
    monkeypatch.setattr(live_error, "NOISE_OF_ERROR", 0.5)


def report(viewer):
    return viewer.session.light.snapshot.rest.report


def shown(viewer):
    return viewer.viewport.shown


@in_window(settings=MEASURED)
def test_error_is_measured_at_rest_and_mapped_with_a_legend(hand, viewer, monkeypatch):
    words, texts = [], legend.texts
    monkeypatch.setattr(legend, "texts", lambda e: (words.append(texts(e)), texts(e))[1])
    hand.wait(lambda: report(viewer) is not None and report(viewer).done)
    r = report(viewer)
    assert 0.01 < r.total < 0.5 and r.receivers == r.of
    light = hand.pixels()
    hand.ctx.set_ref("Panel")
    hand.ctx.combo_click("##Show/Error map")
    hand.wait(lambda: shown(viewer).errors is not None and not shown(viewer).coming)
    errors_of = viewer.session.light._work.live_error
    tasks, errors_of.tasks = errors_of.tasks, lambda: ()  # or the map would keep improving
    hand.wait(lambda: viewer.session.light.all_done)  # also the task under way, which may improve it
    picture = hand.pixels()
    assert words and words[-1][0] == "Error of irradiance" and (picture != light).any()
    # Vertices have colours of the map at any exposure. A pixel is up to half a pixel off its vertex, and colours
    # between vertices are interpolated: 0 or 1 of 255 at most vertices, 8 at the worst of 49.
    palette = np.round(255 * signed_colours(np.linspace(-1, 1, 2001))).astype(int)
    wall = [hand.at((i / 8, j / 8, 0.0)) for i in range(1, 8) for j in range(1, 8)]
    seen = np.array(
        [picture[int(y - viewer.viewport.view.origin[1]), int(x - viewer.viewport.view.origin[0])] for x, y in wall]
    )
    off = np.abs(palette - seen[:, None].astype(int)).max(axis=2).min(axis=1)
    assert np.median(off) <= 2 and off.max() <= 12, off
    hand.ctx.item_input_value("##Exposure", viewer.session.settings.exposure - 3)
    assert (np.abs(hand.pixels().astype(int) - picture).max(axis=2) > 8).mean() < 0.01, "but at edges, by its samples"
    hand.ctx.combo_click("##Scale/\N{PLUS-MINUS SIGN}10 %")
    hand.wait(lambda: shown(viewer).errors.scale == 0.1)
    errors_of.tasks = tasks
    hand.ctx.combo_click("##Show/Picture")

    # It disappears with a move, and returns.
    hand.press(keys().space)
    hand.wait(lambda: viewer.session.poses["block"].position[0] != 0.5)
    hand.press(keys().space)
    hand.wait(lambda: report(viewer) is not None and report(viewer).done)


@in_window(settings=MEASURED, photons=20_000)
def test_reference_key(hand, viewer):
    K, settings = keys(), lambda: viewer.session.settings
    estimate = hand.pixels()
    hand.press(K._0)
    hand.wait(lambda: shown(viewer).side.label.startswith("Reference"))
    reference = hand.pixels()
    assert (np.abs(reference.astype(int) - estimate).max(axis=2) > 4).mean() > 0.05
    hand.press(K._0)
    hand.wait(lambda: not settings().reference and shown(viewer).side.label.startswith("Tangent plane"))
    assert (hand.pixels() == estimate).all()


@in_window(settings=MEASURED)
def test_settings_tried_are_points_of_the_chart(hand, viewer, monkeypatch):
    asked = []
    monkeypatch.setattr(chart, "caption", lambda point: (asked.append(point), "a point")[1])
    points = viewer.session.points
    hand.open_research()
    hand.wait(lambda: len(points.all) == 1)
    hand.press(keys()._3)
    hand.wait(lambda: len(points.all) == 2)
    hand.ctx.item_click("Error against time")
    assert {t.setting.estimator for t in points.all} == {"tangent_plane", "impact_count"}
    hand.wait(lambda: report(viewer).done)
    hand.ctx.yield_(3)
    # A hovered point has a tooltip.
    spots = []
    monkeypatch.setattr(chart, "_draw_latest", lambda t: spots.append(chart.pixel_of(t)))
    hand.wait(lambda: len(spots) > 10)
    hand.move((spots[-1].x, spots[-1].y))
    hand.wait(lambda: asked)
    assert asked[-1].setting == points.all[-1].setting
    hand.ctx.item_click("Clear chart")
    hand.wait(lambda: not points.all)


def test_caption_and_limits_of_a_point():
    text = caption(MeasuredPoint(Setting("photon_map", 0.05, 40), 20_000, 0.0123, 0.0456, 0.004))
    assert text.startswith("photon map\n20,000 photons\nradius 0.05 m\nneighbours 40")
    assert text.endswith("error 4.6 % (reference noise ±0.4 %)\nGI frame 12.3 ms")
    low, high = limits([2.0, 50.0])
    assert 0 < low < 2 and high > 50


def test_a_change_below_two_standard_errors_is_grey():
    before, now = np.array([10.0, 10.0, 10.0, 10.0, np.nan]), np.array([11.9, 12.1, 7.0, 20.0, 1.0])
    change = view_content.certain_change(now, before, np.array([1.0, 1.0, 1.0, np.nan, 1.0]))
    assert change[:3] == pytest.approx([0.0, 2.1, -3.0]) and np.isnan(change[3:]).all()


@in_window(light="best")
def test_changes_since_a_kept_light_are_mapped(hand, viewer, rough_light):
    from tests.window.test_viewer_edits import RED, change

    ctx, E = hand.ctx, lambda: luminance(viewer.session.light.snapshot.irradiance)
    viewer.session.edit(surfaces=(CalculationSurface("plane", height=0.1),))
    hand.wait(lambda: viewer.session.light.all_done)
    ctx.set_ref("Panel")
    ctx.combo_click("##Show/Change since A")
    hand.wait(lambda: "Keep as A" in shown(viewer).coming)
    assert shown(viewer).errors is None and viewer.viewport.legend is None
    hand.wait(lambda: viewer.session.light.all_done)  # light kept before would improve
    ctx.item_click("**/Keep as A")
    hand.wait(lambda: shown(viewer).errors is not None)
    assert not shown(viewer).coming and not np.nan_to_num(shown(viewer).errors.values).any(), "the same light"
    before, deviation = E(), viewer.session.light.snapshot.deviation

    name = viewer.session.model.emitters.lamps.names[0]
    viewer.session.want(replace(viewer.session.settings, lamps=(LampLevel(name, 0.5),)))
    hand.wait_for_light()
    hand.wait(lambda: shown(viewer).errors is not None and np.nan_to_num(shown(viewer).errors.values).any())
    hand.wait(lambda: viewer.session.light.all_done and viewer.painter.uploaded == viewer.session.version)
    A, now, _ = viewer.session.light.snapshot.rest.change  # of the same photons
    values, change_now = shown(viewer).errors.values, luminance(now) - luminance(A)
    lit = np.isfinite(values) & (before > 6 * deviation)
    coloured = lit & (values != 0)  # the others are grey: not certain
    assert values[coloured] == pytest.approx(change_now[coloured]) and coloured.sum() > 0.95 * lit.sum()
    assert values[coloured].max() < 0 and lit.mean() > 0.5
    assert viewer.viewport.legend.lines[0] == "Change since A [W/m²]"
    low, high = (min(viewer.viewport.legend.ticks)[1], max(viewer.viewport.legend.ticks)[1])
    assert low.startswith("\N{MINUS SIGN}") and low.endswith(" or less") and high.endswith(" or more")
    hand.move(hand.at((0.2, 0.8, 0.0)))
    reading = viewer.viewport.pointer.reading
    A, error = reading.before
    assert reading.irradiance == pytest.approx(0.5 * A, rel=0.02) and 0 < error < 0.1 * A
    assert f"light A {A:.3g}, change {reading.irradiance - A:+.3g} ± " in viewer.viewport.readout()
    pointer, drawn = viewer.viewport.pointer, viewer.viewport.shown
    for content, has_A in ((drawn, True), (drawn._replace(errors=None), False)):  # the mouse rests
        pointer.update(viewer.session, viewer.viewport.view, content)
        assert (pointer.reading.before is not None) == has_A, "light is drawn after its version is known"
    (of_A,) = viewer.session.kept.surfaces
    dimmed = pytest.approx(0.5 * of_A.numbers.mean[0], rel=0.02)
    hand.wait(lambda: [s.numbers.mean[0] for s in viewer.session.light.snapshot.rest.surfaces] == [dimmed])

    # An object casts its shadow elsewhere: where nothing changes by more than noise, grey.
    viewer.session.want(replace(viewer.session.settings, lamps=()))
    hand.wait_for_light()
    viewer.session.move({"block": viewer.session.poses["block"]._replace(position=(0.3, 0.0, 0.3))})
    hand.ctx.yield_(3)
    hand.wait(lambda: viewer.session.light.all_done and viewer.painter.uploaded == viewer.session.version)
    values, (A, now, error) = shown(viewer).errors.values, viewer.session.light.snapshot.rest.change
    change_now, known = luminance(now) - luminance(A), np.isfinite(error)
    certain = (np.abs(change_now) >= 2 * error) & (change_now != 0)
    assert np.array_equal(values[known] != 0, certain[known]) and 0 < certain[known].mean() < 0.9
    assert np.isnan(values[~known]).all() and values[known & certain] == pytest.approx(change_now[known & certain])
    both = np.hypot(deviation, viewer.session.light.snapshot.deviation)
    assert (error < both)[known].mean() > 0.6, "static light is the same in both"

    # A material keeps the surfaces, a further object does not.
    change(hand, viewer, lambda: viewer.session.change_scene(Finish("white", (("reflectance", RED),))))
    assert viewer.session.kept is not None and viewer.session.light.snapshot.rest.change is None
    change(hand, viewer, lambda: viewer.session.change_scene(Remove("block")))
    assert viewer.session.kept is None and any("light A is dropped" in e.text for e in viewer.log.entries)
