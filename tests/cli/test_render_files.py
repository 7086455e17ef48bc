"""`render`: parameters in its files, frames along a path, and the path itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app.commands import render
from app.commands.render import numbered
from app.draw import motion
from app.draw.png import write_png
from app.settings import Settings, make_solver
from gi_core.scene import KeyFrames
from tests.support.viewer_support import room

SMALL = Settings(photons=4000, radius=0.06, size=(96, 72))


# Files ----------------------------------------------------------------------------------------------


@pytest.fixture
def room_instead_of_a_file(monkeypatch):
    monkeypatch.setattr(render, "open_scene", lambda settings: room())


def test_picture_carries_its_parameters(tmp_path, room_instead_of_a_file):
    (path,) = render.render(SMALL, tmp_path / "a.png")
    entries = Image.open(path).text
    assert path == (tmp_path / "a.png").resolve() and Image.open(path).size == (96, 72)
    assert entries["photons"] == "4000" and entries["seed"] == "0" and entries["estimator"] == "tangent_plane"
    assert entries["exposure"].endswith(" EV") and entries["pose block"].startswith("0.5,0.3,0.5,1,")


def test_frames_follow_the_path_at_one_exposure(tmp_path, room_instead_of_a_file):
    paths = render.render(SMALL, tmp_path / "a.png", frames=3)
    assert [p.name for p in paths] == ["a.0001.png", "a.0002.png", "a.0003.png"]
    entries = [Image.open(p).text for p in paths]
    assert [e["pose block"].split(",")[0] for e in entries] == ["0.3", "0.5", "0.7"]
    assert len({e["exposure"] for e in entries}) == 1
    pictures = [np.array(Image.open(p)).astype(int) for p in paths]
    assert (np.abs(pictures[0] - pictures[2]).max(axis=2) > 30).mean() > 0.02


def test_the_same_command_gives_the_same_bytes(tmp_path, room_instead_of_a_file):
    (a,) = render.render(SMALL, tmp_path / "a.png")
    (b,) = render.render(SMALL, tmp_path / "b.png")
    assert a.read_bytes() == b.read_bytes()


def test_png_text_survives_any_value(tmp_path):
    entries = {"scene": "Küche 厨房.glb", "n": 3, "pose 壶": "0,0,0", 99 * "k": "long"}
    path = write_png(tmp_path / "x.png", np.zeros((2, 3, 3), np.uint8), entries)
    read = {"scene": "Küche \\u53a8\\u623f.glb", "n": "3", "pose \\u58f6": "0,0,0", 79 * "k": "long"}
    assert Image.open(path).text == read
    assert not list(tmp_path.glob("*.part"))


def test_numbered_names():
    assert str(numbered(render.Path("out") / "a.b.png", 12)).replace("\\", "/") == "out/a.b.0012.png"


# Motion ---------------------------------------------------------------------------------------------


def path_of(points) -> KeyFrames:
    points = np.array(points, float)
    return KeyFrames(np.arange(float(len(points))) ** 1.5, points, np.tile([1.0, 0, 0, 0], (len(points), 1)))


@pytest.mark.parametrize("frames", [3, 40])
@pytest.mark.parametrize("closed", [False, True])
def test_walk_has_the_same_step_for_any_number_of_frames(frames, closed):
    """Uneven times, straight and there-and-back paths: only at corners and turning points is a step shorter."""
    points = [[0, 0, 0], [1, 0, 0], [3, 0, 0]] + ([[0, 0, 0]] if closed else [])
    walk = motion.walk({"m": path_of(points)}, 0.1, frames)
    gone = np.array([p["m"].position for p in walk])
    steps = np.sqrt((np.diff(gone, axis=0) ** 2).sum(axis=1))
    assert len(walk) == frames and steps.max() < 0.1 + 1e-9
    assert (np.abs(steps - 0.1) < 1e-6).mean() > 0.9


def test_a_mobile_without_a_path_goes_round_a_circle_at_its_height():
    scene = room()
    bare = replace(scene, mobiles=(scene.mobiles[0]._replace(path=None),))
    solver = make_solver(bare, SMALL)
    walk = motion.walk(motion.paths_of(solver), 0.015 * solver.scene_size, 50)
    p = np.array([poses["block"].position for poses in walk])
    np.testing.assert_allclose(p[:, 1], 0.3, atol=1e-9)
    assert np.ptp(np.hypot(p[:, 0] - 0.5, p[:, 2] - 0.5)) < 0.02
