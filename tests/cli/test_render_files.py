"""`render`: parameters in its files, frames along a path, and the path itself.

Warnings about complete light that differs from the request: once in the log, and by `render`.
"""

import functools
import itertools
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app import __main__ as cli
from app.cli.progress import warnings_of
from app.commands import render
from app.commands.render import numbered
from app.draw import motion
from app.draw.picture_files import write_png, write_video
from app.draw.tonemap import to_display
from app.rest.scheduler import gather
from app.session.log import Log
from app.session.opening import Opened
from app.session.session import Session
from app.settings import Settings, make_solver
from gi_core.scene import KeyFrames
from gi_core.solver import Solver
from tests.cli.test_render import checkered_room
from tests.support.cli_support import one_line
from tests.support.scene_builders import furnace_scene, solve
from tests.support.viewer_support import room

SMALL = Settings(photons=4000, radius=0.06, size=(96, 72))


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
    assert (np.abs(pictures[0] - pictures[2]).max(axis=2) > 20).mean() > 0.02


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"isolines": (5e4, 1e5)}, r"the picture has about [\d.]+ to [\d.]+ W/m², they are at 50000, 100000$"),
        ({"isolines": (), "illuminance_range": (1e4, 1e5)}, ".*, they are at 20000, 40000, 60000, 80000, 100000$"),
        ({"isolines": (5.0,), "show": "radiance"}, "they lie over false colours, ask for --show illuminance$"),
        ({"isolines": ()}, ""),
        ({"isolines": None}, ""),
    ],
)
def test_a_picture_without_the_isolines_asked_for_says_so(changes, message, tmp_path, room_instead_of_a_file, capsys):
    render.render(replace(SMALL, **({"show": "illuminance"} | changes)), tmp_path / "a.png", seconds=0)
    lines = [line for line in capsys.readouterr().err.splitlines() if "isolines" in line]
    assert len(lines) == bool(message) and all(re.search(f"^gi-viewer: no isolines: {message}", x) for x in lines)


def test_the_same_command_gives_the_same_bytes(tmp_path, room_instead_of_a_file):
    (a,) = render.render(SMALL, tmp_path / "a.png")
    (b,) = render.render(SMALL, tmp_path / "b.png")
    assert a.read_bytes() == b.read_bytes()


def linear_of(path) -> tuple[dict[str, np.ndarray], dict]:
    import OpenEXR

    with OpenEXR.File(str(path)) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}, dict(file.header())


@pytest.mark.parametrize("paths", [None, 0, 16])
def test_exr_has_linear_layers_of_the_picture(paths, tmp_path, room_instead_of_a_file):
    """Tone-mapped, its colour is the PNG but for edges; away from lamps it is albedo times irradiance over pi."""
    settings = replace(SMALL, white_balance=False, tone_map="clip", exposure=0.5)
    (exr,), (png,) = (render.render(settings, tmp_path / f"a{suffix}", paths=paths) for suffix in (".exr", ".png"))
    layers, header = linear_of(exr)
    variance = [] if paths is None else ["variance"]
    assert sorted(layers) == ["RGBA", "albedo", "irradiance", *variance] and layers["albedo"].dtype == np.float32
    picture, colour, seen = np.array(Image.open(png)).astype(int), layers["RGBA"][..., :3], layers["RGBA"][..., 3]
    assert (np.abs(to_display(colour, 0.5, "clip") - picture)[seen == 1].max(axis=1) > 8).mean() < 0.05
    rho, E = layers["albedo"], layers["irradiance"]
    materials = [m.reflectance for m in room().materials[:3]]  # pixels of one material alone
    inside = (seen == 1) & np.any([np.isclose(rho, m, atol=1e-6).all(axis=2) for m in materials], axis=0)
    np.testing.assert_allclose(colour[inside], (rho * E)[inside] / np.pi, rtol=1e-4)
    assert inside.mean() > 0.3 and len(np.unique(rho[inside][:, 0].round(3))) == 3
    entries = Image.open(png).text
    assert {key: header[f"gi-viewer {key}"] for key in entries} == entries


def test_exr_shows_textures_in_colour_and_albedo_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(render, "open_scene", lambda settings: checkered_room(2.0))
    layers, _ = linear_of(*render.render(replace(SMALL, white_balance=False), tmp_path / "a.exr"))
    rho, E, colour = layers["albedo"], layers["irradiance"], layers["RGBA"][..., :3]
    known = (rho.min(axis=2) > 0.02) & (layers["RGBA"][..., 3] == 1)
    ratio = np.pi * colour[known] / (rho * E)[known]
    assert np.median(np.abs(ratio - 1)) < 0.01 and known.mean() > 0.2 and len(np.unique(rho[..., 0])) > 500


