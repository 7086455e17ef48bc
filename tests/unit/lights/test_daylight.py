"""Daylight: the sun's place against published values and closed forms, the light of a clear sky, bad values."""

import numpy as np
import pytest

from gi_core.files.edits import Daylight as ChangeDaylight
from gi_core.files.edits import Light, edited, with_edit
from gi_core.files.load import load_scene
from gi_core.lights.daylight import Sun, clear_sky, lights_of, sun_of
from gi_core.scene import DirectionalLight, PointLight, SkyLight
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Daylight

MADRID = Daylight((40.4, -3.7), "2026-03-21", 9.0, 1.0)
TABLE = "place = [40.4, -3.7]\ndate = 2026-03-21\nhour = 9\nutc_offset = 1\n"
ROOM = '[[shape]]\ntype = "room"\nsize = [4, 3, 5]\n'


def refraction(altitude: float) -> float:
    """Return the degrees by which air lifts a light of apparent altitude: Bennett 1982, another formula than ours."""
    return 1 / 60 / np.tan(np.radians(altitude + 7.31 / (altitude + 4.4)))


def apart(sun: Sun, altitude: float, azimuth: float) -> float:
    """Return the angle [degrees] between the sun and a direction."""
    a, b = (
        np.array([np.cos(h) * np.sin(z), np.cos(h) * np.cos(z), np.sin(h)])
        for h, z in (np.radians([sun.altitude, sun.azimuth]), np.radians([altitude, azimuth]))
    )
    return float(np.degrees(2 * np.arcsin(np.linalg.norm(a - b) / 2)))


def test_the_worked_example_of_nrel():
    """I. Reda, A. Andreas, NREL/TP-560-34302, table A4.1: its air has 820 hPa, ours 1010: 0.004 degrees here."""
    sun = sun_of(Daylight((39.742476, -105.1786), "2003-10-17", 12 + 30.5 / 60, -7.0))
    assert apart(sun, 90 - 50.11162, 194.34024) < 0.01


@pytest.mark.parametrize(
    ("place", "date", "hour", "altitude", "azimuth"),
    [
        ((40.4, -3.7), "2026-03-21", 8.0, 18.6519, 106.2381),
        ((-33.87, 151.21), "1995-01-15", 22.25, 38.1696, 91.3454),
        ((64.15, -21.94), "2010-06-21", 23.5, 1.0387, 332.7737),
        ((1.35, 103.82), "2049-09-23", 5.0, 88.2401, 204.7951),
        ((78.22, 15.65), "1951-08-01", 3.75, 14.0252, 67.1479),
        ((51.48, 0.0), "2000-12-21", 8.25, 0.9800, 130.6392),
    ],
)
def test_spa(place, date, hour, altitude, azimuth):
    """NREL's Solar Position Algorithm, accurate to 0.0003 degrees, as pvlib 0.16.1 computes it, in UTC."""
    assert apart(sun_of(Daylight(place, date, hour, 0.0)), altitude, azimuth) < 0.01


@pytest.mark.parametrize(
    ("date", "hour", "declination"),
    [  # instants of the equinoxes and solstices of 2026 in UTC, US Naval Observatory
        ("2026-03-20", 14 + 46 / 60, 0.0),
        ("2026-06-21", 8 + 25 / 60, 23.436),
        ("2026-09-23", 5 / 60, 0.0),
        ("2026-12-21", 20 + 50 / 60, -23.436),
    ],
)
@pytest.mark.parametrize("latitude", [90.0, -90.0])
def test_the_sun_at_a_pole_stands_as_high_as_its_declination(latitude, date, hour, declination):
    sun = sun_of(Daylight((latitude, 0.0), date, hour, 0.0))
    height = declination * np.sign(latitude)
    if height >= 0:
        assert sun.altitude - refraction(sun.altitude) == pytest.approx(height, abs=0.01)
    else:
        assert sun.altitude == pytest.approx(height, abs=0.01)


