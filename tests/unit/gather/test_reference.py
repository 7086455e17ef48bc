"""The reference against closed forms, and against other ways to compute the same value.

Receivers drawn by area, the reference there, and errors without its noise.
"""

import math
import threading
import time

import numpy as np
import pytest

from gi_core.gather import path_tracer
from gi_core.gather.reference import Gatherer, ReferenceRounds, reference_irradiance
from gi_core.gather.reference_sample import ReferenceSample, draw_by_area, gather_sample, gather_until
from gi_core.geometry.error import relative_error
from gi_core.geometry.surfaces import evaluation_points, flatten
from gi_core.lights.kinds import arrived
from gi_core.lights.lamps import delta_lights
from gi_core.model import Model
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import DirectionalLight, Mobile, PointLight, Pose, Scene, SkyLight, SpotLight
from tests.support import closed_form
from tests.support import scene_builders as build
from tests.support.scene_builders import ROOM_POINTS, coloured_room, plane_scene
from tests.support.significance import z_test

LIFT = 1e-4  # relative: a lifted point is some 1e-5 of the scene nearer to a delta light
UP = np.array([0.0, 0.0, 1.0])


def points(*rows, normal=UP):
    P = np.array(rows, float)
    return P, np.tile(np.asarray(normal, float), (len(P), 1))


ALONG_X = points(*((x, 0.0, 0.0) for x in (0.0, 0.2, 0.5, 0.9)))


def test_point_light_over_a_plane():
    scene = build.plane_scene(PointLight("p", (0, 0, 0.7), (1.0, 2.0, 4.0)))
    E, error = reference_irradiance(scene, *ALONG_X, paths=3, seed=0)
    expected = closed_form.point_over_plane(1 / (4 * math.pi), 0.7, ALONG_X[0][:, 0])
    assert E == pytest.approx(expected[:, None] * [1, 2, 4], rel=LIFT)
    assert error.max() < 1e-12


def test_spot_over_a_plane():
    scene = build.plane_scene(SpotLight("s", (0, 0, 1), (0, 0, -2), (3.0,) * 3, 20.0, 40.0))
    E, _ = reference_irradiance(scene, *ALONG_X, paths=2, seed=0)
    ci, co = math.cos(math.radians(20)), math.cos(math.radians(40))
    expected = closed_form.spot_over_plane(3.0, 1.0, ALONG_X[0][:, 0], ci, co)
    assert expected[-1] == 0 and expected[2] > 0
    assert E[:, 0] == pytest.approx(expected, rel=1e-3, abs=0)


def test_directional_light_and_its_shadow():
    """A 0.4 m square mobile at height 0.3 m under light at 45 degrees shades x in [0.1, 0.5]."""
    tile = Mobile("tile", build.quad((-0.2, -0.2, 0), (0.4, 0, 0), (0, 0.4, 0)), Pose((0, 0, 0.3)))
    scene = build.plane_scene(DirectionalLight("d", (1, 0, -1), (2.0,) * 3, 0.0), mobiles=(tile,))
    E, _ = reference_irradiance(scene, *points(*((x, 0, 0) for x in (0.05, 0.15, 0.45, 0.55))), paths=2, seed=0)
    lit = closed_form.directional(2.0, (1, 0, -1), UP)
    assert E[:, 1] == pytest.approx([lit, 0, 0, lit], rel=LIFT)


def test_several_delta_lights_add_up():
    lights = (
        PointLight("a", (0.3, 0.1, 0.7), (1.0, 0.0, 0.2)),
        PointLight("b", (-0.4, 0.2, 0.5), (0.1, 2.0, 0.3)),
        DirectionalLight("c", (0.1, 0.2, -1), (0.02, 0.03, 0.04)),
        SpotLight("d", (0.5, 0, 1.0), (0, 0, -1), (0.1,) * 3, 10.0, 60.0),
    )
    P, N = ALONG_X
    together, error = reference_irradiance(build.plane_scene(*lights), P, N, 4000, 1)
    alone = sum(reference_irradiance(build.plane_scene(light), P, N, 2, 1)[0] for light in lights)
    z_test(together, alone, np.hypot(error, LIFT * alone), "four lights")


