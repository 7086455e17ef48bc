"""An architect asks: the sun at 9 on 21 March in Madrid, from the line in a scene file to the patch on the floor."""

import numpy as np
import pytest
from PIL import Image

from app import __main__ as cli
from app.draw.camera import Bounds, from_camera
from app.rest.calculation_surface import light_steps, point_rounds
from app.settings import Settings, make_solver, open_scene
from gi_core.files.load import load_scene
from gi_core.lights.daylight import clear_sky, sun_of
from tests.support.projection import projected

LINE = "daylight = { place = [40.4, -3.7], date = 2026-03-21, hour = 9, utc_offset = 1 }\n"
ROOM = """
[[shape]]
type = "room"
size = [4, 3, 5]
max_edge = 0.2
openings = [{ wall = "right", position = [-0.5, 0.9], size = [1.0, 0.4] }]
[camera]
position = [0.5, 2.4, 2.3]
target = [-1, 0, -1]
"""
ALTITUDE, AZIMUTH = 18.6519, 106.2381  # degrees by NREL's Solar Position Algorithm, as pvlib 0.16.1 computes it


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    path = tmp_path_factory.mktemp("madrid") / "room.toml"
    path.write_text('units = "photometric"\n' + LINE + ROOM)
    return path


def to_sun() -> np.ndarray:
    """Return the published direction to the sun (3,): x is east, y up, -z north."""
    h, a = np.radians([ALTITUDE, AZIMUTH])
    return np.array([np.cos(h) * np.sin(a), np.sin(h), -np.cos(h) * np.cos(a)])


def floor_below_window(share: float) -> np.ndarray:
    """Return the points (4, 3) where the sun through the window's corners meets the floor.

    share: of the window's sides, about its middle.
    """
    corners = np.array([(2, 1.1 + share * y, share * z) for y in (-0.2, 0.2) for z in (-0.5, 0.5)])
    return corners - corners[:, 1:2] / to_sun()[1] * to_sun()


def test_the_sun_stands_where_tables_say(room):
    sun = load_scene(room).lights[0]
    assert np.degrees(np.linalg.norm(np.array(sun.direction) + to_sun())) < 0.01


def test_the_sun_meets_the_floor_where_geometry_says(room):
    solver = make_solver(open_scene(Settings(scene=str(room))), Settings())
    points = np.concatenate([floor_below_window(0.9), floor_below_window(1.1)]) + [0, 1e-4, 0]
    up = np.tile([0.0, 1.0, 0.0], (8, 1))
    rounds = point_rounds(solver.model, points, up, solver.poses, solver.levels, solver.seed)
    *_, (E, errors, _) = light_steps(rounds, 0.05)
    now = sun_of(solver.scene.daylight)
    beam, _ = clear_sky(now, 3.0)
    patch = beam * np.sin(np.radians(ALTITUDE))
    assert (E[:4] > patch - 4 * errors[:4]).all() and (E[:4] < 1.1 * patch).all()
    assert (E[4:] < 0.1 * patch).all()


def test_the_picture_shows_the_patch(room, tmp_path, capsys):
    picture = tmp_path / "a.png"
    assert cli.main(["render", str(room), "--photons", "20000", "--size", "200x160", "--out", str(picture)]) == 0
    pixels = np.asarray(Image.open(picture).convert("L"))
    scene = load_scene(room)
    camera = from_camera(scene.camera, scene.up, Bounds(np.zeros(3), 4.0))
    inside, outside = (
        [
            pixels[int(v * 160), int(u * 200)]
            for u, v in (projected(camera, p, 200 / 160) for p in floor_below_window(s))
        ]
        for s in (0.6, 1.4)
    )
    assert min(inside) > 230 and max(outside) < 180


def test_info_says_where_the_sun_stands(room, capsys):
    assert cli.main(["info", str(room), "--photons", "2000"]) == 0
    text = capsys.readouterr().out
    assert "2026-03-21 9 h, UTC+1, at (40.4, -3.7): sun 18.65 degrees above the horizon, 106.2" in text


def test_an_option_asks_for_another_sun(room, tmp_path, capsys):
    """Over the scene's own daylight, and as all of it in a scene without."""
    assert cli.main(["info", str(room), "--photons", "2000", "--daylight", "hour = 12.5"]) == 0
    noon = sun_of(load_scene(room).daylight._replace(hour=12.5)).altitude
    assert f"2026-03-21 12.5 h, UTC+1, at (40.4, -3.7): sun {noon:.2f} degrees" in capsys.readouterr().out
    assert 40 < noon < 50
    keys = "place = [40.4, -3.7], date = 2026-03-21, hour = 9, utc_offset = 1"
    assert cli.main(["info", "furnace", "--photons", "2000", "--daylight", keys]) == 0
    assert "sun 18.65 degrees above the horizon, 106.2" in capsys.readouterr().out
    assert cli.main(["info", "furnace", "--photons", "2000", "--daylight", "hour = 9"]) == 3
    assert "[daylight]: place is missing" in capsys.readouterr().err
    for keys, sentence in (("hour = 25", "hour must be"), ("height = 1", "keys of [daylight]"), ("9", "such as")):
        assert cli.main(["info", str(room), "--daylight", keys]) == 2
        assert sentence in capsys.readouterr().err


def test_other_units_change_the_numbers_of_daylight(room):
    lux, watts = (open_scene(Settings(scene=str(room), units=units)).lights for units in (None, "radiometric"))
    assert lux[0].irradiance[0] == pytest.approx(179 * watts[0].irradiance[0])


def test_night_is_dark_and_says_so(room, tmp_path, capsys):
    night = tmp_path / "night.toml"
    night.write_text(room.read_text().replace("hour = 9", "hour = 2"))
    assert cli.main(["info", str(night), "--photons", "2000"]) == 0
    assert "note: daylight: the sun is" in capsys.readouterr().out
    picture = tmp_path / "a.png"
    assert cli.main(["render", str(night), "--photons", "2000", "--size", "40x30", "--out", str(picture)]) == 0
    assert "below the horizon" in capsys.readouterr().err


def test_a_sun_that_is_down_can_be_dimmed(room, tmp_path, capsys):
    """Levels of lamps without light change nothing: a scene with a dimmed sun was refused at night."""
    night = tmp_path / "night.toml"
    night.write_text(room.read_text().replace("hour = 9", "hour = 2"))
    assert cli.main(["info", str(night), "--photons", "2000", "--lamp", "sun=0.5"]) == 0
    assert cli.main(["info", str(night), "--photons", "2000", "--lamp", "moon=0.5"]) != 0
    assert "no lamp is called 'moon'" in capsys.readouterr().err