@pytest.mark.parametrize("latitude", [-35.0, 0.0, 52.0])
def test_noon_of_the_equinox_is_the_complement_of_the_latitude(latitude):
    hours = np.linspace(11.9, 12.4, 301)  # the equation of time is -7.4 minutes then
    suns = [sun_of(Daylight((latitude, 0.0), "2026-03-20", hour, 0.0)) for hour in hours]
    noon = max(suns, key=lambda sun: sun.altitude)
    # the equinox is 2.65 h later: 0.988 arc minutes of declination per hour are left
    assert noon.altitude - refraction(noon.altitude) == pytest.approx(90 - abs(latitude + 2.65 * 0.988 / 60), abs=0.01)


def test_clock_and_utc_offset_cancel():
    assert sun_of(MADRID) == sun_of(MADRID._replace(hour=13.5, utc_offset=5.5))


@pytest.mark.parametrize(
    ("altitude", "turbidity", "beam", "diffuse"),
    [
        (5.0, 2.0, 447.2, 7.6),
        (5.0, 6.0, 10.9, 8.5),
        (10.0, 3.0, 413.6, 35.9),
        (30.0, 3.0, 789.5, 75.9),
        (60.0, 2.0, 1004.6, 69.8),
        (60.0, 6.0, 672.6, 203.6),
        (90.0, 3.0, 944.3, 112.2),
    ],
)
def test_irradiance_times_efficacy(altitude, turbidity, beam, diffuse):
    """Irradiance: Ineichen's model as pvlib 0.16.1 computes it, at sea level and 1367 W/m2 outside the air."""
    mass = 1 / (np.sin(np.radians(altitude)) + 0.50572 * (altitude + 6.07995) ** -1.6364)
    brightness, zenith, water = mass * diffuse / 1367, np.radians(90 - altitude), 2.0
    of_beam = 101.18 + 1.58 * water - 1.10 * np.exp(5.73 * zenith - 5) - 8.29 * brightness  # Perez 1990, table 4
    of_sky = 152.23 + 0.35 * water - 45.27 * np.cos(zenith) - 7.98 * np.log(brightness)
    light = clear_sky(Sun(altitude, 0.0, 1.0), turbidity)
    assert light == pytest.approx((beam * of_beam, diffuse * of_sky), rel=0.01)  # of the rounded table


@pytest.mark.parametrize("altitude", [15.0, 30.0, 60.0, 90.0])
def test_the_clear_sky_of_the_ies(altitude):
    """G. Gillette et al. 1983, IESNA Lighting Handbook, chapter Daylighting: formulas without turbidity."""
    height = np.sin(np.radians(altitude))
    beam, sky = 127_500 * np.exp(-0.21 / height), 800 + 15_500 * np.sqrt(height)
    assert clear_sky(Sun(altitude, 0.0, 1.0), 3.0) == pytest.approx((beam, sky), rel=0.2)


def test_haze_moves_light_from_the_sun_to_the_sky():
    by_turbidity = np.array([clear_sky(Sun(40.0, 0.0, 1.0), t) for t in np.linspace(1, 9.9, 40)])
    assert (np.diff(by_turbidity, axis=0)[:, 0] < 0).all() and (np.diff(by_turbidity, axis=0)[5:, 1] > 0).all()


def test_light_begins_at_the_horizon_and_grows_without_a_jump():
    heights = np.linspace(-1, 90, 9101)
    light = np.array([clear_sky(Sun(h, 0.0, 1.0), 3.0) for h in heights])
    assert (light >= 0).all() and (light[heights <= 0] == 0).all() and (light[heights > 0, 1] > 0).all()
    assert np.abs(np.diff(light, axis=0)).max() < 150  # lx per 0.01 degrees


@pytest.mark.parametrize(
    ("up", "north", "east", "is_north"),
    [
        ((0, 1, 0), None, (1, 0, 0), (0, 0, -1)),
        ((0, 0, 1), None, (1, 0, 0), (0, 1, 0)),
        ((1, 0, 0), None, (0, 1, 0), (0, 0, 1)),
        ((0, 0, 1), (2.0, 0.0, 5.0), (0, -1, 0), (1, 0, 0)),
    ],
)
def test_axes(up, north, east, is_north):
    sun = sun_of(MADRID)
    light, _ = lights_of(MADRID._replace(north=north), up, "photometric")
    h, a = np.radians([sun.altitude, sun.azimuth])
    to_sun = np.cos(h) * (np.cos(a) * np.array(is_north) + np.sin(a) * np.array(east)) + np.sin(h) * np.array(up)
    np.testing.assert_allclose(light.direction, -to_sun, atol=1e-12)