def test_spot_falloff():
    scene = build.plane_scene(SpotLight("s", (0, 0, 1), (0, 0, -1), (1.0,) * 3, 15.0, 50.0))
    lights = delta_lights(scene)
    for x in np.linspace(0, 1.5, 20):
        s, *_ = arrived(lights.kind[0], lights.parameters[0], lights.tables, (x, 0.0, 0.0), (0.0, 0.0, 1.0), 9.0)
        inner, outer = (math.cos(math.radians(a)) for a in (15, 50))
        assert s == pytest.approx(closed_form.spot_over_plane(1.0, 1.0, x, inner, outer), abs=1e-12)


def test_parallel_rectangles():
    P, N = points((0, 0, 0), (0.5, 0.1, 0), (-0.9, 0.9, 0))
    E, error = reference_irradiance(build.lamp_over_floor(10.0), P, N, 20000, 2)
    expected = [closed_form.parallel_rectangle(10.0, -0.5, 0.5, -0.5, 0.5, 1.0, x, y) for x, y, _ in P]
    z_test(E[:, 0], expected, error[:, 0], "parallel rectangles")
    assert (error[:, 0] < 0.005 * np.array(expected)).all()


def test_at_a_two_wall_corner():
    """A floor point beside an emitting wall sees it under Lambert's polygon, up to the edge itself.

    There 1 / d^2 has no bound: sampling the wall alone would have infinite variance.
    """
    P, N = points((0.5, 0, 0), (0.1, 0.2, 0), (0.01, 0, 0), (1e-3, 0.3, 0), (1e-4, 0, 0))
    E, error = reference_irradiance(build.corner_scene(2.0), P, N, 200_000, 3)
    wall = [(0, -0.5, 0), (0, 0.5, 0), (0, 0.5, 1), (0, -0.5, 1)]
    expected = [closed_form.lambert_polygon(2.0, wall, p, UP) for p in P]
    z_test(E[:, 0], expected, error[:, 0], "two-wall corner")
    assert expected[-1] == pytest.approx(2 * math.pi * closed_form.corner_view(math.pi / 2), rel=1e-3)


@pytest.mark.parametrize("tilt", [0.0, 60.0, 90.0, 150.0])
def test_sky_on_a_tilted_plane(tilt):
    b = math.radians(tilt)
    square = build.quad((-0.1, -0.1, 0), (0.2, 0, 0), (0, 0.2, 0))
    scene = Scene(square, (build.BLACK,), (), (SkyLight("sky", (1.0, 2.0, 3.0)),), up=(0.0, 0.0, 1.0))
    E, error = reference_irradiance(
        scene, *points((0, 0, 1.0), normal=(math.sin(b), 0, math.cos(b))), paths=20000, seed=5
    )
    z_test(E[0], closed_form.sky(1.0, math.cos(b)) * np.array([1, 2, 3]), error[0] + 1e-9, "tilted sky")


@pytest.mark.parametrize("reflectance", [0.0, 0.5, 0.9])
def test_furnace(reflectance):
    P, N = points((0.5, 0.5, 0), (0.01, 0.5, 0), (1e-3, 1e-3, 0), (0.3, 0.4, 0.5))
    scene = build.furnace_scene(2.0, reflectance)
    E, error = reference_irradiance(scene, P, N, 10000, 6)
    z_test(E[:, 0], closed_form.furnace(2.0, reflectance), error[:, 0], "furnace")


def test_a_two_sided_sphere_is_black_inside_and_lit_outside():
    scene = build.sphere_scene(DirectionalLight("d", (0, 0, -1), (3.0,) * 3, 0.0))
    surfaces, receivers = flatten(scene)
    E, _ = reference_irradiance(scene, *evaluation_points(surfaces, receivers), paths=4, seed=9)
    outside = (receivers.positions * receivers.normals).sum(axis=1) > 0
    assert outside.sum() * 2 == len(outside)
    assert not E[~outside].any()
    lit = receivers.normals[:, 2] > 0.3
    expected = closed_form.directional(3.0, (0, 0, -1), receivers.normals)
    assert E[outside & lit, 0] == pytest.approx(expected[outside & lit], rel=LIFT)
    assert not E[outside & (receivers.normals[:, 2] < -0.2)].any()


