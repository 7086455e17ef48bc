"""Angles of lights, new lights, and panels in place of faces."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.session.lights import (
    LightId,
    Room,
    aim_of,
    aimed,
    beam,
    in_place_of,
    lights_after,
    new_light,
    north_angle,
    north_at,
    numbered,
    panel_of_faces,
    photometric,
    towards,
    turned,
    words_for,
)
from gi_core.base.vectors import frame_of
from gi_core.files.edits import Darken, Light, edited
from gi_core.lights.emission import build_emitters
from gi_core.lights.photometric import axes
from gi_core.scene import Material, PointLight, SpotLight
from gi_core.scene.types import Daylight
from gi_core.solver import Solver
from tests.support import viewer_support as support
from tests.support.photometry import luminaire
from tests.support.scene_builders import box, merge, quad

SPOT = SpotLight("spot", (0.2, 0.8, 0.6), (0.0, -1.0, 0.0), (3.0, 2.0, 1.0), 10.0, 25.0)
UPS = [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.8, 0.0)]


def with_values(light, values):
    return light._replace(**dict(values))


@given(st.floats(1, 179), st.floats(-179, 179), st.floats(-179, 179), st.sampled_from(UPS))
def test_angles_come_back(tilt, heading, turn, up):
    light = with_values(luminaire(), aimed(luminaire(), tilt, heading, turn, up))
    assert aim_of(light, up) == pytest.approx((tilt, heading, turn), abs=1e-5)
    axis, c0 = axes(light)
    assert float(axis @ np.array(up)) == pytest.approx(-math.cos(math.radians(tilt)), abs=1e-6)
    assert float(axis @ c0) == pytest.approx(0, abs=1e-6)
    spot = with_values(SPOT, aimed(SPOT, tilt, heading, turn, up))
    assert aim_of(spot, up) == pytest.approx((tilt, heading, 0), abs=1e-5)


def test_straight_down_keeps_its_heading():
    assert aim_of(SPOT, (0, 1, 0), near=33.0) == (0.0, 33.0, 0.0)
    assert with_values(SPOT, aimed(SPOT, 0.0, 33.0, 0.0, (0, 1, 0))).direction == pytest.approx((0, -1, 0))


@given(*[st.floats(-1, 1)] * 3)
def test_an_aim_turns_a_luminaire_the_shortest_way(x, y, z):
    light, way = luminaire(), np.array([x, y, z])
    if np.linalg.norm(way) < 1e-3:
        return
    moved = with_values(light, towards(light, way))
    (a, c), (b, d) = axes(light), axes(moved)
    assert b == pytest.approx(way / np.linalg.norm(way), abs=1e-6)
    side = np.cross(a, b)
    assert float(side @ c) == pytest.approx(float(side @ d), abs=1e-6), "C0 turns about the common normal"


def test_a_turn_leaves_lights_without_direction():
    assert turned(PointLight("a", (0, 0, 0), (1, 1, 1)), np.eye(3)) == ()
    quarter, light = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), luminaire()
    assert axes(with_values(light, turned(light, quarter)))[1] == pytest.approx(quarter @ axes(light)[1])


@pytest.mark.parametrize(("inner", "outer"), [(5.0, 40.0), (60.0, 30.0), (-3.0, 200.0), (0.0, 0.0)])
def test_another_beam_has_the_same_flux(inner, outer):
    narrow = with_values(SPOT, beam(SPOT, inner, outer))
    scene = support.room()

    def flux(light):
        lit = dataclasses.replace(scene, lights=(light,))
        surfaces = Solver(lit, photons=0).surfaces
        return build_emitters(lit, surfaces, np.zeros(3), 1.0).flux[-1]

    assert 0 <= narrow.inner_degrees <= narrow.outer_degrees <= 90
    assert flux(narrow) == pytest.approx(flux(SPOT))


def test_lights_of_one_name_are_numbered_and_pending_edits_change_them():
    bulbs = tuple(PointLight("bulb", (x, 0.5, 0.5), (1.0, 1.0, 1.0)) for x in (0.2, 0.8))
    scene = dataclasses.replace(support.room(), lights=(*bulbs, SPOT))
    assert list(numbered(scene.lights)) == [LightId("bulb"), LightId("bulb", 2), LightId("spot")]
    pending = [Light("bulb", (("position", (0.5, 0.1, 0.5)),), number=2), Light("new", (), of="bulb"), Darken("lamp")]
    after = lights_after(scene, pending)
    assert after[LightId("bulb", 2)].position == (0.5, 0.1, 0.5) and after[LightId("bulb")] == bulbs[0]
    assert [words_for(name) for name in ("pendant", "Desk Lamp")] == ["lamp pendant", "Desk Lamp"]


@pytest.mark.parametrize("photometric_units", [True, False])
@pytest.mark.parametrize("height", [2.5, math.inf])
@pytest.mark.parametrize("kind", ("bulb", "spot", "panel", "sun", "overcast sky"))
def test_a_new_light_is_one_of_a_scene_file_below_the_ceiling(kind, height, photometric_units):
    room = Room(np.array([0.5, 0.0, 0.5]), height, np.array([0.0, 1.0, 0.0]), 4.0, photometric_units, 7.0)
    units = "photometric" if photometric_units else "radiometric"
    scene = edited(dataclasses.replace(support.room(), units=units), [Light("new", new_light(kind, room))])
    light = scene.lights[-1]
    if hasattr(light, "position"):
        low, high = (0.8 * height, height) if math.isfinite(height) else (0.4, 3.0)
        assert low < light.position[1] < high
        surfaces = Solver(scene, photons=0).surfaces
        flux = build_emitters(scene, surfaces, np.zeros(3), 1.0).flux[-1]
        known = {"bulb": 800.0, "spot": 500.0, "panel": 3600.0}[kind] if photometric_units else 7.0
        assert flux == pytest.approx([known] * 3, rel=1e-4)


def test_a_file_takes_over_place_and_watts():
    room = Room(np.zeros(3), 2.0, np.array([0.0, 1.0, 0.0]), 4.0, True, 7.0)
    assert "flux" not in dict(photometric({}, room)) and dict(photometric({}, room._replace(photometric=False)))["flux"]
    bulb = PointLight("a", (1, 2, 3), (4, 5, 6))
    assert in_place_of(bulb, True) == {"position": (1, 2, 3)}
    assert in_place_of(bulb, False) == {"position": (1, 2, 3), "flux": (4, 5, 6)}
    assert dict(photometric(in_place_of(bulb, True), room))["position"] == (1, 2, 3)


def test_a_panel_stands_for_faces_that_look_one_way():
    turned_by = np.radians(25)
    c, s = 0.2 * np.cos(turned_by), 0.2 * np.sin(turned_by)
    a, b, middle = np.array([2 * c, 0, 2 * s]), np.array([-s, 0, c]), np.array([0.5, 0.9, 0.5])
    lamp = quad(middle - a / 2 - b / 2, a, b, (3, 3), 3)
    scene = dataclasses.replace(support.room(), static=merge(box((0, 0, 0), (1, 1, 1), inward=True), lamp))
    light = edited(scene, [Darken("lamp"), Light("lamp", panel_of_faces(scene, "lamp", 1.0))]).lights[0]
    axis, c0 = axes(light)
    assert axis == pytest.approx((0, -1, 0)) and light.position == pytest.approx(middle - [0, 1e-3, 0])
    assert sorted(light.size) == pytest.approx([0.2, 0.4])
    long = c0 if light.size[0] > light.size[1] else np.cross(c0, axis)
    assert abs(float(long @ a)) == pytest.approx(0.4)
    assert light.flux == pytest.approx(np.pi * 0.08 * np.array([15.0, 14.0, 11.0]))
    cube = dataclasses.replace(
        scene,
        static=box((0.4,) * 3, (0.6,) * 3),
        materials=(Material("cube", emission=(1.0, 1.0, 1.0)),),
    )
    assert panel_of_faces(cube, "cube", 1.0) is None and panel_of_faces(scene, "white", 1.0) is None


@pytest.mark.parametrize("up", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_north_is_an_angle_clockwise(up):
    east, north, _ = frame_of(up)
    assert north_angle(Daylight((0.0, 0.0), "2026-03-21", 9.0, 0.0), up) == 0.0
    assert north_at(0.0, up) == pytest.approx(north) and north_at(90.0, up) == pytest.approx(east)
    for angle in (-150.0, 40.0):
        turned = Daylight((0.0, 0.0), "2026-03-21", 9.0, 0.0, north=north_at(angle, up))
        assert north_angle(turned, up) == pytest.approx(angle, abs=1e-5)
