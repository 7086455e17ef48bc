"""Rays against all objects at once: those that each object alone, asked in its own space, would stop."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.rays.all_objects import nearest_in_world, occluded_in_world, rays_to_object
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Mobile, Pose, Scene
from tests.support.scene_builders import box, grey, sphere

POSES = {
    "ball": Pose((0.3, 0.2, 0.4), axis_angle((1, 2, 3), 40.0)),
    "crate": Pose((-0.4, -0.3, 0.1), axis_angle((0, 1, 1), 70.0)),
    "far": Pose((3.0, 0.0, 0.0)),  # outside the room
}
N = 4000


@pytest.fixture(scope="module")
def model() -> Model:
    mobiles = (
        Mobile("ball", sphere((0, 0, 0), 0.25, 2, 0)), Mobile("crate", box((-0.2, -0.1, -0.1), (0.2, 0.1, 0.1), 2, 0)),
        Mobile("far", sphere((0, 0, 0), 0.4, 1, 0)),
    )  # fmt: skip
    return Model(Scene(box((-1, -1, -1), (1, 1, 1), 3, 0, inward=True), (grey(0.5),), mobiles, up=(0, 0, 1)))


def rays(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return origins, unit directions and limits; `axes`: directions with zeros, which a box test may divide by."""
    rng = np.random.default_rng(4)
    o, d = rng.uniform(-0.95, 0.95, (N, 3)).astype(np.float32), rng.normal(size=(N, 3))
    if kind == "axes":
        d = np.eye(3)[rng.integers(0, 3, N)] * rng.choice([-1.0, 1.0], (N, 1))
    elif kind == "from far":
        o = (o + 40 * d / np.linalg.norm(d, axis=1)[:, None]).astype(np.float32)
        d = -d + 0.01 * rng.normal(size=(N, 3))
    limits = {"short": rng.uniform(0, 1, N), "endless": np.full(N, np.inf)}.get(kind, np.full(N, 100.0))
    return o, (d / np.linalg.norm(d, axis=1)[:, None]).astype(np.float32), limits.astype(np.float32)


def one_by_one(model: Model, at: Transforms, o, d, limits):
    distance, face = model.accelerator.nearest(0, o, d, limits)
    for k in range(1, len(at.position)):
        t, f = model.accelerator.nearest(k, *rays_to_object(at, k, o, d), distance)
        distance[f >= 0], face[f >= 0] = t[f >= 0], f[f >= 0]
    return distance, face


@pytest.mark.parametrize("kind", ["any", "axes", "short", "endless", "from far"])
def test_hits_are_those_of_each_object_bit_for_bit(model, kind):
    at, (o, d, limits) = model.transforms(POSES), rays(kind)
    expected, expected_face = one_by_one(model, at, o, d, limits)
    distance, face = nearest_in_world(model.accelerator, at, o, d, limits)
    assert np.array_equal(distance, expected) and np.array_equal(face, expected_face)
    assert np.array_equal(occluded_in_world(model.accelerator, at, o, d, limits), expected_face >= 0)
    hit = np.unique(model.accelerator.face_object[face[face >= 0]])
    assert set(hit) >= ({0, 3} if kind == "from far" else {0, 1, 2}), hit


def test_without_mobiles_only_the_static_part_is_met(model):
    o, d, limits = rays("any")
    distance, face = nearest_in_world(model.accelerator, model.static, o, d, limits)
    expected = model.accelerator.nearest(0, o, d, limits)
    assert np.array_equal(distance, expected[0]) and np.array_equal(face, expected[1])