def test_back_of_a_one_sided_wall_neither_emits_nor_reflects():
    """A lamp seen from behind is black and so is a wall; both still block the sky."""
    lid = build.quad((-5, -5, 0.1), (10, 0, 0), (0, 10, 0), (1, 1), 1)  # front and emission face up
    scene = Scene(
        build.merge(build.floor(), lid), (build.grey(0.9), build.lamp(5.0, 0.9)), (), (SkyLight("s", (1.0,) * 3),),
        up=(0.0, 0.0, 1.0),
    )  # fmt: skip
    P, N = points((0, 0, 0), (0.3, 0.3, 0))
    assert reference_irradiance(scene, P, N, 2000, 10)[0].max() < 0.05 * math.pi
    assert reference_irradiance(scene, P + UP, N, 2000, 10)[0] == pytest.approx(math.pi)


def test_mobile_moved_by_pose_equals_one_built_there():
    mesh = build.box((-0.1,) * 3, (0.1,) * 3)
    there = Pose((0.6, 0.3, 0.2), axis_angle((0, 1, 1), 30))
    moved, at_rest = (build.coloured_room((Mobile("box", mesh, p),)) for p in (Pose((0.2, 0.2, 0.2)), there))
    a = reference_irradiance(moved, *build.ROOM_POINTS, 2000, 12, poses={"box": there})
    b = reference_irradiance(at_rest, *build.ROOM_POINTS, 2000, 12)
    z_test(a[0], b[0], 1e-4 + 0 * b[0], "same paths")  # the worlds differ by the lift: some 1e-6
    away = reference_irradiance(moved, *build.ROOM_POINTS, 2000, 12)[0]
    assert np.abs(a[0] - away).max() > 1e-3


def test_same_seed_same_answer_and_points_do_not_depend_on_each_other():
    scene = build.coloured_room()
    P, N = build.ROOM_POINTS
    a, b = (reference_irradiance(scene, P, N, 500, 13) for _ in range(2))
    assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
    first = reference_irradiance(scene, P[:1], N[:1], 500, 13)[0]
    assert first[0] == pytest.approx(a[0][0], rel=1e-12)
    assert not np.array_equal(a[0], reference_irradiance(scene, P, N, 500, 14)[0])


def test_any_number_of_paths_at_once_gives_the_same_bits(monkeypatch):
    P, N = (np.tile(a, (20, 1)) for a in build.ROOM_POINTS)
    runs = []
    for step in (1 << 16, 7, 350):
        monkeypatch.setattr("gi_core.gather.reference.PATHS_AT_ONCE", step)
        runs.append(reference_irradiance(build.coloured_room(), P, N, 5, 16))
    for run in runs[1:]:
        assert np.array_equal(run[0], runs[0][0]) and np.array_equal(run[1], runs[0][1])


def test_no_lights_no_points_no_normal():
    scene = build.plane_scene()
    assert not reference_irradiance(scene, *ALONG_X, paths=5, seed=0)[0].any()
    E, error = reference_irradiance(scene, np.zeros((0, 3)), np.zeros((0, 3)), 5, 0)
    assert E.shape == error.shape == (0, 3)
    lit = build.plane_scene(SkyLight("s", (1.0,) * 3))
    assert reference_irradiance(lit, *points((0, 0, 0), normal=(0, 0, 0)), paths=5, seed=0)[0].tolist() == [[0, 0, 0]]
    assert np.isinf(reference_irradiance(lit, *points((0, 0, 0)), paths=1, seed=0)[1]).all()


def test_bad_arguments_are_refused():
    scene = build.plane_scene(mobiles=(build.box_mobile("crate"),))
    P, N = ALONG_X
    with pytest.raises(ValueError, match=r"shape \(n, 3\)"):
        reference_irradiance(scene, P, N[:1], 1, 0)
    with pytest.raises(ValueError, match="finite"):
        reference_irradiance(scene, P * np.nan, N, 1, 0)
    with pytest.raises(ValueError, match="paths"):
        reference_irradiance(scene, P, N, 0, 0)
    with pytest.raises(SceneError, match='no mobile is called "box"; there is "crate"'):
        reference_irradiance(scene, P, N, 1, 0, poses={"box": Pose()})
    with pytest.raises(SceneError, match="rigid"):
        reference_irradiance(scene, P, N, 1, 0, poses={"crate": 2 * np.eye(4)})


