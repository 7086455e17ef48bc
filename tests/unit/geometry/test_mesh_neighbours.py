"""Neighbours along a mesh, next to each other and scattered over a wider surrounding."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.geometry.mesh_neighbours import LOOKED_AT, SCATTERED, Neighbours, neighbours, scattered_neighbours

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
