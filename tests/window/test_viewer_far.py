"""A scene far from the origin in the window: the picture, drag and saved coordinates."""

from pathlib import Path

import numpy as np
from PIL import Image

from gi_core.scene.origin import translated
from tests.support import viewer_support as support
from tests.support.viewer_hand import BLOCK_FRONT, errors, keys

AWAY = (1000.0, 0.0, 0.0), (500_000.0, -4_650_000.0, 250.0)  # [m]


def test_far_scenes_look_and_move_like_the_one_at_the_origin(play):
    pictures, moved, cameras = [], [], []

    def script(hand, viewer):
        hand.wait_for_light()
        session = viewer.session
        shown = [hand.pixels()]
        start, (x, y) = session.poses["block"], hand.at(np.add(BLOCK_FRONT, away))
        hand.drag((x, y), (x + 90, y - 8))
        hand.wait_for_light()
        assert hand.light_is_that_from_scratch()
        hand.move((5, 5))  # no outline
        hand.wait(lambda: viewer.painter.is_done)  # drawn with all samples
        shown.append(hand.pixels())
        pictures.append(shown)
        moved.append(np.subtract(session.poses["block"].position, start.position))
        assert np.allclose(start.position, np.add((0.5, 0.3, 0.5), away), rtol=0, atol=1e-9)
        hand.press(keys().p)
        hand.wait(lambda: list(Path.cwd().glob("*.png")))
        (file,) = Path.cwd().glob("*.png")
        with Image.open(file) as picture:
            entries = picture.text
        file.unlink()
        position = entries["camera"].removeprefix("position ").split()[0]
        written = [[float(c) for c in place.split(",")[:3]] for place in (position, entries["pose block"])]
        assert np.allclose(written[1], session.poses["block"].position, rtol=1e-12)
        cameras.append(written[0])

    for away in ((0.0, 0.0, 0.0), *AWAY):
        assert errors(play(script, open_with=support.opening(translated(support.room(), np.array(away))))) == []
    assert np.linalg.norm(moved[0]) > 0.1
    for k, away in enumerate(AWAY, 1):
        assert np.allclose(moved[k], moved[0], atol=1e-6)
        assert np.allclose(cameras[k], np.add(cameras[0], away), rtol=0, atol=1e-6)
        for near, far in zip(pictures[0], pictures[k], strict=True):
            assert np.abs(near.astype(int) - far).max() <= 4, "of 255; far coordinates are rounded to 1e-9 m"