def scene_of(tmp_path, text: str):
    (tmp_path / "room.toml").write_text(text)
    return load_scene(tmp_path / "room.toml")


def test_a_table_makes_a_sun_and_a_sky(tmp_path):
    lux = scene_of(tmp_path, f'units = "photometric"\n{ROOM}[daylight]\n{TABLE}')
    sun, sky = lux.lights
    assert isinstance(sun, DirectionalLight) and isinstance(sky, SkyLight) and lux.daylight == MADRID
    assert (sun.irradiance[0], np.pi * sky.radiance[0]) == pytest.approx(clear_sky(sun_of(MADRID), 3.0))
    watts = scene_of(tmp_path, f"{ROOM}[daylight]\n{TABLE}").lights[0]
    assert watts.direction == sun.direction and watts.irradiance[0] == pytest.approx(sun.irradiance[0] / 179)
    line = "daylight = { " + ", ".join(TABLE.split("\n")[:-1]) + " }\n"
    assert scene_of(tmp_path, line.replace("2026-03-21", '"2026-03-21"') + ROOM).lights[0] == watts


def test_night_is_dark_and_says_so(tmp_path):
    scene = scene_of(tmp_path, f"{ROOM}[daylight]\n{TABLE}".replace("hour = 9", "hour = 2"))
    assert [max(scene.lights[0].irradiance), max(scene.lights[1].radiance)] == [0, 0]
    (note,) = [note for note in scene.notes if note.startswith("daylight")]
    assert note == f"daylight: the sun is {sun_of(MADRID._replace(hour=2.0))}: no light" and "below the horizon" in note
    day = edited(scene, [ChangeDaylight((("hour", 9.0),))])
    assert max(day.lights[0].irradiance) > 0 and not any(note.startswith("daylight") for note in day.notes)


def test_edits(tmp_path):
    text = (
        f'{ROOM}[[light]]\ntype = "point"\nname = "bulb"\nposition = [0, 1, 0]\nflux = [1, 1, 1]\n[daylight]\n{TABLE}'
    )
    scene = scene_of(tmp_path, text)
    edits = with_edit(with_edit((), ChangeDaylight((("hour", 10.0),))), ChangeDaylight((("date", "2026-06-21"),)))
    assert edits == (ChangeDaylight((("hour", 10.0), ("date", "2026-06-21"))),)
    wanted = scene_of(tmp_path, text.replace("= 9", "= 10").replace("03-21", "06-21"))
    later = edited(scene, edits)
    assert later.lights == wanted.lights and isinstance(later.lights[0], PointLight)
    turned = with_edit(edits, Light("sun", (("direction", (0.0, -1.0, 0.0)),)))
    assert edited(scene, turned).lights[1].direction == (0, -1, 0)
    assert edited(scene, with_edit(turned, ChangeDaylight((("hour", 10.0),)))).lights == wanted.lights
    with pytest.raises(SceneError, match=r"\[daylight\]: hour must be a number >= 0 and < 24, got 24"):
        edited(scene, [ChangeDaylight((("hour", 24.0),))])
    with pytest.raises(SceneError, match=r"\[daylight\]: place is missing"):
        edited(scene_of(tmp_path, ROOM), edits)


def test_a_light_of_the_name_of_the_sun_is_refused(tmp_path):
    sky = '[[light]]\ntype = "sky"\nname = "sun"\nradiance = [1, 1, 1]\n'
    with pytest.raises(SceneError, match="names must differ, \\[daylight\\] has this one; rename the light"):
        scene_of(tmp_path, f"{ROOM}{sky}[daylight]\n{TABLE}")
