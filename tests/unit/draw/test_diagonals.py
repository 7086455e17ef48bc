"""Quadrilaterals of a mesh, and the diagonals that a picture gives them."""

import numpy as np
import pytest

from app.draw import shot as shots
from app.draw.draw_mesh import Turning, along_light, draw_meshes, quad_around, quads_of, with_diagonals
from app.draw.shot import Shot
from app.settings import Settings
from gi_core.model import Model
from gi_core.scene import Camera, Material, Scene
from gi_core.scene.types import Mesh
from gi_core.solver import Solver
from tests.support.gl_drawing import gl_picture
from tests.support.scene_builders import box, merge, quad

WHITE = (Material("white", (0.5, 0.5, 0.5)), Material("grey", (0.2, 0.2, 0.2)))
SOFT = 0.15  # width of the border of light, along x
CAMERA = Camera((0.4, 0.6, 2.0), (0.5, 0.5, 0.0), 40.0)


def draw_mesh(mesh: Mesh):
    return draw_meshes(Model(Scene(mesh, WHITE)).surfaces)[0]


def striped(mesh: Mesh) -> Shot:
    """A lit plane, without a photon, under a border of light that no diagonal follows: x + 0.6 y = 0.8."""
    solver = Solver(Scene(mesh, WHITE, camera=CAMERA, up=(0, 1, 0)), photons=0, radius=0.1)
    x, y, _ = solver.receivers.positions.T
    E = np.clip((x + 0.6 * y - 0.8) / SOFT, 0, 1)[:, None] * [1.0, 0.8, 0.6]
    solver.frame = solver.frame._replace(irradiance=E)
    return Shot(solver, Settings(size=(120, 90), exposure=1.0, tone_map="clip"))


def plane(n: int = 12) -> Mesh:
    return quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (n, n))


def with_all(mesh, *_):
    return with_diagonals(mesh, np.ones(len(mesh.quads.faces), bool))


def test_a_grid_consists_of_quads():
    quads = draw_mesh(quad((0, 0, 0), (2, 0, 0), (0, 1, 0), (6, 4))).quads
    assert np.array_equal(np.sort(quads.faces.reshape(-1)), np.arange(48))


def test_diagonals_turn_to_and_fro():
    mesh, rng = draw_mesh(quad((0, 0, 0), (2, 0, 0), (0, 1, 0), (6, 4))), np.random.default_rng(0)
    turning = Turning(mesh)
    for _ in range(4):
        others = rng.random(len(mesh.quads.faces)) < 0.5
        assert turning.turn(others) and not turning.turn(others)
        corners = np.sort(turning.triangles[mesh.quads.faces], axis=-1)
        a, b, d, c = mesh.quads.corners
        expected = np.where(others, [(a, b, d), (d, c, a)], [(a, b, c), (d, c, b)])
        np.testing.assert_array_equal(corners, np.sort(expected.transpose(2, 0, 1), axis=-1))


def test_quads_end_at_creases_materials_and_third_faces():
    assert len(draw_mesh(box((0, 0, 0), (1, 1, 1), 2)).quads.faces) == 24, "four on each side"
    halves = Mesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]]), None)
    for materials, count in (([0, 0], 1), ([0, 1], 0)):
        mesh = halves._replace(face_material=np.array(materials, np.int32), faces=halves.faces.astype(np.int32))
        assert len(draw_mesh(mesh).quads.faces) == count
    positions = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 0.3]], np.float32)
    fan = np.array([[0, 2, 1], [0, 1, 3], [0, 1, 4]])
    assert len(quads_of(positions, fan[:2]).faces) == 1 and not len(quads_of(positions, fan).faces)
    bent = positions + [[0, 0, 0], [0, 0, 0.01], *[[0, 0, 0]] * 3]
    assert not len(quads_of(bent, fan[:2]).faces)
    uv = positions[:, :2].copy()
    assert len(quads_of(positions, fan[:2], uv).faces) == 1
    uv[3] += 0.01
    assert not len(quads_of(positions, fan[:2], uv).faces), "the texture turns at the diagonal"
    assert not len(quads_of(positions, fan[:0]).faces)


def test_the_other_diagonal_covers_the_same_surface():
    mesh = draw_mesh(plane())
    other = with_all(mesh)
    assert not np.array_equal(other.triangles, mesh.triangles)

    def normals(m):
        p = m.positions[m.triangles].astype(float)
        return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])

    np.testing.assert_allclose(normals(other), normals(mesh), atol=1e-6)
    assert np.array_equal(other.quads.beside[other.quads.beside], np.arange(len(mesh.triangles)))


def test_light_that_is_linear_does_not_show_the_diagonals(monkeypatch):
    """Rays find the triangle of the drawn diagonal, though the structure of rays has the shared one."""
    shot = striped(plane())
    x, y, _ = shot.solver.receivers.positions.T
    linear = (0.2 + 0.5 * x + 0.3 * y)[:, None] * [1.0, 0.8, 0.6]
    shot.solver.frame = shot.solver.frame._replace(irradiance=linear)
    pictures = []
    for share in (0, 1):
        given = with_all if share else lambda mesh, *_: mesh
        monkeypatch.setattr(shots, "along_light", given)
        pictures.append(shot.take().astype(int))
    assert np.ptp(pictures[0]) > 50 and np.abs(pictures[0] - pictures[1]).max() <= 1


@pytest.mark.gl
def test_both_pictures_have_the_same_diagonals():
    """A slab that is lit only on its back is in the picture too: backs count."""
    shot = striped(merge(plane(), quad((0.1, 0.1, 0.2), (0, 0.4, 0), (0.4, 0, 0), (5, 5), 1)))
    shot.exposure = 1.0
    assert any((along_light(m, *shot.lit.sides[0]).quads.beside >= 0).any() for m in shot.lit.meshes)
    traced, drawn = shot.take().astype(int), gl_picture(shot).astype(int)
    assert (np.abs(traced - drawn).max(axis=2) > 4).mean() < 0.01, "but for edges"
    plain = shots.along_light
    try:
        shots.along_light = lambda mesh, *_: mesh
        shared = shot.take().astype(int)
    finally:
        shots.along_light = plain
    assert (np.abs(shared - drawn).max(axis=2) > 4).mean() > 0.01, "the shared diagonals look different"


def test_a_quad_around_a_face_has_its_light():
    mesh = draw_mesh(merge(plane(3), quad((0, 0, -1), (1, 0, 0), (0, 1, 0))))
    mesh = mesh._replace(quads=mesh.quads._replace(faces=mesh.quads.faces[1:], corners=mesh.quads.corners[:, 1:]))
    for face in range(len(mesh.triangles)):
        one = quad_around(mesh, face)
        assert np.array_equal(
            one.positions[one.triangles[0]].sum(axis=0), mesh.positions[mesh.triangles[face]].sum(axis=0)
        )
        if (mesh.quads.faces == face).any():
            other = mesh.quads.faces[(mesh.quads.faces == face).any(axis=1)].sum() - face
            expected, found = mesh.positions[mesh.triangles[other]], one.positions[one.triangles[1]]
            assert np.array_equal(np.sort(found, axis=0), np.sort(expected, axis=0))
            assert np.array_equal(one.front[one.triangles[1]].sum(), mesh.front[mesh.triangles[other]].sum())
        else:
            assert len(one.triangles) == 1 and not len(one.quads.faces)