def test_a_step_at_rest_takes_all_threads(monkeypatch):
    """A core traces some 5,000 paths in the 10 ms of a step."""
    model, taken = Model(build.plane_scene(PointLight("p", (0, 0, 0.7), (1.0, 2.0, 4.0))), threads=4), set()
    gatherer = Gatherer(model.scene, *ALONG_X, seed=0, model=model)
    traced = path_tracer.PathTracer.follow

    def follow(*arguments, **_):
        taken.add(threading.get_ident())
        time.sleep(0.05)  # so that no thread can take two parts
        return traced(*arguments)

    monkeypatch.setattr(path_tracer.PathTracer, "follow", follow)
    gatherer.paths(np.arange(4), 0, 1 << 10)
    assert len(taken) == 4


def test_draws_are_by_area_with_repeats():
    areas = np.array([0.0, 1.0, 3.0, 0.0, 4.0])
    rows, times = draw_by_area(np.array([1, 2, 4]), areas, 8000, 1)
    assert rows.tolist() == [1, 2, 4] and times.sum() == 8000
    assert np.abs(times - [1000, 3000, 4000]).max() < 200  # four deviations


def test_a_sum_over_draws_has_the_mean_of_the_sum_by_area():
    random = np.random.default_rng(1)
    areas, f = random.exponential(size=400), random.random(400)
    means = []
    for seed in range(300):
        rows, times = draw_by_area(np.arange(400), areas, 60, seed)
        means.append((times * f[rows]).sum() / 60)
    error = np.std(means, ddof=1) / np.sqrt(len(means))
    assert abs(np.mean(means) - (areas * f).sum() / areas.sum()) < 4 * error


def test_reference_noise_is_subtracted():
    random = np.random.default_rng(2)
    noisy = 1 + 0.05 * random.standard_normal((4000, 1)) * np.ones(3)
    sample = ReferenceSample(np.arange(4000), np.ones(4000), noisy, 0.05 * np.sqrt(2 / np.pi), 1.0)
    assert sample.error(np.ones((4000, 3))) < 0.01
    wrong = 1 + 0.1 * random.standard_normal((4000, 1)) * np.ones(3)
    assert sample.error(wrong) == pytest.approx(0.1 * np.sqrt(2 / np.pi), rel=0.05)
    assert sample._replace(irradiance=np.zeros((4000, 3))).squared_error(wrong) == 0


def test_gathering_ends_at_the_noise_at_the_paths_and_without_light():
    scene, weights = coloured_room(), np.ones(len(ROOM_POINTS[0]))
    rounds = ReferenceRounds(scene, *ROOM_POINTS, 3, weights)
    *on_the_way, last = gather_until(rounds, weights, 0.02)
    assert on_the_way and last.noise <= 0.02 and last.fraction == 1 and rounds.state is last.state
    assert len(list(gather_until(rounds, weights, 0.02))) == 1, "good enough: nothing is gathered"
    *_, few = gather_until(ReferenceRounds(scene, *ROOM_POINTS, 3, weights), weights, 1e-9, 500)
    assert few.noise > 0.02 and few.state.rounds > 1
    dark = ReferenceRounds(plane_scene(), *ROOM_POINTS, 3, weights)
    *_, none = gather_until(dark, weights, 0.02)
    assert np.isnan(none.noise)


def test_a_sample_is_the_reference_at_its_receivers():
    model = Model(coloured_room())
    rows, weights = draw_by_area(np.arange(len(model.object_receivers.areas)), model.object_receivers.areas, 50, 0)
    a, b = ([*gather_sample(model, model.start_poses(), rows, weights, seed, 0.03)][-1] for seed in (1, 2))
    both = np.hypot(a.noise, b.noise)
    assert 0.3 * both < relative_error(a.irradiance, b.irradiance, weights).l1 < 2 * both
