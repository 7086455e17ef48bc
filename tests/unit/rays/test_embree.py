"""Rays cast by Embree from kernels, against plain loops over all triangles.

Rays against all objects at once: those that each object alone, asked in its own space, would stop.
"""

import gc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gi_core.geometry.surfaces import flatten
from gi_core.model import Model
from gi_core.rays.accelerator import Accelerator, Transforms
from gi_core.rays.all_objects import nearest_in_world, occluded_in_world, rays_to_object
from gi_core.rays.structures import DEFAULT, STRUCTURES, new_ray
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Material, Mesh, Mobile, Pose, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import box, box_mobile, coloured_room, grey, sphere

N = 4000
FAR = 10.0
needs_embree = pytest.mark.skipif("embree" not in STRUCTURES, reason="Embree is not here")


def soup(triangles: int, seed: int = 0) -> Mesh:
    """Triangles of any shape and position in a cube of 2 m."""
    rng = np.random.default_rng(seed)
    corners = (rng.uniform(-1, 1, (triangles, 1, 3)) + rng.uniform(-0.4, 0.4, (triangles, 3, 3))).reshape(-1, 3)
    corners = corners.astype(np.float32).astype(np.float64)
    faces = np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3)
    return Mesh(corners, faces, np.zeros(triangles, np.int32))


def rays(seed: int = 1):
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(N, 3))
    return rng.uniform(-1.5, 1.5, (N, 3)).astype(np.float32), (d / np.linalg.norm(d, axis=1)[:, None]).astype(
        np.float32
    )


def distances(mesh: Mesh, o, d) -> np.ndarray:
    """Return where each ray meets each triangle, (n, F), inf for nowhere (Moeller and Trumbore 1997)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    o, d = o.astype(np.float64)[:, None], d.astype(np.float64)[:, None]
    p = np.cross(d, c - a)
    det = (p * (b - a)).sum(-1)
    s = o - a
    u = (s * p).sum(-1) / det
    q = np.cross(s, b - a)
    v, t = (d * q).sum(-1) / det, ((c - a) * q).sum(-1) / det
    return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)


@pytest.mark.parametrize("threads", [1, 2])
def test_nearest_and_any_hits_are_those_of_a_loop_over_all_triangles(threads):
    mesh, (o, d) = soup(60), rays()
    scene = Scene(mesh, (Material("grey"),))
    rays_of = Accelerator(flatten(scene, with_receivers=False)[0], threads)
    t = distances(mesh, o, d)
    limits = np.random.default_rng(2).uniform(0.1, FAR, N).astype(np.float32)
    expected = np.where(t.min(axis=1) < limits, t.argmin(axis=1), -1)
    found, face = rays_of.nearest(0, o, d, limits)
    # A ray may graze an edge, or end on a triangle, within rounding: none of these does.
    assert np.array_equal(face, expected)
    assert (face >= 0).sum() > N / 10
    assert np.allclose(found[face >= 0], t.min(axis=1)[face >= 0], atol=1e-4)
    assert np.array_equal(found[face < 0], limits[face < 0])
    assert np.array_equal(rays_of.occluded(0, o, d, limits), expected >= 0)


def test_arrays_of_any_type_are_accepted(monkeypatch):
    mesh, (o, d) = soup(20), rays()
    rays_of = Accelerator(flatten(Scene(mesh, (Material("grey"),)), with_receivers=False)[0])
    limits = np.full(N, FAR, np.float32)
    plain = rays_of.nearest(0, o, d, limits)
    strided = np.concatenate([o, d], axis=1).astype(np.float64)
    other = rays_of.nearest(0, strided[:, :3], strided[:, 3:], limits.astype(np.float64))
    assert all(np.array_equal(a, b) for a, b in zip(plain, other, strict=True))


def test_empty_mesh_is_never_hit():
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int32))
    rays_of = Accelerator(flatten(Scene(empty, (Material("grey"),)), with_receivers=False)[0])
    o, d = rays()
    limits = np.full(N, FAR, np.float32)
    found, face = rays_of.nearest(0, o, d, limits)
    assert (face == -1).all() and np.array_equal(found, limits)
    assert not rays_of.occluded(0, o, d, limits).any()


def test_rays_are_where_embree_wants_them():
    held = [new_ray() for _ in range(50)]
    assert {ray.ctypes.data % 16 for ray in held} == {0}


def test_structures_are_built_once(monkeypatch):
    solver = Solver(coloured_room((box_mobile(size=0.1),)), photons=2000, radius=0.1)
    monkeypatch.setattr(STRUCTURES[DEFAULT], "build", None)  # with one more, creation would fail
    solver.solve()
    solver.configure(light="best")
    for k in range(3):
        solver.move("box", Pose((0.3 + 0.1 * k, 0.5, 0.3)))
        assert np.array_equal(solver.irradiance, solver.from_scratch())


@needs_embree
def test_structures_are_freed(monkeypatch):
    embree = STRUCTURES["embree"]
    given, release = [], embree._release_scene
    monkeypatch.setattr(embree, "_release_scene", lambda address: (given.append(address), release(address)))
    meshes = [(m.vertices, m.faces) for m in (soup(5), soup(0), soup(6))]
    scenes = embree.build(meshes)
    first, none, last = map(int, scenes)
    part = scenes[1:]
    del scenes
    gc.collect()
    assert not given and not none
    del part
    gc.collect()
    assert sorted(given) == sorted([first, last])


@needs_embree
@pytest.mark.parametrize(
    ("patch", "said"),
    [
        (
            "rtcore_scene.__file__ = numpy._core._multiarray_umath.__file__",
            "the package embreex exports no Embree functions",
        ),
        ("ctypes.CDLL = old(ctypes.CDLL)", "embreex ships Embree 3, not 4"),
    ],
)
def test_other_embree_version_is_refused_in_one_sentence(patch, said):
    code = f"""
