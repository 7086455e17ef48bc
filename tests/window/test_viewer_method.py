"""The method made visible in the window: one key each, off by default."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from app.session import method_view
from app.window.view_content import RECOMPUTED
from tests.support import viewer_support as support
from tests.support.viewer_hand import BLOCK_FRONT, errors, keys

pytest_plugins = ["tests.support.viewer_fixtures"]
pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("gl", "folder")]


def test_paths_disc_and_colours_follow_keys_cursor_and_drags(play, monkeypatch):
    threads, view = set(), method_view.method_view
    monkeypatch.setattr(
        method_view, "method_view", lambda *given: (threads.add(threading.current_thread().name), view(*given))[1]
    )

    def script(hand, viewer):
        hand.wait_for_light()
        light, K = viewer.session.light, keys()
        hand.wait(lambda: light.all_done)
        assert light.method is None, "off by default"
        hand.press(K.v)
        hand.wait(lambda: light.method is not None and light.method.paths is not None)
        assert set(light.method.paths.kind.tolist()) == {method_view.KEPT, method_view.REMOVED, method_view.ADDED}
        hand.press(K.v)
        hand.wait(lambda: light.method is None)

        hand.press(K.n)
        for place in ((0.5, 0.0, 0.75), (0.3, 0.0, 0.8)):
            hand.move(hand.at(place))
            hand.wait(lambda: light.method is not None and light.method.counted is not None
                      and light.method.parts.receiver == viewer.session.receiver >= 0)  # fmt: skip
            assert np.linalg.norm(light.method.counted.position - place) < 0.13, "the receiver under the cursor"
            assert light.method.counted.normal == pytest.approx((0, 1, 0))
        hand.press(K.n)

        hand.press(K.c)
        hand.drag(hand.at(BLOCK_FRONT), [c + 40 for c in hand.at(BLOCK_FRONT)])
        hand.wait(lambda: viewer.viewport.shown.recomputed is not None)
        kinds = viewer.viewport.shown.recomputed
        assert {method_view.BACKGROUND, method_view.CHANGED} <= set(kinds.tolist())
        hand.ctx.yield_(30)
        picture = hand.pixels().reshape(-1, 3).astype(int)
        for kind in (method_view.BACKGROUND, method_view.CHANGED):
            colour = np.round(255 * np.array(RECOMPUTED[kind]))
            assert (np.abs(picture - colour).max(axis=1) <= 3).mean() > 0.02
        hand.press(K.c)
        hand.wait(lambda: light.method is None and viewer.viewport.shown.recomputed is None)
        assert hand.light_is_that_from_scratch()
        assert threads == {"solver"}

    assert errors(play(script, replace(support.SETTINGS, photons=2_000), support.opening(support.room(24)))) == []
