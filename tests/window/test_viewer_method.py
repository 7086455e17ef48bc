"""The method made visible in the window: one key each, off by default."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from imgui_bundle import imgui

from app.session import method_view, solver_jobs
from app.window import label, method_marks
from app.window.view_content import RECOMPUTED
from gi_core.scene.types import Gloss, Material
from tests.support import viewer_support as support
from tests.support.viewer_hand import BLOCK_FRONT, in_window, keys


@in_window(scene=lambda: support.room(24), photons=2000)
def test_paths_disc_and_colours_follow_keys_cursor_and_drags(hand, viewer, monkeypatch):
    threads, view = set(), method_view.method_view
    monkeypatch.setattr(
        solver_jobs, "method_view", lambda *given: (threads.add(threading.current_thread().name), view(*given))[1]
    )
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


GLOSSY = replace(
    support.room(24), materials=(Material("white", (0.5,) * 3, gloss=Gloss(alpha=0.3)), *support.room(24).materials[1:])
)


@in_window(scene=lambda: GLOSSY, photons=2000, gloss="list")
def test_a_click_holds_a_receiver_and_its_hemisphere(hand, viewer, few_kernels, monkeypatch):
    """While the camera orbits, the block is dragged and the cursor is elsewhere; the mark of the eye follows."""
    written, write = {}, label.write

    def noted(text, x, y, *more, **options):
        written[text] = x, y
        write(text, x, y, *more, **options)

    monkeypatch.setattr(label, "write", noted)

    def eye_of(viewer):
        """Where the eye's mark has to be: the equal-area map of its direction in the receiver's frame, lower left."""
        view, viewport = viewer.session.light.method.hemisphere, viewer.viewport
        x, y, z = view.frame @ (viewport.view.camera.eye() - viewer.session.model.origins[0] - view.position)
        size = np.sqrt(x * x + y * y + z * z)
        r, em = np.sqrt(1 - z / size), imgui.get_font_size()
        radius = method_marks.RADIUS_EM * em
        left, bottom = viewport.view.origin[0], viewport.view.origin[1] + viewport.view.size[1]
        middle = left + 1.5 * em + radius, bottom - 4.0 * em - radius
        flat = max(np.hypot(x, y), 1e-9)
        return middle[0] + radius * r * x / flat + 0.5 * em, middle[1] - radius * r * y / flat - 0.5 * em

    light, K, floor = viewer.session.light, keys(), (0.3, 0.0, 0.8)
    hand.wait(lambda: light.all_done)
    hand.press(K.n)
    hand.move(hand.at(floor))
    hand.wait(lambda: light.method is not None and light.method.hemisphere is not None)
    assert method_marks.FOLLOWS in written
    hand.ctx.mouse_click(0)
    held = viewer.session.receiver
    hand.wait(lambda: light.method.parts.receiver == viewer.session.held_receiver == held >= 0)
    hand.ctx.yield_(2)
    assert method_marks.HELD in written
    first = written["eye"]
    assert first == pytest.approx(eye_of(viewer), abs=0.5)

    hand.drag(hand.at((0.05, 0.8, 0.3)), [c + 60 for c in hand.at((0.05, 0.8, 0.3))])
    hand.drag(hand.at(BLOCK_FRONT), [c + 40 for c in hand.at(BLOCK_FRONT)])
    hand.wait(lambda: light.all_done and light.method.irradiance is viewer.session.irradiance)
    hand.ctx.yield_(2)
    view = light.method.hemisphere
    assert viewer.session.held_receiver == light.method.parts.receiver == held != viewer.session.receiver
    assert np.linalg.norm(view.position - floor) < 0.13 and view.cells[:, :3].any()
    assert written["eye"] == pytest.approx(eye_of(viewer), abs=0.5) != pytest.approx(first, abs=3)

    hand.click(floor)
    hand.move(hand.at((0.7, 0.0, 0.9)))
    hand.wait(lambda: light.method.parts.receiver == viewer.session.receiver != held)
    assert viewer.session.held_receiver == -1
    hand.ctx.mouse_click(0)
    assert viewer.session.held_receiver >= 0
    hand.press(K.n)
    assert viewer.session.held_receiver == -1
    assert hand.light_is_that_from_scratch()
