"""Borders and classes of receivers.

Evaluation points of the reference: beside walls, on the correct side of curved surfaces. Neighbours along a mesh,
next to each other and scattered over a wider surrounding.
"""

import numpy as np
import pytest

from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.mesh_neighbours import LOOKED_AT, SCATTERED, Neighbours, neighbours, scattered_neighbours
from gi_core.geometry.receiver_classes import CLASSES, border_receivers, receiver_classes
from gi_core.geometry.surfaces import evaluation_points, flatten
from gi_core.scene.types import DirectionalLight
from tests.support import closed_form
from tests.support import scene_builders as build
from tests.support.significance import z_test


def test_border_of_a_floor_is_its_rim_and_of_a_room_every_edge():
    surfaces, receivers = flatten(build.plane_scene(divisions=4))
    rim = np.abs(receivers.positions[:, :2]).max(axis=1) > 0.99
    assert np.array_equal(border_receivers(surfaces, len(receivers.areas)), rim)
    surfaces, receivers = flatten(build.furnace_scene(divisions=4))
    at_wall = (np.abs(receivers.positions - 0.5) > 0.49).sum(axis=1) > 1
    assert np.array_equal(border_receivers(surfaces, len(receivers.areas)), at_wall)


def test_a_closed_smooth_surface_has_no_border_on_either_side():
    surfaces, receivers = flatten(build.sphere_scene(subdivisions=2))
    assert len(receivers.areas) == 2 * 162
    assert not border_receivers(surfaces, len(receivers.areas)).any()


def test_every_receiver_is_in_exactly_one_class():
    surfaces, receivers = flatten(build.plane_scene(divisions=6, mobiles=(build.box_mobile(),)))
    background = np.ones((len(receivers.areas), 3))
    now = background.copy()
    shaded = (np.abs(receivers.positions[:, :2]) < 0.4).all(axis=1)
    now[shaded] = 0.5
    now[~shaded] = 1.001  # below 1 % of the mean: not affected
    classes = receiver_classes(surfaces, receivers, now, background)
    assert tuple(classes) == CLASSES
    assert (np.sum(list(classes.values()), axis=0) == 1).all()
    static = np.arange(len(shaded)) < surfaces.first_receiver[1]
    assert np.array_equal(classes["mobile"], ~static)
    assert np.array_equal(classes["affected"], static & shaded)
    assert classes["border"].sum() == 24 and classes["untouched"].sum() == 49 - 24 - 9


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


SIDE = 24  # receivers per row of a sheet of unit squares


def sheet(bend: float = 0.0) -> tuple[Neighbours, np.ndarray, np.ndarray]:
    """Return a sheet with its neighbours, positions and normals; its right half is turned by `bend` about y."""
    x, y = np.meshgrid(np.arange(SIDE, dtype=np.float64), np.arange(SIDE, dtype=np.float64), indexing="ij")
    k = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    corners = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    over = np.maximum(x - SIDE // 2, 0)
    positions = np.stack([x - over * (1 - np.cos(bend)), y, over * np.sin(bend)], axis=2).reshape(-1, 3)
    normals = np.tile((0.0, 0.0, 1.0), (SIDE * SIDE, 1))
    normals[over.ravel() > 0] = (-np.sin(bend), 0.0, np.cos(bend))
    return neighbours(corners, SIDE * SIDE), positions, normals


def rows(near: Neighbours) -> np.ndarray:
    """Return the receiver of each entry."""
    return np.repeat(np.arange(len(near.first) - 1), np.diff(near.first))


@pytest.mark.parametrize("threads", [1, 2])
def test_scattered_neighbours_lie_within_reach_and_differ(threads):
    edges, positions, normals = sheet()
    near = scattered_neighbours(edges, positions, normals, 4.0, threads)
    row, apart = rows(near), np.linalg.norm(positions[rows(near)] - positions[near.of], axis=1)
    assert (apart <= 4.0).all() and (row != near.of).all()
    assert len(set(zip(row.tolist(), near.of.tolist(), strict=True))) == len(row)
    inside = SIDE // 2 * SIDE + SIDE // 2
    assert near.first[inside + 1] - near.first[inside] == SCATTERED
    np.testing.assert_array_equal(near.of, scattered_neighbours(edges, positions, normals, 4.0, 1).of)


def test_scattered_neighbours_are_drawn_evenly():
    """Mean squared distance of a disc of radius R is R^2 / 2, of all 48 receivers within 4: 8."""
    edges, positions, normals = sheet()
    near = scattered_neighbours(edges, positions, normals, 4.0, 1)
    inner = ((positions[:, :2] >= 4) & (positions[:, :2] <= SIDE - 5)).all(axis=1)[rows(near)]
    squared = ((positions[rows(near)] - positions[near.of]) ** 2).sum(axis=1)[inner]
    assert squared.mean() == pytest.approx(8.0, rel=0.04)


def test_a_fold_ends_the_surrounding():
    edges, positions, normals = sheet(bend=1.0)
    near = scattered_neighbours(edges, positions, normals, 4.0, 1)
    right = positions[:, 2] > 0
    assert (right[rows(near)] == right[near.of]).all()


def test_wide_surroundings_are_cut_off_and_lonely_receivers_have_none():
    edges, positions, normals = sheet()
    near = scattered_neighbours(edges, positions, normals, 1e9, 1)
    assert (np.diff(near.first) == SCATTERED).all()
    far = np.abs(positions[rows(near)] - positions[near.of]).max()
    assert far < LOOKED_AT**0.5 * 1.5  # breadth first: the nearest along the mesh
    alone = Neighbours(np.zeros(4, np.int64), np.zeros(0, np.int32))
    assert not len(scattered_neighbours(alone, np.zeros((3, 3)), normals[:3], 1.0, 1).of)
