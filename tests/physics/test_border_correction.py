"""photon_map and impact_count at borders and creases (report 2.9.1).

Photons hit the part of a disc that the surface covers: alpha / 2 pi of it at a border.
"""

import math

import numpy as np
import pytest

from gi_core.model import Model
from gi_core.scene.types import DirectionalLight, Material, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import BLACK, box, furnace_scene, grey, lamp, merge, quad, solve, sphere

UP = (0.0, 0.0, 1.0)
SUN = DirectionalLight("sun", (0.0, 0.0, -1.0), (1.0, 1.0, 1.0), disc_degrees=0.0)


def share_of(mesh, material=BLACK):
    model = Model(Scene(mesh, (material,), up=UP))
    return model.covered_share, model.object_receivers


def solved(scene: Scene, **settings) -> tuple[Solver, np.ndarray]:
    solver = solve(scene, **{"photons": 100_000, "radius": 0.1, "neighbours": 100, **settings})
    return solver, solver.irradiance[:, 0]


def on_edges(p: np.ndarray) -> np.ndarray:
    """Return how many borders of the unit square each receiver lies on."""
    return ((p[:, :2] == 0) | (p[:, :2] == 1)).sum(axis=1)


@pytest.mark.parametrize("two_sided", [False, True])
def test_the_angle_of_a_square(two_sided):
    """2 pi inside, pi at a border, pi / 2 at a corner, on the back too."""
    share, receivers = share_of(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (4, 4)), grey(0.5, two_sided))
    assert len(share) == 25 * (1 + two_sided)
    np.testing.assert_allclose(share, np.array([1, 1 / 2, 1 / 4])[on_edges(receivers.positions)], atol=1e-12)


def test_angle_of_edges_corners_and_a_sphere():
    """The edge of a box is a border of each of its faces; a sphere has none, though its fans are not flat."""
    share, receivers = share_of(box((0, 0, 0), (1, 1, 1), 2))
    walls = ((receivers.positions == 0) | (receivers.positions == 1)).sum(axis=1)
    np.testing.assert_allclose(share, np.array([1, 1, 1 / 2, 1 / 4])[walls], atol=1e-12)
    assert (share_of(sphere((0, 0, 0), 1.0, 1))[0] == 1).all()


def test_an_angle_is_measured_in_the_tangent_plane():
    """Half a cone: at its tip, seen along the normal, it is the angle between the first and the last edge of the fan.

    The corners on the surface itself add up to less.
    """
    turns = np.linspace(0, math.pi, 13)
    rim = np.stack([np.cos(turns), np.sin(turns), np.full(13, 0.5)], axis=1)
    fan = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))._replace(
        vertices=np.concatenate([np.zeros((1, 3)), rim]),
        faces=np.array([[0, k, k + 1] for k in range(1, 13)], np.int32),
        face_material=np.zeros(12, np.int32),
    )
    share, receivers = share_of(fan)
    tip = np.flatnonzero((receivers.positions == 0).all(axis=1))
    assert len(tip) == 1
    n = receivers.normals[tip[0]]
    across = np.cross(n, (0.0, 1.0, 0.0))
    u = across / np.linalg.norm(across)
    seen = np.unwrap(np.arctan2(rim @ np.cross(n, u), rim @ u))
    assert share[tip[0]] == pytest.approx(abs(seen[-1] - seen[0]) / (2 * math.pi), abs=1e-9)


def test_a_free_border_is_as_bright_as_the_middle():
    """A square in parallel light. Without correction a border is 1 - alpha / 2 pi too dark: a half, three quarters.

    k = 100 makes 10 % of noise a receiver and 16 of them a border: means to 2.5 % and better, the 4 corners 5 %.
    """
    scene = Scene(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (8, 8)), (BLACK,), lights=(SUN,), up=UP)
    for correction, expected in ((True, (1, 1, 1)), (False, (1, 1 / 2, 1 / 4))):
        solver, E = solved(scene, estimator="photon_map", border_correction=correction)
        edges = on_edges(solver.receivers.positions)
        for k, mean, tolerance in zip((0, 1, 2), expected, (0.04, 0.08, 0.2), strict=True):
            assert E[edges == k].mean() == pytest.approx(mean, rel=tolerance), (correction, k)


