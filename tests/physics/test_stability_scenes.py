"""Stability of the program: no photons, extreme scales and places, rays at edges, odd meshes.

The first line of each test names the failure. Numbers predicted by theory are tested in test_stability_atlas.py.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.scene import SceneError
from gi_core.scene.types import DirectionalLight, Mesh, PointLight, Pose, Scene
from tests.support.scene_builders import box, box_mobile, floor, furnace_scene, lamp, plane_scene
from tests.support.stability_cases import UP, assert_sound, room, solved

# -- nothing, one, and few ------------------------------------------------------------------------


@pytest.mark.parametrize("photons", [0, 1])
def test_zero_photons_and_one_photon(photons, estimator):
    """Zeros, or one photon's light, without a warning."""
    solver = solved(room(box_mobile("a")), photons, estimator=estimator)
    solver.move("a", Pose((0.5, 0.5, 0.5)))
    assert_sound(solver)
    assert photons or not solver.irradiance.any()


def test_more_neighbours_than_photons():
    """All hits within the radius are taken, over its whole circle."""
    solver = solved(plane_scene(DirectionalLight("sun", (0, 0, -1), (1.0,) * 3)), 500, neighbours=1000,
                    radius=0.5, estimator="photon_map")  # fmt: skip
    assert_sound(solver)
    middle = np.abs(solver.receivers.positions).max(axis=1) < 0.4
    assert solver.irradiance[middle, 0].mean() == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("lights", [(), (PointLight("off", (0, 0, 1), (0.0, 0.0, 0.0)),)])
def test_zero_flux_and_no_lights(lights, estimator):
    scene = plane_scene(*lights, reflectance=0.5, mobiles=(box_mobile("a"),))
    solver = solved(scene, 100, {"a": Pose((0, 0, 0.5))}, estimator=estimator)
    assert_sound(solver)
    assert not solver.irradiance.any()


def test_light_of_one_channel_leaves_the_others_at_zero(estimator):
    solver = solved(plane_scene(PointLight("red", (0, 0, 1), (5.0, 0.0, 0.0)), reflectance=0.5), estimator=estimator)
    assert_sound(solver)
    assert solver.irradiance[:, 0].any() and not solver.irradiance[:, 1:].any()


def test_a_black_room(estimator):
    """All flux is absorbed at its first hit; nothing is reflected, and there is no warning."""
    scene = furnace_scene(1.0, 0.0, 4)
    solver = solved(scene, estimator=estimator)
    assert_sound(solver)
    assert solver.frame.fates["absorbed"] == pytest.approx(solver.frame.fates["emitted"], rel=1e-9)
    assert solver.frame.segments == solver.frame.photons


# -- scale and place ------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [2.0**-10, 2.0**10])
def test_scaled_by_a_power_of_two_the_picture_is_the_same(factor, estimator):
    """Lengths times s, flux times s^2: the same irradiance; powers of two keep float32's bits."""
    one = solved(furnace_scene(1.0, 0.5, 4), estimator=estimator)
    mesh = furnace_scene(1.0, 0.5, 4).static
    scene = Scene(mesh._replace(vertices=mesh.vertices * factor), (lamp(1.0, 0.5),), up=UP)
    scaled = solved(scene, estimator=estimator, radius=0.1 * factor)
    np.testing.assert_allclose(scaled.irradiance, one.irradiance, rtol=1e-5)


@pytest.mark.parametrize("distance", [3.0, 30.0])
def test_moved_from_the_origin_the_light_is_the_same(distance):
    """Float32 places have 24 bits: thirty room sizes away that is enough."""
    mesh = furnace_scene(1.0, 0.5, 4).static
    means = []
    for shift in (0.0, distance):
        scene = Scene(mesh._replace(vertices=mesh.vertices + shift), (lamp(1.0, 0.5),), up=UP)
        solver = solved(scene, 20_000)
        assert_sound(solver)
        means.append(solver.irradiance[:, 0].mean() / (2 * math.pi))
        assert not solver.frame.fates["escaped"].any()
    assert means == pytest.approx([1.0, 1.0], abs=0.02)


