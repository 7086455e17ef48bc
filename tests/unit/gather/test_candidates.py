"""Shadow rays chosen among candidates: no bias, shadow or not, and less noise than rays to random points."""

import numpy as np
import pytest

from gi_core.gather.candidates import CANDIDATES, PATHS_PER_SHADOW, candidates, join_candidates, sets_by_chance
from gi_core.gather.path_ends import starts
from gi_core.geometry.error import luminance
from gi_core.lights.area import area_lights
from gi_core.lights.lamps import Lights, delta_lights
from gi_core.lights.next_event import join_area, points_on_lamps, room_for_shadows
from gi_core.lights.sky import sky_of
from gi_core.model import Model
from gi_core.scene.types import Scene
from tests.support.photometry import luminaire
from tests.support.scene_builders import box, grey, lamp, merge, quad

M = 4  # log2 of the paths per receiver
RAYS = (1 << M) // PATHS_PER_SHADOW
PLACES = np.array([[0.2, 0.2, 0.1], [0.7, 0.4, 0.5], [0.5, 0.9, 0.8]])
NORMALS = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.8, 0.6]])


def scene(lights=()) -> Scene:
    """Return a black room with a red and a blue lamp side by side."""
    red, blue = (quad((x, 0.3, 0.95), (0, 0.4, 0), (0.3, 0, 0), (2, 2), m) for x, m in ((0.2, 1), (0.5, 2)))
    walls = merge(box((0, 0, 0), (1, 1, 1), 1, 0, inward=True), red, blue)
    colours = (lamp(1.0)._replace(emission=of) for of in ((3.0, 1.0, 0.0), (0.0, 0.5, 2.0)))
    return Scene(walls, (grey(0.0), *colours), (), tuple(lights), up=(0, 0, 1))


def lit(rays, count: int, behind: float) -> np.ndarray:
    """Return the light (3, 3) of the rays at each place; rays to points with x > behind are blocked."""
    out = np.zeros((len(PLACES), 3))
    ends = rays.origin[:count, 0] + rays.direction[:count, 0] * rays.limit[:count]
    seen = ends < behind
    np.add.at(out, rays.row[:count][seen], rays.value[:count][seen])
    return out


def found(lights, seed: int, behind: float, sets: int = 1) -> np.ndarray:
    """Return the light (3, 3) at the places by RAYS rays chosen among candidates."""
    rows, rays = np.arange(len(PLACES)), room_for_shadows(len(PLACES) * RAYS)
    some = candidates(seed, 1 << M, lights.area, sets)
    count = join_candidates(
        some, sets_by_chance(some, rows), 1 << M, starts(rows, rows, PLACES, NORMALS), lights.area, rays
    )
    return lit(rays, count, behind) / (1 << M)


def plain(model: Model, lights: Lights, m: int, seed: int, behind: float) -> np.ndarray:
    """Return the same light by 2^m rays to random points."""
    rows, rays = np.arange(len(PLACES)), room_for_shadows(len(PLACES) << m)
    paths = np.tile(np.arange(1 << m), (len(PLACES), 1))
    points = points_on_lamps(seed, m, 0, paths, lights.area)
    ends = starts(rows, rows, PLACES, NORMALS)
    return lit(rays, join_area(model.world.bsdfs, points, ends, lights.area, rays), behind) / (1 << m)


@pytest.mark.parametrize("behind", [2.0, 0.58], ids=["whole", "half in shadow"])
@pytest.mark.parametrize("sets", [1, 5])
@pytest.mark.parametrize("lamps", ["faces", "faces and a luminaire"])
def test_the_mean_is_that_of_random_points(lamps, sets, behind):
    given = (luminaire()._replace(position=(0.5, 0.5, 0.9), size=(0.4, 0.3)),) if "luminaire" in lamps else ()
    model = Model(scene(given), 1)
    lights = Lights(area_lights(model.surfaces, scene=model.scene), delta_lights(model.scene), sky_of(model.scene), 1)
    truth = np.mean([plain(model, lights, 12, seed, behind) for seed in range(8)], axis=0)
    each = np.array([found(lights, seed, behind, sets) for seed in range(1500)])
    error = each.std(axis=0) / np.sqrt(len(each))
    assert (truth.max(axis=1) > 0).all()
    assert np.allclose(each.mean(axis=0), truth, rtol=3e-3, atol=4 * error.max())
    if behind > 1:  # where nothing is in shadow, candidates leave far less noise
        usual = luminance([plain(model, lights, 3, seed, behind) for seed in range(200)]).std(axis=0)
        assert (luminance(each).std(axis=0) < 0.5 * usual).all()


def test_candidates_lie_in_strata_along_the_lamps():
    """Each stratum has its share of the probability, and points are those of the faces."""
    model = Model(scene(), 1)
    area = area_lights(model.surfaces)
    some = candidates(5, 1 << M, area)
    share = np.diff(area.cdf, prepend=0.0)
    first = np.searchsorted(area.cdf, np.arange(RAYS) / RAYS, side="right")
    faces = some.face.reshape(RAYS, CANDIDATES)
    assert (np.diff(some.face) >= 0).all() and (faces[:, 0] >= first).all()
    assert np.allclose(np.bincount(some.face, minlength=len(share)) / len(some.face), share, atol=2 / len(some.face))
    assert np.allclose(some.density, area.density[some.face]) and np.allclose(some.normal.T, area.normal[some.face])


def test_sets_are_independent_and_receivers_take_them_by_chance():
    """Receivers at one place have the light of as many sets as there are; without sets all are alike."""
    model, places = Model(scene(), 1), 2000
    area, at = area_lights(model.surfaces), np.tile(PLACES[0], (places, 1))
    light = {}
    for sets in (1, 7):
        rows, rays = np.arange(places), room_for_shadows(places * RAYS)
        ends = starts(rows, rows, at, np.tile(NORMALS[0], (places, 1)))
        some = candidates(3, 1 << M, area, sets)
        assert some.strata == RAYS and len(some.face) == sets * RAYS * CANDIDATES
        count = join_candidates(some, sets_by_chance(some, rows), 1 << M, ends, area, rays)
        light[sets] = np.zeros((places, 3))
        np.add.at(light[sets], rays.row[:count], rays.value[:count])
    assert len(np.unique(light[1], axis=0)) == 1
    _, times = np.unique(light[7], axis=0, return_counts=True)
    assert len(times) == 7 and times.min() > 0.8 * places / 7


def test_without_area_lights_there_is_no_ray():
    model = Model(Scene(box((0, 0, 0), (1, 1, 1), 1, 0, inward=True), (grey(0.5),), (), up=(0, 0, 1)), 1)
    lights = Lights(area_lights(model.surfaces), delta_lights(model.scene), sky_of(model.scene), 1)
    assert len(candidates(0, 1 << M, lights.area).pick) == 0 and not found(lights, 0, 2.0).any()
