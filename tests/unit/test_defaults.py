"""The rule that chooses radius and photons, and the error and cost that it predicts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gi_core import defaults
from gi_core.discs.search.disc_index import CELL_RADII, discs_in_cells
from gi_core.discs.search.predicate import Discs, Lines, lines, to_list
from gi_core.geometry.error import luminance, relative_error
from gi_core.model import Model
from gi_core.photons.paths import segments_of
from gi_core.photons.trace import trace_background
from gi_core.scene.types import Camera, Defaults, DirectionalLight, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import box, floor, grey, lamp, merge, plane_scene, quad, solve, sphere

pytestmark = pytest.mark.slow

SUN = DirectionalLight("sun", (0.0, 0.0, -1.0), (1.0, 1.0, 1.0))
LAMP = quad((0.3, 0.3, 0.99), (0, 0.4, 0), (0.4, 0, 0), (1, 1), 1)


def room(*furniture) -> Scene:
    """A unit room with a lamp; a light value every 2 cm."""
    walls = box((0, 0, 0), (1, 1, 1), 50, 0, inward=True)
    return Scene(merge(walls, LAMP, *furniture), (grey(0.5), lamp(10.0)), up=(0, 0, 1))


def crates(count: int) -> list:
    """Small boxes, half as wide as their distance, on the floor and in the air."""
    step = 0.8 / count
    along = 0.1 + step * np.arange(count)
    corners = [(x, y, z) for x in along for y in along for z in (0.0, 0.3, 0.6)]
    return [box(c, np.add(c, step / 2), 1, 0) for c in corners]


def lit_places(model: Model) -> defaults.Places:
    return defaults.places(model, model.pilot, *model.lit_part[:2], 1.0)


def test_furniture_gets_a_smaller_radius_than_flat_ground():
    even = defaults.choose(Model(room()), None, None, None)
    assert even.radius == pytest.approx(defaults.RADIUS_SHARE * even.scene_size, rel=0.05)
    furnished = defaults.choose(Model(room(*crates(12))), None, None, None)
    assert furnished.radius < 0.8 * even.radius
    assert furnished.predicted.bias > 2 * even.predicted.bias


@pytest.mark.parametrize("wide", [2.0, 1000.0])
def test_a_sky_that_is_a_mesh_leaves_the_radius(wide):
    """The box of the light's hits was that of the sky, which catches most photons of all lamps."""
    dome = sphere((0.5, 0.5, 0.5), wide, 2, 1)
    bare = merge(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (50, 50), 0), dome._replace(faces=dome.faces[:, ::-1]))
    assert defaults.choose(Model(replace(room(), static=bare)), None, None, None).scene_size == pytest.approx(1, 0.05)


def test_photons_reach_the_noise_limit_or_the_time_or_memory_limit(monkeypatch):
    model = Model(room())
    chosen = defaults.choose(model, None, None, None)
    assert chosen.predicted.noise == pytest.approx(defaults.LEAST_NOISE, rel=0.05)  # two digits of photons
    monkeypatch.setattr(defaults, "MOST_SECONDS", 1.0)
    hurried = defaults.choose(model, None, None, None)
    assert hurried.photons < chosen.photons
    assert hurried.predicted.seconds == pytest.approx(1.0, rel=0.05)
    monkeypatch.setattr(defaults, "MOST_PHOTONS", 50_000)
    assert defaults.choose(model, None, None, None).photons == 50_000


def test_given_settings_are_kept_and_photons_do_not_change_the_radius():
    model = Model(room())
    free = defaults.choose(model, None, None, None)
    assert defaults.choose(model, 1000, None, None)[:2] == (1000, free.radius)
    wide = defaults.choose(model, None, 2 * free.radius, None)
    assert wide.radius == 2 * free.radius
    assert wide.photons < free.photons
    assert defaults.choose(model, 77, 0.3, 9)[:3] == (77, 0.3, 9)
    said = Model(replace(room(), defaults=Defaults(photons=500, radius=0.2, scene_size=3.0)))
    assert defaults.choose(said, None, None, None)[:2] == (500, 0.2)
    assert defaults.choose(said, None, None, None).scene_size == 3.0


