"""Every disc search in whole frames, on any number of threads, against the naive twin, and at probes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from gi_core.discs.search import PRETESTS, SEARCHES
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Pose, Probe
from gi_core.solver import Solver
from tests.physics.test_contact import bowl
from tests.physics.test_invariants import NEIGHBOURS, PHOTONS, RADIUS, SCENE, SEED
from tests.support.reference_twins import Twin

pytestmark = pytest.mark.usefixtures("small_shares")

TILTED = axis_angle((1.0, 0.5, 0.0), 30.0)
PROBES = (
    Probe("floor", (0.62, 0.55, 0.0), (0.0, 0.0, 1.0)),  # beside the box, which enters its disc
    Probe("air", (0.4, 0.4, 0.5), (0.0, 0.6, 0.8)),
    Probe("wall", (0.0, 0.7, 0.4), (1.0, 0.0, 0.0)),
)
ROOM = replace(SCENE, probes=PROBES)
MOVES = ({}, {"box": Pose((0.6, 0.42, 0.0)), "ball": Pose((0.5, 0.5, 0.12))}, {"ball": Pose((0.12, 0.7, 0.4), TILTED)})


@cache
def twin_of(scene_name: str, radius: float) -> Twin:
    scene = {"room": ROOM, "bowl": bowl()}[scene_name]
    return Twin(scene, PHOTONS, radius, NEIGHBOURS, SEED)


@cache
def expected(scene_name: str, radius: float, k: int) -> np.ndarray:
    """Return the twin's irradiance at the k-th poses, reached one after the other."""
    twin = twin_of(scene_name, radius)
    poses = twin.model.start_poses()
    for moves in MOVES[: k + 1]:
        poses |= moves
    return twin.irradiance("tangent_plane", poses)


def solver_of(scene_name: str, radius: float, **settings) -> Solver:
    solver = Solver(
        twin_of(scene_name, radius).model.scene, photons=PHOTONS, radius=radius, neighbours=NEIGHBOURS, seed=SEED,
        **settings,
    )  # fmt: skip
    solver.solve()
    return solver


@pytest.mark.parametrize("scene_name, radius", [("room", RADIUS), ("bowl", 0.3)])
@pytest.mark.parametrize("pretest", PRETESTS)
@pytest.mark.parametrize("search", SEARCHES)
def test_frames_equal_the_naive_twin(search, pretest, scene_name, radius, monkeypatch):
    """In a room, and in a bowl where segments count behind their hits; with mobiles on the floor and on each other."""
    threads = 1 + (list(SEARCHES).index(search) + list(PRETESTS).index(pretest)) % 3
    monkeypatch.setitem(SEARCHES, search, partial(SEARCHES[search], pretest=pretest))
    solver = solver_of(scene_name, radius, search=search, threads=threads)
    contact = []
    for k, poses in enumerate(MOVES):
        solver.move_all(poses)
        contact.append(solver.frame.control_facts.stale + solver.frame.control_facts.on_mobiles)
        np.testing.assert_array_equal(solver.irradiance, expected(scene_name, radius, k))
        assert np.array_equal(solver.from_scratch(), solver.irradiance)
        assert solver.frame.changes.photons_cut > 0
    assert max(contact) > 5


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("search", SEARCHES)
def test_any_number_of_threads(search, threads):
    solver = solver_of("room", RADIUS, search=search, threads=threads)
    solver.move_all(MOVES[1])
    assert np.array_equal(solver.irradiance, expected("room", RADIUS, 1))


@pytest.mark.parametrize("search", SEARCHES)
def test_probes_read_the_same_by_every_search(search):
    twin, E = twin_of("room", RADIUS), expected("room", RADIUS, 1)
    solver = solver_of("room", RADIUS, search=search)
    solver.move_all(MOVES[1])
    read = solver.frame.probe_irradiance
    for k, probe in enumerate(PROBES):
        assert np.array_equal(read[probe.name], E[twin.model.first_probe + k])
        assert read[probe.name].max() > 0
