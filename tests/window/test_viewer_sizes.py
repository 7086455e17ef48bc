"""Small windows: nothing is cut off, nothing overlaps."""

from dataclasses import replace

import pytest
from imgui_bundle import imgui

from app.settings import Pin
from app.window import label, legend
from app.window.label import SLACK
from tests.support import viewer_support as support
from tests.support.viewer_hand import BLOCK_FRONT, errors, in_window, keys

SMALL = replace(support.SETTINGS, size=(640, 480))


@in_window(settings=SMALL)
def test_help_shows_its_texts_whole_in_a_small_window(hand, viewer, monkeypatch):
    cut, seen = set(), set()

    def noting(write):
        def noted(text):
            write(text)
            if not imgui.internal.get_current_window().name.startswith("Help"):
                return
            seen.add(text)
            if imgui.get_item_rect_max().x > imgui.get_window_draw_list().get_clip_rect_max().x + 1:
                cut.add(text)

        return noted

    for name in ("text", "text_disabled", "text_wrapped"):
        monkeypatch.setattr(imgui, name, noting(getattr(imgui, name)))
    hand.press(keys().h)
    hand.ctx.yield_(5)
    seen.clear()
    cut.clear()  # the size is known from the second frame on
    hand.ctx.yield_(5)
    assert seen >= {"Right drag empty space", "save the scene with its poses and settings"}
    assert not cut
    window = hand.ctx.get_window_by_ref("//Help###Help")
    assert window.pos.x >= 0 and window.pos.x + window.size.x <= 640
    assert window.pos.y >= 0 and window.pos.y + window.size.y <= 480
    assert window.scrollbar_y, "the rest is reached by scrolling"


@in_window(settings=SMALL)
def test_a_narrow_window_starts_without_the_panel_and_tab_shows_it(hand, viewer):
    view = viewer.viewport.view
    assert view.size[0] == 640
    for width in (288, 640, 288):
        hand.press(keys().tab)
        hand.ctx.yield_(5)
        assert view.size[0] == pytest.approx(width, abs=3)
    hand.ctx.set_ref("Panel")
    hand.ctx.item_click("Reset poses")


def test_the_interface_size_is_kept_from_one_start_to_the_next(play):
    sizes = []

    def choose(hand, viewer):
        hand.wait_for_light()
        sizes.append(imgui.get_font_size())
        hand.ctx.set_ref("##MainMenuBar")
        hand.ctx.menu_click("View/Interface size/150 %")
        hand.ctx.yield_(3)
        sizes.append(imgui.get_font_size())

    def look(hand, viewer):
        hand.wait_for_light()
        sizes.append(imgui.get_font_size())

    assert errors(play(choose, keep_ini=True)) == [] and errors(play(look, keep_ini=True)) == []
    assert sizes[1] == pytest.approx(1.5 * sizes[0]) and sizes[2] == sizes[1]


def test_labels_of_pins_keep_clear_of_the_legend_and_of_each_other(play, monkeypatch):
    written = {}

    monkeypatch.setattr(label, "draw", lambda text, at, *_, **__: written.update({text: at}))
    floor = [(x, 0.0, z) for x in (0.1, 0.5, 0.9) for z in (0.2, 0.8)]
    back = [(x, y, 0.0) for x in (0.1, 0.9) for y in (0.2, 0.5)]
    pins = (
        *(Pin(f"floor {k}", at, (0.0, 1.0, 0.0)) for k, at in enumerate(floor)),
        *(Pin(f"wall {k}", at, (0.0, 0.0, 1.0)) for k, at in enumerate(back)),
    )

    def script(hand, viewer):
        hand.wait_for_light()
        hand.wait(lambda: viewer.viewport.legend is not None)
        written.clear()
        hand.ctx.yield_(3)
        view = viewer.viewport.view
        boxes = {name: box for name, box in written.items() if name.startswith(("floor", "wall"))}
        assert len(boxes) >= 6, "nearly all have room"
        boxes["legend"] = legend.box(viewer.viewport.legend, view)
        (x, y), (w, h) = view.origin, view.size
        for name, (left, top, right, bottom) in boxes.items():
            assert left >= x and top >= y and right <= x + w and bottom <= y + h, name
        for a, one in boxes.items():
            for b, other in boxes.items():
                across = min(one[2], other[2]) - max(one[0], other[0])
                down = min(one[3], other[3]) - max(one[1], other[1])
                apart = min(across, down) <= 2 * SLACK
                assert a == b or apart, (a, b)

    settings = replace(SMALL, show="illuminance", pins=pins)
    assert errors(play(script, settings)) == []


@in_window(settings=replace(SMALL, show="illuminance"))
def test_labels_wrap_inside_a_small_picture(hand, viewer, monkeypatch):
    boxes, box = {}, label.box

    def noted(text, *more, **named):
        boxes[text] = box(text, *more, **named)
        return boxes[text]

    monkeypatch.setattr(label, "box", noted)
    hand.wait(lambda: viewer.viewport.legend is not None)
    view = viewer.viewport.view
    boxes.clear()
    hand.move(hand.at(BLOCK_FRONT))
    hint = viewer.viewport.hint()
    assert "Ctrl: turn" in hint and hint in boxes
    left, top, right, bottom = boxes[hint]
    (x, y), (w, h) = view.origin, view.size
    assert left >= x and top >= y and right <= x + w and bottom <= y + h
    one, legend_left = label.plate("Drag")[1], legend.box(viewer.viewport.legend, view)[0]
    assert right <= legend_left and bottom - top > 1.5 * one, "in several lines beside the legend"