@pytest.mark.parametrize(("photons", "share"), [(20_000, 1.0), (2_000, 0.0), (100_000_000, 0.0)])
def test_k_of_the_photon_map_is_the_hits_on_a_disc(photons, share):
    """So that both smooth alike: hits spread over all faces. Within bounds."""
    model = Model(room())
    chosen = defaults.choose(model, photons, 0.1, None)
    on_disc = len(model.pilot.hits) / model.pilot.photons * photons * math.pi * 0.1**2 / model.surfaces.areas.sum()
    expected = on_disc if share else defaults.NEIGHBOURS if photons < 20_000 else defaults.MOST_NEIGHBOURS
    assert chosen.neighbours == pytest.approx(expected, rel=0.5 * share)


def test_the_choice_is_always_the_same():
    one, other = (defaults.choose(Model(room(), *threads), None, None, None) for threads in ((1,), ()))
    assert one[:4] == other[:4]


def test_a_chosen_number_is_the_one_that_its_digits_mean():
    """As info prints them and --radius reads them: typed, they give the same bits."""
    for e in range(-5, 3):
        for k in range(10, 100):
            typed = float(f"{k}e{e}")
            assert defaults._round(1.001 * typed) == defaults._round(typed) == typed == float(f"{typed:.4g}")


def test_scenes_without_light_or_without_a_hit():
    away = quad((0, 0, 1), (1, 0, 0), (0, 1, 0), (1, 1), 1)
    over = Scene(merge(floor(), away), (grey(0.5), lamp(10.0)), up=(0, 0, 1))  # a lamp that shines upwards
    for scene in (replace(room(), materials=(grey(0.5), grey(0.5))), plane_scene(), over):
        chosen = defaults.choose(Model(scene), None, None, None)
        assert chosen.photons == defaults.FEWEST_PHOTONS
        assert chosen.predicted is None
        assert chosen.radius > 0


def test_no_radius_is_far_below_the_distance_between_receivers():
    walls = box((0, 0, 0), (1, 1, 1), 12, 0, inward=True)  # a value every 8 cm
    scene = Scene(merge(walls, LAMP, *crates(12)), (grey(0.5), lamp(10.0)), up=(0, 0, 1))
    lit = lit_places(Model(scene))
    chosen = defaults.choose(Model(scene), None, None, None)
    assert chosen.radius >= 0.95 * min(0.025 * chosen.scene_size, 0.5 * lit.spacing)


def test_noise_of_even_light_is_poisson():
    """A sun over a floor of 4 m2: a photon hits a disc with the probability of its share of the sunlit disc."""
    model = Model(plane_scene(SUN, divisions=40))
    lit = lit_places(model)
    density = 1 / (math.pi * model.emitters.parameters[0, 6] ** 2)  # photons start on a disc that covers all
    assert np.median(lit.density) == pytest.approx(density, rel=0.1)
    expected = density * math.pi * 0.1**2 * 10_000
    counting = defaults.SOBOL * math.sqrt(2 / math.pi / expected)
    assert defaults.noise(lit, 0.1, 10_000) == pytest.approx(counting, rel=0.1)
    assert defaults.noise(lit, 0.1, defaults.photons_for(lit, 0.1, 0.03)) == pytest.approx(0.03)


def test_predicted_noise_is_near_that_of_two_solutions():
    scene = room()
    lit = lit_places(Model(scene))
    one, two = (Solver(scene, photons=40_000, radius=0.05, seed=s) for s in (1, 2))
    one.solve(), two.solve()
    w = one.receivers.areas
    mean = 0.5 * (one.irradiance + two.irradiance)
    assert (luminance(mean) > 0).any()
    found = relative_error(one.irradiance, mean, w).l1 * math.sqrt(2)  # off its own mean by half the difference
    assert 0.6 < found / defaults.noise(lit, 0.05, 40_000) < 1.4


