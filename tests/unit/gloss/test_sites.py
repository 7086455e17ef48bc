"""Sites: receivers of a flat surface that share the cells of one of them.

Directional light of a frame, of all receivers or of some.
"""

import numpy as np

from gi_core.frames.frame_gloss import NORMAL_STEP, SPACING, GlossSource, sites
from gi_core.frames.light_setting import LIST
from gi_core.geometry.surfaces import glossy_receivers
from gi_core.gloss.hemisphere import CELLS
from gi_core.gloss.light import FIELDS, GlossLight
from gi_core.model import Model
from gi_core.scene.types import Gloss, Material, Mobile, Pose, Scene
from tests.support.scene_builders import box, merge, quad, solve, sphere

SATIN = Material("satin", (0.3, 0.3, 0.3), gloss=Gloss(alpha=0.3))
LAMP = Material("lamp", (0, 0, 0), (5, 5, 5))


def fine_room() -> Scene:
    """A room with a finely meshed satin floor and a satin ball."""
    static = merge(
        box((0, 0, 0), (1, 1, 1), 2, 0, inward=True),
        quad((0.01, 0.01, 0.01), (0.98, 0, 0), (0, 0.98, 0), (30, 30), 1),
        quad((0.4, 0.4, 0.99), (0, 0.2, 0), (0.2, 0, 0), (1, 1), 2),
    )
    ball = Mobile("ball", sphere((0, 0, 0), 0.15, 2, 1), Pose((0.5, 0.5, 0.4)))
    return Scene(static, (Material("wall", (0.7, 0.7, 0.7)), SATIN, LAMP), (ball,), (), up=(0, 0, 1), name="fine")


def test_members_are_near_their_owner_on_the_same_side():
    model, radius = Model(fine_room()), 0.4
    rows = glossy_receivers(model.surfaces)
    owners, place = sites(model, rows, radius)
    own = owners[place]
    r = model.object_receivers
    assert (np.diff(owners) > 0).all() and np.array_equal(own[np.searchsorted(rows, owners)], owners)
    assert np.linalg.norm(r.positions[own] - r.positions[rows], axis=1).max() < SPACING * radius * 3**0.5
    assert np.abs(r.normals[own] - r.normals[rows]).max() < NORMAL_STEP + 1e-9
    assert np.array_equal(model.receiver_sides[own], model.receiver_sides[rows])
    first = model.surfaces.first_receiver[1]
    assert (owners < first).sum() < (rows < first).sum() / 4 and np.array_equal(
        owners[owners >= first], rows[rows >= first]
    ), "flat surfaces share, curved ones do not"


def test_lists_keep_a_list_per_receiver():
    model = Model(fine_room())
    for way, fewer in (("quadtree", True), (LIST, False)):
        cells = GlossSource(model).cells(0.2, way)
        assert (len(cells.owners) < len(cells.rows)) == fewer and len(cells.place) == len(cells.rows)


def test_directions_of_members_are_those_of_their_owner():
    solver = solve(fine_room(), photons=4000, radius=0.2, seed=1)
    solver.move("ball", Pose((0.4, 0.6, 0.4)))
    light = solver.frame.gloss
    given = light.directions()
    assert given.cells.shape[0] == len(light.owners) and np.array_equal(given.place, light.place)
    assert len(light.changed) and light.changed.max() < len(light.owners)


def test_directions_of_some_receivers_are_those_of_all():
    """Receivers share owners; some of these owners have changed cells."""
    chance = np.random.default_rng(5)
    place = np.array([0, 0, 3, 1, 2, 3, 4, 1], np.int32)
    resting, cells = (chance.random((n, CELLS, FIELDS)).astype(np.float32) for n in (5, 2))
    light = GlossLight(np.arange(8), np.arange(5), place, resting, np.array([1, 3]), cells)
    every = light.directions()
    for rows in ([0], [2, 3], [7, 4, 5], [0, 1, 2, 3, 4, 5, 6, 7]):
        some = light.directions(np.array(rows))
        assert np.array_equal(some.cells[some.place[rows]], every.cells[every.place[rows]])
        assert len(some.cells) == len(set(place[rows]))
    assert np.array_equal(every.cells[[1, 3]], cells) and np.array_equal(light.resting, resting)
