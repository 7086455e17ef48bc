"""Pictures saved from the window show pins and surfaces, where the window shows them."""

import numpy as np
from PIL import Image

from app.draw.legend import LINE, Dot, Label, Marks, with_marks
from app.settings import Pin
from app.window import readout_marks
from app.window.view_content import RECOMPUTED, RECOMPUTED_NAMES
from tests.support.viewer_hand import in_window, keys


def test_marks_are_drawn_where_they_are_at_any_scale():
    grey = np.full((100, 160, 3), 128, np.uint8)
    marks = Marks(16.0, [((0.0, 90.0), (160.0, 90.0))], [Dot((30.0, 40.0), (1.0, 0.0, 0.0), 1.0)],
                  [Label("12", (60.0, 30.0, 100.0, 50.0), 1.0)])  # fmt: skip
    for scale in (1, 2):
        drawn = with_marks(np.repeat(np.repeat(grey, scale, axis=0), scale, axis=1), marks, scale)
        assert drawn.shape == (100 * scale, 160 * scale, 3)
        assert tuple(drawn[40 * scale, 30 * scale]) == (255, 0, 0)
        assert drawn[32 * scale, 65 * scale].max() < 60, "the plate"
        assert drawn[30 * scale : 50 * scale, 60 * scale : 100 * scale].max() > 200, "its text"
        assert abs(drawn[90 * scale, 10 * scale, 0] / 255 - LINE[0]) < 0.06
        assert (drawn[60 * scale : 80 * scale] == 128).all()
    assert (with_marks(grey, Marks(16.0, [], [], []), 1.0) == grey).all()


def test_units_are_written_in_letters_that_the_font_has():
    grey = np.full((40, 120, 3), 128, np.uint8)
    one, other = (
        with_marks(grey, Marks(16.0, [], [], [Label(f"2 W/m{two}", (5.0, 5.0, 115.0, 35.0), 1.0)]), 1.0) for two in "²2"
    )
    assert (one == other).all()


@in_window(pins=(Pin("floor", (0.5, 0.0, 0.9), (0.0, 1.0, 0.0)),))
def test_a_saved_picture_shows_its_pins(hand, viewer, folder):
    hand.wait(lambda: viewer.viewport.pins.shown)
    hand.ctx.mouse_move_to_pos((2, 2))
    before = hand.pixels()
    hand.press(keys().p)
    hand.wait(lambda: (folder / "gi-viewer-001.png").exists())
    saved = np.asarray(Image.open(folder / "gi-viewer-001.png").convert("RGB")).astype(int)
    factor = viewer.painter.renderer.size[1] / viewer.viewport.view.size[1]
    (dot,), (label,) = readout_marks.marks(viewer.viewport)[2:]
    x, y = (round(factor * c) for c in dot.at)
    assert np.abs(saved[y, x] - 255 * np.array(dot.colour)).max() < 3
    left, top, right, bottom = (round(factor * side) for side in label.box)
    plate = slice(top, bottom), slice(left, right)
    assert saved[plate].max() > 200 and np.median(saved[plate]) < 0.6 * np.median(before[plate])
    assert label.text.startswith("floor: ")


@in_window()
def test_a_saved_picture_names_its_colours(hand, viewer, folder):
    """The window named the colours of receivers, the saved picture did not."""
    hand.wait_for_light()
    hand.press(keys().c)
    hand.wait(lambda: viewer.viewport.shown.recomputed is not None)
    hand.press(keys().p)
    hand.wait(lambda: (folder / "gi-viewer-001.png").exists())
    saved = np.asarray(Image.open(folder / "gi-viewer-001.png").convert("RGB")).astype(int)
    factor = viewer.painter.renderer.size[1] / viewer.viewport.view.size[1]
    labels = readout_marks.marks(viewer.viewport).labels
    assert [label.text for label in labels] == list(RECOMPUTED_NAMES)
    for label, colour in zip(labels, RECOMPUTED, strict=True):
        left, top, right, bottom = (round(factor * side) for side in label.box)
        plate = saved[top:bottom, left:right].reshape(-1, 3)
        assert np.abs(plate - 255 * np.array(colour)).max(axis=1).min() < 40 and np.median(plate) < 60


def test_a_plate_between_pixels_is_even():
    """Pillow drew its corners twice: dark streaks at the end of each plate."""
    grey = np.full((40, 120, 3), 128, np.uint8)
    drawn = with_marks(grey, Marks(16.0, [], [], [Label("1", (20.3, 9.6, 99.4, 31.7), 1.0)]), 1.0)
    plate = drawn[10:32, 22:50]
    assert len(np.unique(plate[4:-4].reshape(-1, 3), axis=0)) == 1
    assert len(np.unique(drawn.reshape(-1, 3)[:, 0][drawn.reshape(-1, 3)[:, 0] < 128])) < 12