def test_frames_as_exr_files(tmp_path, room_instead_of_a_file):
    paths = render.render(SMALL, tmp_path / "a.exr", frames=2)
    a, b = (linear_of(path)[0]["irradiance"] for path in paths)
    assert [p.name for p in paths] == ["a.0001.exr", "a.0002.exr"] and not np.array_equal(a, b)


@pytest.mark.parametrize("suffix", [".gif", ".webp", ".mp4"])
def test_films_have_every_frame_at_the_rate(suffix, tmp_path, room_instead_of_a_file):
    """Frames are those of numbered pictures, but for the losses of the format; odd sizes are padded in MP4."""
    settings = replace(SMALL, size=(95, 71))
    (path,) = render.render(settings, tmp_path / f"a{suffix}", frames=4, rate=20)
    pictures = [np.array(Image.open(p)) for p in render.render(settings, tmp_path / "a.png", frames=4)]
    assert path.name == f"a{suffix}" and not list(tmp_path.glob("*.part"))
    if suffix == ".mp4":
        import av

        with av.open(str(path)) as file:
            stream = file.streams.video[0]
            assert stream.average_rate == 20 and (stream.width, stream.height) == (96, 72)
            seen = [frame.to_ndarray(format="rgb24")[:71, :95] for frame in file.decode(stream)]
    else:
        film = Image.open(path)
        assert film.n_frames == 4
        seen = []
        for k in range(4):
            film.seek(k)
            seen.append(np.array(film.convert("RGB")))
            assert film.info["duration"] == 50 and film.info["loop"] == 0
    assert len(seen) == 4
    apart = [[np.abs(s.astype(int) - p).mean() for p in pictures] for s in seen]
    assert np.argmin(apart, axis=1).tolist() == [0, 1, 2, 3] and np.diag(apart).max() < 6


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_pictures_of_a_film_are_written_one_by_one(suffix, tmp_path):
    """Pillow kept all of them in memory until the last."""
    random, written = np.random.default_rng(0), []

    def pictures():
        for _ in range(20):
            yield random.integers(0, 256, (240, 320, 3), np.uint8)
            written.append(sum(p.stat().st_size for p in tmp_path.iterdir()))

    path = write_video(tmp_path / f"a{suffix}", pictures(), 20)
    assert Image.open(path).n_frames == 20 and written[-1] > 0.7 * path.stat().st_size


def test_a_stopped_film_leaves_no_file(tmp_path, room_instead_of_a_file, monkeypatch):
    def stop(self, *_):
        raise KeyboardInterrupt

    monkeypatch.setattr("app.draw.motion.spread", lambda paths, frames: [{}, {"block": None}])
    monkeypatch.setattr("gi_core.solver.Solver.move_all", stop)
    for suffix in (".mp4", ".gif"):
        with pytest.raises(KeyboardInterrupt):
            render.render(SMALL, tmp_path / f"a{suffix}", frames=2)
    assert not list(tmp_path.iterdir())


TAKES = "pixels takes %d GB of memory, more than 4; lower --size or --scale, or name a .png file"
INSTEAD = "name a .png file", "leave --still out"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--out a.mp4", "--out a.mp4 is a film: give --frames N, or name a .png file"),
        ("--out a.jpg", "--out must name a file of .png, .exr, .mp4, .gif, .webp, got a.jpg"),
        ("--out a.gif --frames 2 --size 9999x9999", f"--out a.gif of 9999x9999 {TAKES % 5}"),
        ("--out a.exr --size 9999x9999", f"--out a.exr of 9999x9999 {TAKES % 7}"),
        ("--out a.png --still --size 4096x4096", f"--out a.png of 4096x4096 {TAKES % 8}".replace(*INSTEAD)),
        ("--out a.gif --frames 2 --rate 101", "--out a.gif has at most 100 pictures per second, got --rate 101"),
        ("--out a.webp --frames 2 --size 1x16384", "--out a.webp has at most 16383 pixels per side, got 16384"),
        ("--out a.exr --size 16384x9 --scale 2", "--out a.exr has at most 16384 pixels per side, got 32768"),
    ],
)
def test_pictures_that_cannot_be_are_refused_before_the_work(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["render", "no such scene.glb", *words.split()]) == 2
    assert one_line(capsys.readouterr().err) == f"gi-viewer: {message}\n"


