"""Colours of draw vertices, compared with numpy, and their kernels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.draw.diagonals import Turning, other_diagonals
from app.draw.draw_mesh import draw_meshes
from app.draw.vertex_colours import colours, weights
from gi_core.display import vertex_light
from gi_core.geometry.error import REC709
from gi_core.model import Model
from gi_core.scene import Material, Scene
from tests.support.scene_builders import merge, quad

MATERIALS = Material("wall", (0.5, 0.4, 0.3)), Material("leaf", (0.2, 0.3, 0.4), two_sided=True)


@pytest.fixture
def mesh():
    """A wall, and a leaf with light on both sides."""
    wall, leaf = quad((0, 0, 0), (2, 0, 0), (0, 1, 0), (6, 4)), quad((0, 0, 1), (2, 0, 0), (0, 1, 0), (5, 5))
    both = merge(wall, leaf._replace(face_material=np.ones(len(leaf.faces), np.int32)))
    return draw_meshes(Model(Scene(both, MATERIALS)).surfaces)[0]


@pytest.fixture
def irradiance(mesh):
    return np.random.default_rng(5).random((max(mesh.front.max(), mesh.back.max()) + 1, 3))


@pytest.mark.parametrize("with_reflectance", [True, False])
def test_radiance_is_that_of_both_sides(mesh, irradiance, with_reflectance):
    rho = mesh.reflectance if with_reflectance else np.float32(1.0)
    front, back = colours(mesh, irradiance, with_reflectance)
    assert (mesh.back >= 0).any() and (mesh.back < 0).any() and front.dtype == np.float32
    assert np.array_equal(front, irradiance[mesh.front].astype(np.float32) * rho / np.float32(math.pi))
    expected = irradiance[mesh.back].astype(np.float32) * rho / np.float32(math.pi)
    assert np.array_equal(back, np.where(mesh.back[:, None] >= 0, expected, 0.0))


def test_weights_are_those_of_receivers(mesh, irradiance):
    of_receivers = np.random.default_rng(6).random(len(irradiance)).astype(np.float32)
    out = weights(mesh, of_receivers)
    assert np.array_equal(out[:, 0], of_receivers[mesh.front])
    assert np.array_equal(out[:, 1], np.where(mesh.back >= 0, of_receivers[mesh.back], 1.0))


def test_diagonals_are_those_of_least_difference(mesh, irradiance):
    front, back = colours(mesh, irradiance)
    of_vertices = np.ones((len(front), 2), np.float32)
    of_vertices[::7, 0] = 0.001
    (a, b, d, c), L = mesh.quads.corners, np.stack([front @ REC709, back @ REC709])
    shared, other = (np.abs(L[:, i] - L[:, j]).sum(axis=0) for i, j in ((b, c), (a, d)))
    keeps = (of_vertices[mesh.quads.corners] < 1).any(axis=(0, 2))
    assert np.array_equal(other_diagonals(mesh, front, back), other < shared)
    assert keeps.any() and np.array_equal(other_diagonals(mesh, front, back, of_vertices), (other < shared) & ~keeps)


def test_light_that_is_not_known_keeps_its_diagonals(mesh, irradiance):
    front, back = colours(mesh, np.full_like(irradiance, np.nan))
    assert np.isnan(front).all() and not other_diagonals(mesh, front, back).any()


def test_no_kernel_compiles_for_a_picture(mesh, irradiance):
    """A window compiles these kernels in its first look's process."""
    vertex_light.compile_kernels()
    kernels = [vertex_light.light_vertices, vertex_light.weigh_vertices]
    kernels += [vertex_light.follow_light, vertex_light.turn_triangles]
    before = [set(k.signatures) for k in kernels]
    front, back = colours(mesh, irradiance)
    colours(mesh, irradiance, with_reflectance=False)
    of_vertices = weights(mesh, np.ones(len(irradiance), np.float32))
    for given in (None, of_vertices):
        Turning(mesh).turn(other_diagonals(mesh, front, back, given))
    assert [set(k.signatures) for k in kernels] == before
