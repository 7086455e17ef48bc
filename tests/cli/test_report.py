"""The report: one page that needs no other file, numbers with their errors, verdicts, polar curves, equal bytes."""

import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from app import __main__ as cli
from app.session.report import _materials
from gi_core.files.load import load_scene
from gi_core.model import Model
from tests.support.mesh_writers import write_textured_room
from tests.support.photometry import write_ies
from tests.support.toml_rooms import room_file, table
from tests.support.viewer_hand import in_window

CANDELA = np.array([[500.0, 500.0, 300.0, 0.0]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("report")
    write_ies(path / "down.ies", [0.0, 30.0, 60.0, 90.0], [0.0], CANDELA)
    lamp = table("light", type="photometric", name="down", file="down.ies", position=(0, 0, 2.75), direction=(0, 0, -1))
    targets = {"mean": 90, "U0": 0.99, "maximum": 200}
    desk = table("surface", name="desk & chair", position=(0, 0), size=(0.9, 0.5), points=(3, 1), targets=targets)
    keys = {"title": "Room <1>", "maintenance_factor": 0.8, "room": {"max_edge": 0.5}}
    room_file(path, (4, 3, 3), lamp, desk, reflectance=0, **keys)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        yield path


@pytest.fixture(scope="module")
def report(folder) -> tuple[str, dict]:
    """The page and the numbers."""
    return made("a")


def made(name: str) -> tuple[str, dict]:
    files = ["--out", f"{name}.html", "--json", f"{name}.json"]
    assert cli.main(["report", "room.toml", *files, "--photons", "3000", "--size", "80x50"]) == 0
    with open(f"{name}.html", encoding="utf-8") as page, open(f"{name}.json", encoding="utf-8") as numbers:
        return page.read(), json.load(numbers)


def test_a_report_by_hand_and_the_same_bytes_again(report):
    """500 cd below the lamp at 2 m, times 0.8: 100 lx; 0.3 m beside it 100 cos^3, and 50 W of the file."""
    page, numbers = report
    (surface,) = numbers["surfaces"]
    beside = 100 * math.cos(math.atan(0.3 / 2)) ** 3
    by_hand = {"mean": (100 + 2 * beside) / 3, "minimum": beside, "maximum": 100.0}
    assert {name: surface[name][0] for name in by_hand} == pytest.approx(by_hand, rel=1e-4)
    assert surface["targets"] == {"mean": [90, "pass"], "U0": [0.99, "fail"], "maximum": [200, "pass"]}
    assert [point[3] for point in surface["points"]] == pytest.approx([beside, 100, beside], rel=1e-4)
    assert numbers["power"]["watts"] == {"down": 50.0} and numbers["power"]["floor_m2"] == pytest.approx(12.0)
    assert numbers["lamps"][0]["watts"] == 50.0
    expected = (
        "Room &lt;1&gt;", "desk &amp; chair", "<b class='pass'>pass</b>", "<b class='fail'>fail</b>", "50 W, 4.17",
        "at least 90 lx", "500 cd", "W/m² per 100 lx", "SHA-256 of room.toml", "SHA-256 of down.ies",
    )  # fmt: skip
    for text in expected:
        assert text in page, text
    assert made("b") == report, "equal inputs, equal bytes"


def test_a_page_needs_no_other_file_and_is_well_formed(report):
    from html.parser import HTMLParser

    page, _ = report
    sources = re.findall(r"(?:src|href)='([^']{0,22})", page)
    assert sources == ["data:image/png;base64,"] * 2 and "http" not in page and "<script" not in page
    opened = []

    class Tags(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag not in ("meta", "img"):
                opened.append(tag)

        def handle_startendtag(self, tag, attrs):
            pass

        def handle_endtag(self, tag):
            assert opened.pop() == tag

    Tags().feed(page)
    assert opened == []


def test_the_polar_curve_is_that_of_the_file(report):
    """Radius 80 is the largest intensity; 300 cd of 500 at 60 degrees from straight down."""
    page, _ = report
    curves = re.findall(r"<polyline points='([^']*)'", page)
    points = np.array([[float(x) for x in pair.split(",")] for pair in curves[0].split()]) - 100
    r = 80 * 300 / 500
    beside = [r * math.sin(math.radians(60)), r * math.cos(math.radians(60))]
    assert len(curves) == 2 and points[0] == pytest.approx([0, 0], abs=0.06)
    for expected in (beside, [-beside[0], beside[1]], [0, 80]):
        assert np.abs(points - expected).sum(axis=1).min() < 0.15


def test_bad_files_are_refused_before_the_work(folder, capsys):
    for words, message in (
        (["--out", "a.pdf"], "--out must name a .html file, got a.pdf"),
        (["--out", "a.html", "--json", "a.html"], "--json must name a .json file, got a.html"),
        (["--out", "b/a.html"], "a folder that exists"),
    ):
        assert cli.main(["report", "room.toml", *words]) == 2
        assert message in capsys.readouterr().err


@in_window()
def test_the_window_writes_a_report(hand, viewer, folder):
    viewer.session.move({"block": viewer.session.poses["block"]._replace(position=(0.3, 0.0, 0.3))})
    hand.wait_for_light()
    hand.ctx.set_ref("##MainMenuBar")
    hand.ctx.menu_click("File/Report...")
    hand.ctx.yield_(3)
    hand._jobs.append(lambda: viewer.files.dialog._answered(str(folder / "r")))  # on the thread of the picture
    hand.wait((folder / "r.html").exists)
    page = (folder / "r.html").read_text(encoding="utf-8")
    assert "Luminaires and lamps" in page and page.count("data:image/png") == 1
    assert "--pose block=0.3,0.0,0.3" in page, "what a second run needs"


def test_the_reflectance_of_a_texture_is_its_mean(tmp_path):
    """A textured chair had 0.98, the factor of its texture."""
    write_textured_room(tmp_path)
    table = _materials(SimpleNamespace(model=Model(load_scene(tmp_path / "room.obj"))))
    linear = ((180 / 255 + 0.055) / 1.055) ** 2.4
    assert dict(re.findall(r"<td>([^<]*)</td><td>([0-9.]+)</td>", table))["floor"] == f"{linear:.2f}"
