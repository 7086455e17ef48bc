"""The first look at a scene, drawn in the window while kernels compile."""

import threading

import numpy as np

from app.session.first_look import looks
from app.session.opening import Opening
from tests.support import viewer_support as support
from tests.support.viewer_hand import errors


def test_the_window_shows_looks_until_the_scene_is_open(play):
    """Without light, then lit."""
    room, may_open, pictures = support.room(), threading.Event(), []

    def slow(settings):
        assert may_open.wait(support.PATIENCE)
        return room

    def script(hand, viewer):
        opening, some = viewer.session.opening, list(looks(room, support.SETTINGS))
        assert len(some) == 3
        for look in some:
            opening.look = look
            hand.wait(lambda look=look: viewer.painter.look is look)
            hand.ctx.yield_(2)
            pictures.append(hand.pixels().astype(float))
        may_open.set()
        hand.wait_for_light()

    assert errors(play(script, open_with=lambda s: Opening(s, load=slow))) == []
    unlit, first, second = pictures
    assert unlit.std() > 5, "a picture"
    assert np.abs(first - unlit).mean() > 5, "light"
    assert np.abs(second - first).mean() < 5, "the same light with less noise"
