"""Every search equals testing every pair, in hard cases: lines in the planes of discs, far

origins, coincident discs, tiny and huge radii. Sums are integers, so equal means equal bits.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest

from gi_core.base.nearest_points import hilbert_order
from gi_core.discs.region import RAYS, WHOLE, Regions
from gi_core.discs.search import SEARCHES
from gi_core.discs.search.disc_index import TRIED_CELL_RADII, _downhill, best_cell_radii
from gi_core.discs.search.predicate import Discs, Lines
from gi_core.discs.search.ray_cache import stack_spheres
from gi_core.geometry.receivers import NONE
from gi_core.model import BEHIND
from gi_core.photons.flux_sums import Sums

COUNT = 600  # discs, and lines
LAMPS = 3
RADII = (0.003, 0.05, 0.4, 3.0)  # in a unit cube


class SearchCase(NamedTuple):
    discs: Discs
    lines: Lines


def case(radius: float) -> SearchCase:
    rng = np.random.default_rng(7)
    p = rng.random((COUNT, 3))
    p[: COUNT // 3, 2] = 0.25  # a floor
    p[COUNT // 3 : COUNT // 3 + 20] = p[0]  # all in one place
    n = rng.normal(size=(COUNT, 3))
    n[: COUNT // 2] = np.eye(3)[rng.integers(0, 3, COUNT // 2)]
    n[: COUNT // 3] = (0, 0, 1)
    n /= np.sqrt((n * n).sum(axis=1))[:, None]
    back = np.full(COUNT, NONE, np.int32)
    front, behind = np.arange(0, COUNT, 4), np.arange(1, COUNT, 4)
    p[behind], n[behind] = p[front], -n[front]
    back[front], back[behind] = behind, BEHIND
    row = np.where(np.arange(COUNT) % 5 == 0, np.arange(COUNT), WHOLE).astype(np.int32)
    reach = rng.integers(0, 256, (COUNT, RAYS, 2)).astype(np.uint8)
    area = np.full(COUNT, math.pi * radius * radius)
    area[rng.integers(0, COUNT, 30)] = 0.0  # nothing can arrive
    own = rng.integers(-1, 8, COUNT).astype(np.int32)
    discs = Discs(p.astype(np.float32), n.astype(np.float32), own, back, np.float32(radius), Regions(row, reach, area))

    a, b = rng.random((COUNT, 3)), rng.random((COUNT, 3))
    a[:50], b[:50] = p[:50], p[50:100]  # from disc to disc, in the plane of the floor
    a[50:100] += 3000.0 * rng.normal(size=(50, 3))  # from far away
    b[100:150] = a[100:150] + [0, 0, 1]  # along an axis
    b[150:200] = p[150:200]  # through middles
    b[200:250, 2] = a[200:250, 2] + 1e-6 * rng.normal(size=50)  # grazing the floor and each other
    a[200:250, 2] = 0.25
    b[250] = a[250]  # no line at all
    # Through points just inside the rims: far from their origins, and at slopes where rounding decides.
    rim = np.cross(n, rng.normal(size=(COUNT, 3)))
    rim *= 0.999 * radius / np.sqrt((rim * rim).sum(axis=1))[:, None]
    b[50:100] = (p + rim)[50:100]
    way = np.cross(n, rng.normal(size=(COUNT, 3))) + 10.0 ** rng.uniform(-7, -2, (COUNT, 1)) * n
    a[300:], b[300:] = (p + rim - way)[300:], (p + rim + way)[300:]
    a, b = a.astype(np.float32), b.astype(np.float32)
    d = (b - a).astype(np.float64)
    length = np.sqrt((d * d).sum(axis=1))
    d = (d / np.where(length > 0, length, 1)[:, None]).astype(np.float32)
    stop = length.astype(np.float32) + np.float32(1e-4)
    high = stop + np.where(np.arange(COUNT) % 2, np.float32(2 * radius), np.float32(0))
    flux = rng.integers(1, 1 << 20, (COUNT, 3)).astype(np.int32)
    patches = rng.integers(-1, 8, (COUNT, 3)).astype(np.int32)
    lamp = rng.integers(0, LAMPS, COUNT).astype(np.uint8)
    low, touches = np.full(COUNT, 1e-4, np.float32), np.stack([a, b, b], axis=1)
    lines = Lines(a, d, low, stop, high, flux, lamp, patches, touches)
    return SearchCase(discs, lines)


def found(search, c: SearchCase, sign: int = 1) -> tuple[int, np.ndarray, np.ndarray]:
    sums = Sums.zeros(COUNT, 3 * LAMPS)
    return search.accumulate(c.lines, sign, sums), sums.flux, sums.touched


@pytest.fixture(params=RADII, scope="module")
def expected(request) -> tuple[SearchCase, tuple]:
    c = case(request.param)
    return c, found(SEARCHES["brute_force"](c.discs), c)


@pytest.mark.slow
@pytest.mark.parametrize("name", SEARCHES)
def test_every_search_finds_the_same(name, expected):
    c, (count, flux, touched) = expected
    assert count > 20
    search = SEARCHES[name](c.discs)
    got = found(search, c)
    assert got[0] == count
    assert np.array_equal(got[1], flux)
    assert np.array_equal(got[2], touched)
    assert np.array_equal(found(search, c, sign=-1)[1], -flux)


@pytest.mark.parametrize("name", SEARCHES)
def test_no_lines_and_no_discs(name):
    c = case(0.1)
    nothing = c._replace(lines=Lines(*(a[:0] for a in c.lines)))
    assert found(SEARCHES[name](c.discs), nothing)[0] == 0
    none = Discs(*(a[:0] for a in c.discs[:4]), c.discs.radius, Regions(*(a[:0] for a in c.discs.regions)))
    assert SEARCHES[name](none).accumulate(c.lines, 1, Sums.zeros(COUNT, 3 * LAMPS)) == 0


def test_batches_of_lines_are_the_whole():
    c = case(0.1)
    whole = found(SEARCHES["ray_cache"](c.discs), c)
    many = Lines(*(np.concatenate([a] * 60) for a in c.lines))  # more than one batch
    count, flux, _ = found(SEARCHES["ray_cache"](c.discs), c._replace(lines=many))
    assert count == 60 * whole[0]
    assert np.array_equal(flux, 60 * whole[1])


def test_hilbert_order_steps_to_a_neighbour():
    side = 8
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    steps = np.abs(np.diff(grid[hilbert_order(grid)], axis=0)).sum(axis=1)
    assert steps.max() == 1


def test_spheres_hold_their_discs_whole_and_nest():
    points = np.random.default_rng(3).random((2000, 3))
    points = points[hilbert_order(points)]
    s = stack_spheres(points, 0.02)
    assert len(s.first) > 100
    assert (s.first[0], s.last[0], s.behind[0]) == (0, len(points), len(s.first))
    for k in range(len(s.first)):
        off = np.sqrt(((points[s.first[k] : s.last[k]] - s.centre[k]) ** 2).sum(axis=1))
        assert (off + 0.02 <= s.radius[k]).all()
        if k:
            p = s.parent[k]
            assert s.first[p] <= s.first[k] and s.last[k] <= s.last[p] and k < s.behind[k] <= s.behind[p]
            assert s.depth[k] == s.depth[p] + 1


def test_the_best_cells_are_found_downhill():
    for best in TRIED_CELL_RADII:
        assert _downhill(lambda r, best=best: abs(r - best)) == best
    crowded, apart = case(0.4).discs, case(0.003).discs
    every = np.arange(COUNT)
    assert best_cell_radii(crowded, every) < best_cell_radii(apart, every)