def test_edges_and_corners_of_a_furnace():
    """E = 2 pi everywhere. Without correction the other wall's hits compensate at edges, not at corners (3 / 4)."""
    scene = furnace_scene(1.0, 0.5)
    bright = {}
    for correction in (True, False):
        solver, E = solved(scene, estimator="photon_map", border_correction=correction)
        p = solver.receivers.positions
        walls = ((p == 0) | (p == 1)).sum(axis=1)
        bright[correction] = [E[walls == k].mean() / (2 * math.pi) for k in (1, 2, 3)]
    # 294, 168 and 24 receivers of 10 % noise, and half a hit of k = 100, as Sobol photons lie more evenly than chance.
    np.testing.assert_allclose(bright[True], 1.0, atol=0.06)
    np.testing.assert_allclose(bright[False][2], 0.75, atol=0.08)


def test_wall_does_not_light_the_adjoining_floor():
    """The sun shines along a wall, which gets nothing; without correction floor and wall share the floor's light."""
    for correction, floor, wall in ((True, 1.0, 0.0), (False, 0.5, 0.5)):
        solver, E = solved(folded(90.0), estimator="photon_map", border_correction=correction)
        p, up = solver.receivers.positions, solver.receivers.normals[:, 2] > 0.5
        foot = (np.abs(p[:, 0]) < 1e-9) & (p[:, 2] == 0) & (p[:, 1] > 0.1) & (p[:, 1] < 0.9)
        assert (foot & up).sum() == (foot & ~up).sum() == 1
        # 10 % of noise in one receiver; its search covers only the two squares.
        assert E[foot & up] == pytest.approx(floor, abs=0.4 * floor)
        assert E[foot & ~up] == pytest.approx(wall, abs=0.4 * wall)


def test_textbook_form_is_brighter_by_one_hit():
    """k / (k - 1) on average, at every receiver that finds k; the report's tables contain this factor."""
    scene = furnace_scene(1.0, 0.5)
    _, fair = solved(scene, estimator="photon_map", neighbours=20)
    _, textbook = solved(scene, estimator="photon_map", neighbours=20, textbook=True)
    assert (textbook > fair).all()
    assert textbook.mean() / fair.mean() == pytest.approx(20 / 19, rel=0.01)


def folded(angle: float) -> Scene:
    """Two unit squares that meet along y, the second one steeper by `angle` [degrees], under the sun."""
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    flat = quad((-1, 0, 0), (1, 0, 0), (0, 1, 0), (2, 2))
    slope = quad((0, 0, 0), (c, 0, s), (0, 1, 0), (2, 2))
    return Scene(merge(flat, slope), (Material("black", (0.0, 0.0, 0.0)),), lights=(SUN,), up=UP)


def test_impact_count_at_creases_and_borders():
    """The mean over faces stops at creases, and has no border bias: flux and area are those of the same faces.

    Below the crease angle one receiver has the mean of both squares: of 1 and cos 30, by area. Above it there are two,
    each with its own square's light. At the outer border E is that of the faces there.
    """
    for angle, smooth in ((30.0, True), (60.0, False)):
        solver, E = solved(folded(angle), estimator="impact_count", photons=200_000)
        p = solver.receivers.positions
        slope = math.cos(math.radians(angle))
        fold = np.abs(p[:, 0]) < 1e-9
        assert fold.sum() == (3 if smooth else 6)
        expected = [(1 + slope) / 2] * 3 if smooth else [slope] * 3 + [1.0] * 3
        np.testing.assert_allclose(np.sort(E[fold]), expected, rtol=0.03)
        np.testing.assert_allclose(E[p[:, 0] == -1], 1.0, rtol=0.03)
        np.testing.assert_allclose(E[p[:, 0] > 0.9 * slope], slope, rtol=0.03)


def test_impact_count_is_right_at_the_edges_of_a_furnace():
    """As everywhere: 168 and 24 receivers see 200 and 65 photons each."""
    solver, E = solved(furnace_scene(1.0, 0.5), estimator="impact_count")
    p = solver.receivers.positions
    walls = ((p == 0) | (p == 1)).sum(axis=1)
    for k, tolerance in ((1, 0.02), (2, 0.03), (3, 0.1)):
        assert E[walls == k].mean() / (2 * math.pi) == pytest.approx(1, abs=tolerance)


def test_lamps_see_no_correction_where_nothing_has_a_border():
    """A sphere has the same bits with and without correction."""
    scene = Scene(sphere((0, 0, 0), 1.0, 2), (lamp(0.0),), lights=(SUN,), up=UP)
    E = [solved(scene, estimator="photon_map", photons=5000, border_correction=c)[1] for c in (True, False)]
    assert E[0].max() > 0 and np.array_equal(*E)