@pytest.mark.parametrize("module, suffix", [("OpenEXR", "exr"), ("av", "mp4"), ("av", "gif")])
def test_a_missing_library_is_named_before_the_work(module, suffix, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, module, None)
    assert cli.main(["render", "no such scene.glb", "--frames", "2", "--out", str(tmp_path / f"a.{suffix}")]) == 2
    said = f"gi-viewer: {module}, which writes .{suffix} files, is not installed: pip install {module}\n"
    assert one_line(capsys.readouterr().err) == said


def test_scale_multiplies_the_size(tmp_path, monkeypatch, room_instead_of_a_file):
    monkeypatch.chdir(tmp_path)
    assert cli.main("render --photons 1000 --size 40x30 --scale 4 --out a.png".split()) == 0
    assert Image.open("a.png").size == (160, 120)


def ticking(step: float):
    """A clock that advances by a step [s] per reading: as many tasks on any machine."""
    now = itertools.count()
    return lambda: step * next(now)


def test_a_picture_has_the_windows_light_within_its_time(tmp_path, room_instead_of_a_file, monkeypatch):
    """Gathered for some seconds, its light is that of paths; without seconds and by photons only, it is not."""
    monkeypatch.setattr("app.rest.scheduler.gather", functools.partial(gather, clock=ticking(0.01)))
    asked = [(SMALL, 0.0), (SMALL, 80.0), (replace(SMALL, light="photons"), 1.0)]
    entries = [Image.open(*render.render(s, tmp_path / "a.png", seconds=t)).text for s, t in asked]
    assert [e["static_light"].partition(",")[0] for e in entries] == ["photons", "whole paths", "photons"]
    assert entries[1]["light_at_poses"].startswith("gathered")


def test_the_time_left_is_shown_and_the_time_kept():
    """By a clock of its own: each task takes a second."""
    solver, said = make_solver(room(), replace(SMALL, light="best")), []
    solver.solve()
    gather(solver, 8.0, lambda text, fraction: said.append((text, fraction)), clock=ticking(0.25))
    lefts = [int(text.split(", ")[1].split()[0]) for text, _ in said]
    assert lefts[0] == 8 and lefts == sorted(lefts, reverse=True) and lefts[-1] <= 1 and len(said) <= 32
    assert [f for _, f in said] == sorted(f for _, f in said) and 0 <= said[0][1] < said[-1][1] <= 1


def test_png_text_survives_any_value(tmp_path):
    entries = {"scene": "Küche 厨房.glb", "n": 3, "pose 壶": "0,0,0", 99 * "k": "long"}
    path = write_png(tmp_path / "x.png", np.zeros((2, 3, 3), np.uint8), entries)
    read = {"scene": "Küche \\u53a8\\u623f.glb", "n": "3", "pose \\u58f6": "0,0,0", 79 * "k": "long"}
    assert Image.open(path).text == read
    assert not list(tmp_path.glob("*.part"))


def test_numbered_names():
    assert str(numbered(render.Path("out") / "a.b.png", 12)).replace("\\", "/") == "out/a.b.0012.png"


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


def solved(reflectance: float, photons: int = 4_000) -> Solver:
    return solve(furnace_scene(1.0, reflectance, 2), "impact_count", photons, threads=1)


def test_memory_is_reported():
    solver = solved(0.5)
    assert warnings_of(solver) == {}
    solver.frame.store.memory_full = True
    assert warnings_of(solver) == {"memory": "memory holds no more than 4,000 of the 4,000 photons wanted"}


def test_log_reports_truncated_light_once(monkeypatch):
    monkeypatch.setattr("gi_core.base.memory.available", lambda: 0)
    settings = Settings(estimator="impact_count", photons=8_000, radius=0.1, neighbours=50, exposure=0.0)
    session = Session(settings, Log(), open_with=lambda settings: None)
    session.adopt(Opened(settings, solved(0.5), None, ()))
    for radius in (0.1, 0.2):
        session.want(replace(session.settings, radius=radius))
        while session.refining:
            session.tick(1 / 60)
        session.log(f"radius {radius}")  # separates repeated lines, which the log would merge
    session.close()
    said = [e.text for e in session.log.entries if "memory holds" in e.text]
    assert len(said) == 1


@pytest.mark.parametrize("full", [True, False])
def test_render_says_it(full, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    if full:
        monkeypatch.setattr("gi_core.base.memory.available", lambda: 0)
    settings = Settings(scene="bright", estimator="impact_count", photons=2_000, size=(16, 16))
    monkeypatch.setattr(render, "open_scene", lambda s: furnace_scene(1.0, 0.5, 2))
    render.render(settings, tmp_path / "a.png")
    err = capsys.readouterr().err
    assert err.count("memory holds") == full and err.count("\n") == full