import ctypes, numpy
import llvmlite.binding, numba
from embreex import rtcore_scene
class old:
    def __init__(self, real):
        self.real = real
    def __call__(self, path):
        library = self.real(path)
        if hasattr(library, "rtcGetDeviceProperty"):
            library.rtcGetDeviceProperty = old.Property(library.rtcGetDeviceProperty)
        return library
    class Property:
        def __init__(self, real):
            pass
        def __call__(self, *_):
            return 31302
{patch}
import gi_core.rays.embree
"""
    ran = subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[3], capture_output=True, text=True)
    assert ran.returncode and f"ImportError: {said}" in ran.stderr.splitlines()[-1]
    assert "install embreex 4.4 or later" in ran.stderr.splitlines()[-1]


POSES = {
    "ball": Pose((0.3, 0.2, 0.4), axis_angle((1, 2, 3), 40.0)),
    "crate": Pose((-0.4, -0.3, 0.1), axis_angle((0, 1, 1), 70.0)),
    "far": Pose((3.0, 0.0, 0.0)),  # outside the room
}


@pytest.fixture(scope="module")
def model() -> Model:
    mobiles = (
        Mobile("ball", sphere((0, 0, 0), 0.25, 2, 0)), Mobile("crate", box((-0.2, -0.1, -0.1), (0.2, 0.1, 0.1), 2, 0)),
        Mobile("far", sphere((0, 0, 0), 0.4, 1, 0)),
    )  # fmt: skip
    return Model(Scene(box((-1, -1, -1), (1, 1, 1), 3, 0, inward=True), (grey(0.5),), mobiles, up=(0, 0, 1)))


def rays_of_all_objects(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
    at, (o, d, limits) = model.transforms(POSES), rays_of_all_objects(kind)
    expected, expected_face = one_by_one(model, at, o, d, limits)
    distance, face = nearest_in_world(model.accelerator, at, o, d, limits)
    assert np.array_equal(distance, expected) and np.array_equal(face, expected_face)
    assert np.array_equal(occluded_in_world(model.accelerator, at, o, d, limits), expected_face >= 0)
    hit = np.unique(model.accelerator.face_object[face[face >= 0]])
    assert set(hit) >= ({0, 3} if kind == "from far" else {0, 1, 2}), hit


def test_without_mobiles_only_the_static_part_is_met(model):
    o, d, limits = rays_of_all_objects("any")
    distance, face = nearest_in_world(model.accelerator, model.static, o, d, limits)
    expected = model.accelerator.nearest(0, o, d, limits)
    assert np.array_equal(distance, expected[0]) and np.array_equal(face, expected[1])