def test_uneven_ground_by_hand():
    """A strip as wide as 2 m: a disc of 0.2 m reaches over its rim from 0.14 m away, in up to half the directions."""
    model = Model(plane_scene(SUN, divisions=40))
    lit = lit_places(model)
    assert len(lit.positions) > 1000
    middle = lit._replace(positions=np.array([[0.0, 0.0, 0.0]]), normals=np.array([[0.0, 0.0, 1.0]]))
    rim = middle._replace(positions=np.array([[0.999, 0.0, 0.0]]))
    assert defaults.uneven(model, middle, 0.2) == 0
    assert defaults.uneven(model, rim, 0.2) == pytest.approx(0.5, abs=0.13)  # of eight directions, one along the rim
    wall = quad((0.05, -1, -0.5), (0, 2, 0), (0, 0, 1))
    walled = Model(Scene(merge(floor(2.0, 40), wall), (grey(0.5),), lights=(SUN,), up=(0, 0, 1)))
    assert defaults.uneven(walled, middle, 0.2) == pytest.approx(3 / 8, abs=0.13)  # 0.14 cos a > 0.05


def test_lit_places_are_seen_by_the_camera():
    camera = Camera((0.5, 0.5, 0.5), (0.5, 0.5, 0.0), 40.0)  # from the middle of the room down to its floor
    seen = lit_places(Model(replace(room(), camera=camera)))
    assert len(seen.positions) >= defaults.FEWEST_HITS
    assert (seen.positions[:, 2] < 1e-5).all()
    away = Camera((5.0, 5.0, 5.0), (9.0, 9.0, 9.0), 40.0)
    assert (lit_places(Model(replace(room(), camera=away))).positions[:, 2] > 0.5).any()


def disc_tests(discs: Discs, over: Lines, points: int = 8) -> float:
    """Return the disc tests of lines in a uniform grid; its occupancy is sampled at `points` points of each line."""
    cell, corner, shape, count = discs_in_cells(discs, np.flatnonzero(to_list(discs)), CELL_RADII)
    origin, direction = over.origin.astype(np.float64), over.direction.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = (np.stack([corner, corner + shape * cell])[:, None] - origin) / direction
    first = np.maximum(over.low, np.nan_to_num(walls.min(axis=0), nan=-np.inf).max(axis=1))
    last = np.minimum(over.high, np.nan_to_num(walls.max(axis=0), nan=np.inf).min(axis=1))
    inside = last > first
    origin, direction, first, length = origin[inside], direction[inside], first[inside], (last - first)[inside]
    at = origin + (first + ((np.arange(points) + 0.5) / points)[:, None] * length)[..., None] * direction
    at = np.floor((at - corner) / cell).astype(np.int64).clip(0, shape - 1)
    held = count[np.ravel_multi_index(tuple(np.moveaxis(at, -1, 0)), tuple(shape))].mean(axis=0)
    return float(((1 + np.abs(direction).sum(axis=1) * length / cell) * held).sum())


@pytest.mark.parametrize("radius", [0.01, 0.03])
def test_predicted_work_is_near_that_of_the_disc_index(radius):
    model = Model(room(*crates(12)))
    solver = solve(model.scene, photons=64, radius=radius)
    discs = solver.frame.background.estimate.searches[0].discs
    paths, _ = trace_background(model.accelerator, model.world, model.static, model.emitters, 3, 0, 2000)
    s = segments_of(paths, 0, 2000)
    over = lines(s, model.static.rotation[0], model.static.position[0], model, radius)
    counted = disc_tests(discs, over) / 2000
    _, predicted = defaults.work(model, paths, radius)
    assert 0.6 < predicted / counted < 1.6
