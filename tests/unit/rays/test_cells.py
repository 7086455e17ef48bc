"""Cells list the triangles that they touch and no others, and few of them are tested per ray."""

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.rays.accelerator import _nearest
from gi_core.rays.cells import MOST_LISTED
from gi_core.rays.structures import STRUCTURES, new_ray
from gi_core.rays.triangles import CELLS, TESTS, touches
from gi_core.scene.types import Mesh
from tests.support.ray_cases import directions, of_corners, room, soup

TREES = ["octree", "binary_tree", "bsp"]
OTHERS = [name for name in STRUCTURES if name not in ("embree", "none")]


def overlap(corners: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether a triangle overlaps a box: it is clipped by the six sides (Sutherland and Hodgman)."""
    polygon = list(corners)
    for axis in range(3):
        for sign, at in ((1, low[axis]), (-1, -high[axis])):
            kept = []
            for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
                da, db = sign * a[axis] - at, sign * b[axis] - at
                if da >= 0:
                    kept.append(a)
                if (da >= 0) != (db >= 0):
                    kept.append(a + da / (da - db) * (b - a))
            polygon = kept
    return bool(polygon)


@pytest.mark.parametrize("thin", [1.0, 0.01])
def test_a_triangle_touches_a_box_where_it_overlaps_it(thin):
    """Triangles of any shape, or slivers, and boxes beside them; the box of a sliver is far larger than the sliver."""
    rng, n = np.random.default_rng(0), 3000
    a = rng.uniform(-1, 1, (n, 1, 3))
    b, c = a + rng.uniform(-1, 1, (n, 1, 3)), a + thin * rng.uniform(-1, 1, (n, 1, 3))
    corners = np.concatenate([a, b, c], axis=1).astype(np.float32)
    low = rng.uniform(-1, 1, (n, 3))
    high = low + rng.uniform(0.05, 0.5, (n, 3))
    flat = corners.reshape(-1, 9)
    found = np.array([touches(flat, k, 0.0, *low[k], *high[k]) for k in range(n)])
    truth = np.array([overlap(corners[k].astype(np.float64), low[k], high[k]) for k in range(n)])
    assert np.array_equal(found, truth) and truth.sum() > 20
    grown = np.array([touches(flat, k, 0.1, *low[k], *high[k]) for k in range(n)])
    beside = np.array([overlap(corners[k].astype(np.float64), low[k] - 0.1, high[k] + 0.1) for k in range(n)])
    assert np.array_equal(grown, beside)


def cost(name: str, mesh: Mesh, rays: int = 2000) -> tuple[float, float]:
    """Return cells entered and triangles tested per random ray from within the mesh's box."""
    rng = np.random.default_rng(0)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    o = (low + rng.uniform(0.05, 0.95, (rays, 3)) * (high - low)).astype(np.float32)
    scenes, ray, far = STRUCTURES[name].build([(mesh.vertices, mesh.faces)]), new_ray(), np.full(rays, 1e4, np.float32)
    _nearest(scenes, 0, 0, ray, o, directions(rng, rays), far, np.empty(rays, np.float32), np.empty(rays, np.int32))
    cells, tests = ray.view(np.int32)[[CELLS, TESTS]] / rays
    return float(cells), float(tests)


@pytest.fixture(scope="module")
def furnished_room() -> Mesh:
    """The shipped living room: 32,210 triangles, walls in one plane and close slivers among them."""
    return load_scene("living_room").static


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.slow
def test_a_furnished_room_costs_few_tests_per_ray(name, furnished_room):
    cells, tests = cost(name, furnished_room)
    assert 1 < cells < 60 and tests < 60


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("make", [lambda: soup(100, 1, 0.2), lambda: of_corners(room_corners(100))])
def test_from_100_triangles_on_each_structure_does_less_than_none(name, make):
    cells, tests = cost(name, make())
    assert cells + tests < 50


def room_corners(n: int) -> np.ndarray:
    """Return n triangles (n, 3, 3) of a closed room, evenly chosen."""
    mesh = room()
    return mesh.vertices[mesh.faces[np.linspace(0, len(mesh.faces) - 1, n).astype(int)]]


@pytest.mark.parametrize("name", TREES)
def test_triangles_in_one_place_end_the_division(name):
    """Equal triangles cannot be divided: cells list each at most MOST_LISTED times, but for the last level."""
    corners = np.random.default_rng(0).uniform(-1, 1, (1, 3, 3))
    mesh = of_corners(np.repeat(corners, 40, axis=0))
    cells = STRUCTURES[name].build([(mesh.vertices, mesh.faces)]).cells
    assert len(cells.listed) <= 8 * MOST_LISTED * 40
