"""Evaluation points of the reference: beside walls, on the correct side of curved surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.geometry.surfaces import flatten
from gi_core.scene.types import DirectionalLight
from tests.support import closed_form
from tests.support import scene_builders as build
from tests.support.significance import z_test


def test_evaluation_points_lie_off_every_wall_and_inside_their_faces():
    room = build.furnace_scene(divisions=3)
    surfaces, receivers = flatten(room)
    P, N = evaluation_points(surfaces, receivers)
    assert ((P > 1e-5) & (P < 1 - 1e-5)).all()
    assert np.abs(P - receivers.positions).max() < 0.02 / 3
    assert np.array_equal(N, receivers.normals)


def test_evaluation_points_of_a_sphere_stay_on_their_side():
    surfaces, receivers = flatten(build.sphere_scene(subdivisions=2))
    P, N = evaluation_points(surfaces, receivers)
    side = np.sign((receivers.positions * N).sum(axis=1))
    # Outside, beyond the circumscribed sphere; inside, nearer than any vertex.
    assert (side * (np.sqrt((P * P).sum(axis=1)) - 1) > 1e-5).all()
    # Inside points are also nearer than any face: no ray starts behind its own wall.
    scene = build.sphere_scene(DirectionalLight("d", (0, 0, -1), (1.0,) * 3), subdivisions=2)
    assert not reference_irradiance(scene, P[side < 0], N[side < 0], 50, 0)[0].any()


def test_corner_vertex_gets_the_light_beside_it():
    """At the vertex itself every ray would hit the wall at once: E must be near 1/2 pi L, not pi L or 0."""
    scene = build.corner_scene(1.0)
    surfaces, receivers = flatten(scene)
    at_edge = (np.abs(receivers.positions[:, [0, 2]]).max(axis=1) < 1e-9) & (receivers.normals[:, 2] > 0.9)
    inner = at_edge & (np.abs(receivers.positions[:, 1]) < 0.4)
    P, N = (a[inner] for a in evaluation_points(surfaces, receivers))
    assert len(P) == 3 and (P[:, 0] > 1e-4).all() and (P[:, 2] > 0).all()
    E, error = reference_irradiance(scene, P, N, 20000, 4)
    wall = [(0, -0.5, 0), (0, 0.5, 0), (0, 0.5, 1), (0, -0.5, 1)]
    z_test(E[:, 0], [closed_form.lambert_polygon(1.0, wall, p, (0, 0, 1)) for p in P], error[:, 0], "at the edge")
    assert E[:, 0] == pytest.approx(np.pi / 2, rel=0.03)