def test_any_distance_from_the_origin_gives_the_same_light(tmp_path):
    """At 100 room sizes rays hit the face that they leave, and all was dark; geometry is shifted to the origin."""
    mesh = furnace_scene(1.0, 0.5, 4).static
    for distance in (100.0, 1e6):
        scene = Scene(mesh._replace(vertices=mesh.vertices + distance), (lamp(1.0, 0.5),), up=UP, name="far room")
        solver = solved(scene, 20_000)
        assert solver.irradiance[:, 0].mean() == pytest.approx(2 * math.pi, rel=0.02)
        assert not solver.frame.fates["escaped"].any()
        scene = load_scene(written(tmp_path, CUBE.vertices + distance, CUBE.faces), max_edge=0.5)
        assert_sound(solved(scene, 5_000))
        assert np.abs(scene.static.vertices - CUBE.vertices.mean(axis=0) - distance).max() < 10


# -- rays at edges --------------------------------------------------------------------------------


def test_rays_through_vertices_and_edges_of_a_closed_room():
    """Few rays pass between triangles, and these count as escaped; every photon is counted."""
    scene = furnace_scene(1.0, 0.5, 8)
    solver = solved(scene)
    mesh = scene.static
    middle = np.full(3, 0.5)
    edges = mesh.vertices[mesh.faces[:, [0, 1]]].mean(axis=1)
    targets = np.concatenate([mesh.vertices, edges])
    d = targets - middle
    d /= np.linalg.norm(d, axis=1)[:, None]
    origins = np.tile(middle, (len(d), 1)).astype(np.float32)
    far = np.full(len(d), 10.0, np.float32)
    distance, face = solver.model.accelerator.nearest(0, origins, d.astype(np.float32), far)
    assert np.isfinite(distance).all() and (distance > 0).all()
    assert (face < 0).mean() < 0.002
    hit = face >= 0
    wanted = np.linalg.norm(targets - middle, axis=1)
    assert distance[hit] == pytest.approx(wanted[hit], rel=1e-4)
    many = solved(furnace_scene(1.0, 0.9, 8), 50_000)
    assert_sound(many)
    assert many.frame.fates["escaped"][0] < 1e-3 * many.frame.fates["emitted"][0]


# -- meshes ---------------------------------------------------------------------------------------


def written(folder, vertices, faces, name="a.obj", extra=()):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (folder / name).write_text("\n".join([*lines, *extra]) + "\n")
    return folder / name


CUBE = box((0, 0, 0), (1, 1, 1), 1)


def soup(mesh: Mesh):
    return mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3)


MESHES = {
    "one triangle": ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]),
    "an open mesh": (floor(2.0, 3).vertices, floor(2.0, 3).faces),
    "an unwelded soup": soup(CUBE),
    "an inverted body": (CUBE.vertices, CUBE.faces[:, ::-1]),
    "half its faces inverted": (CUBE.vertices, np.where(np.arange(12)[:, None] % 2, CUBE.faces, CUBE.faces[:, ::-1])),
    "three faces on an edge": (
        [(0, 0, 0), (0, 0, 1), (1, 0, 0), (-1, 1, 0), (-1, -1, 0)],
        [(0, 1, 2), (0, 1, 3), (0, 1, 4)],
    ),
    "two tetrahedra that share a vertex": (
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)],
        [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3), (0, 4, 5), (0, 6, 4), (0, 5, 6), (4, 6, 5)],
    ),
    "a zero, a needle and a duplicate among good faces": (
        [*CUBE.vertices, (0.5, 0.5, 1), (0.5, 0.5 + 1e-12, 1)],
        [*CUBE.faces.tolist(), (0, 0, 1), (0, 24, 25), CUBE.faces[0].tolist(), CUBE.faces[1, ::-1].tolist()],
    ),
}


@pytest.mark.parametrize("name", MESHES)
def test_odd_meshes_load_and_light(name, tmp_path, estimator):
    """A file without light gets a default light; then every remaining face gets sound light."""
    vertices, faces = MESHES[name]
    scene = load_scene(written(tmp_path, vertices, faces), max_edge=0.5)
    solver = solved(scene, 3000, estimator=estimator)
    assert_sound(solver)
    assert solver.irradiance.any()
    assert np.isfinite(solver.receivers.normals).all()


def test_zero_normals_in_a_file(tmp_path):
    normals = ["vn 0 0 0", "f 1//1 2//1 4//1"]
    scene = load_scene(written(tmp_path, CUBE.vertices, CUBE.faces, extra=normals), max_edge=0.5)
    solver = solved(scene, 1000)
    assert_sound(solver)
    assert np.linalg.norm(solver.receivers.normals, axis=1) == pytest.approx(1.0)


def test_a_mesh_without_faces_is_refused_in_one_sentence(tmp_path):
    with pytest.raises(SceneError, match="no triangles"):
        load_scene(written(tmp_path, CUBE.vertices, []))
