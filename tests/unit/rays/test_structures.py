"""Our structures of rays agree with a loop over all triangles bit for bit, and with Embree in all but stray rays."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gi_core.geometry.surfaces import Surfaces, flatten
from gi_core.model import Model
from gi_core.rays import bvh
from gi_core.rays.accelerator import Accelerator
from gi_core.rays.leaf_boxes import leaf_boxes, visited
from gi_core.rays.structures import DEFAULT, STRUCTURES
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Material, Mesh, Scene
from gi_core.solver import Solver
from tests.support.ray_cases import CASES, aimed_at, directions, room, soup, strays
from tests.support.scene_builders import box, coloured_room

ROOT = Path(__file__).parents[3]
OURS = [name for name in STRUCTURES if name != "embree"]
OTHERS = [name for name in OURS if name != "none"]


def surfaces_of(mesh: Mesh) -> Surfaces:
    return flatten(Scene(mesh, (Material("grey"),)), with_receivers=False)[0]


def hits(surfaces: Surfaces, name: str, rays, limit=None):
    o, d = rays
    far = np.full(len(o), np.inf if limit is None else limit, np.float32)
    accelerator = Accelerator(surfaces, rays=name)
    return *accelerator.nearest(0, o, d, far), accelerator.occluded(0, o, d, far)


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.slow
def test_a_structure_changes_no_bit(case, name):
    mesh, rays = CASES[case](2000)
    surfaces = surfaces_of(mesh)
    truth = hits(surfaces, "none", rays)
    assert all(np.array_equal(a, b) for a, b in zip(truth, hits(surfaces, name, rays), strict=True))
    assert np.array_equal(truth[2], truth[1] >= 0)
    if len(mesh.faces):
        limit = float(np.median(truth[0][truth[1] >= 0]))
        near = hits(surfaces, "none", rays, limit)
        assert all(np.array_equal(a, b) for a, b in zip(near, hits(surfaces, name, rays, limit), strict=True))
        assert (near[0][near[1] < 0] == np.float32(limit)).all() and (near[0] <= np.float32(limit)).all()


@pytest.mark.parametrize("leaf", [1, 2, 15])
@pytest.mark.parametrize("name", OTHERS)
def test_the_size_of_leaves_changes_no_bit(name, leaf, monkeypatch):
    mesh, rays = CASES["random"](2000)
    surfaces, module = surfaces_of(mesh), STRUCTURES[name]
    build = module.build
    expected = hits(surfaces, "none", rays)
    monkeypatch.setattr(module, "build", lambda meshes: build(meshes, leaf))
    assert all(np.array_equal(a, b) for a, b in zip(expected, hits(surfaces, name, rays), strict=True))


@pytest.mark.skipif(DEFAULT != "embree", reason="Embree is not here")
@pytest.mark.parametrize("case", ["random", "scale 1e-3", "scale 1e3", "room", "sheets"])
def test_embree_agrees_in_all_but_stray_rays(case):
    """The bound of a million rays, `studies.ray_structures --agreement`, is 1e-5; 50,000 may hold two strays."""
    mesh, rays = CASES[case](50_000)
    surfaces = surfaces_of(mesh)
    ours, theirs = hits(surfaces, "bvh", rays, 1e4), hits(surfaces, "embree", rays, 1e4)
    assert strays(ours, theirs) <= 2 and (ours[2] != theirs[2]).sum() <= 2
    same = ours[1] == theirs[1]
    assert (same.sum() < len(same) - 1000) == (case == "sheets")
    np.testing.assert_allclose(ours[0][same], theirs[0][same], rtol=2e-4, atol=2e-6 * np.abs(mesh.vertices).max())


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_ray_that_starts_in_a_face_hits_it_at_distance_0(name):
    """Embree counts such hits: the side of a shelf in LuxCore's kitchen, 0.7 mm behind another, has many."""
    mesh = box((0.3, 0.3, 0.3), (0.6, 0.6, 0.6), 2, 0)
    rng = np.random.default_rng(0)
    o = rng.uniform(0.35, 0.55, (300, 3)).astype(np.float32)
    axis = rng.integers(0, 3, len(o))
    o[np.arange(len(o)), axis] = 0.6
    distance, face, blocked = hits(surfaces_of(mesh), name, (o, directions(rng, len(o))))
    assert (distance == 0).all() and (face >= 0).all() and blocked.all()


@pytest.mark.parametrize("name", OURS)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_no_ray_leaves_a_closed_room(name, scale):
    """Neither random rays nor rays aimed at vertices and at edges pass between two triangles."""
    mesh = room(scale)
    rng = np.random.default_rng(3)
    o = (scale * rng.uniform(0.2, 0.8, (3000, 3))).astype(np.float32)
    surfaces = surfaces_of(mesh)
    for d in (directions(rng, len(o)), aimed_at(mesh, o, rng, "vertices"), aimed_at(mesh, o, rng, "edges")):
        distance, face, blocked = hits(surfaces, name, (o, d))
        assert (face >= 0).all() and blocked.all() and (distance < 2 * scale).all()


@pytest.mark.parametrize("name", OURS)
def test_objects_have_their_own_cells(name):
    """Static part and two mobiles: every object answers as it does alone, an empty one never."""
    meshes = [soup(40, 1), soup(0, 2), soup(70, 3)]
    o, d = CASES["random"](500)[1]
    far = np.full(len(o), 10.0, np.float32)
    every = Accelerator(surfaces_of(meshes[0]), rays=name)
    every.scenes = STRUCTURES[name].build([(m.vertices, m.faces) for m in meshes])
    every.first_face = np.array([0, 40, 40, 110])
    for k, mesh in enumerate(meshes):
        alone = Accelerator(surfaces_of(mesh), rays=name)
        distance, face = every.nearest(k, o, d, far)
        expected, expected_face = alone.nearest(0, o, d, far)
        assert np.array_equal(distance, expected)
        assert np.array_equal(face, np.where(expected_face < 0, -1, expected_face + every.first_face[k]))
        assert np.array_equal(every.occluded(k, o, d, far), alone.occluded(0, o, d, far))
        assert (face >= 0).any() == (k != 1)


def test_equal_distances_go_to_the_lower_face():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float64)
    mesh = Mesh(np.tile(corners, (9, 1)), np.arange(27, dtype=np.int32).reshape(-1, 3), np.zeros(9, np.int32))
    rays = np.full((1, 3), 0.25, np.float32), np.array([[0, 0, -1]], np.float32)
    for name in OURS:
        assert hits(surfaces_of(mesh), name, rays)[1] == [0]


def test_the_depth_of_a_hierarchy_is_bounded():
    """Nested triangles, each smaller than the one before: the surface area heuristic alone makes a list of them."""
    n = 3000
    size = 2.0 ** -np.linspace(0, 60, n)
    corners = size[:, None, None] * np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1]])
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * n, dtype=np.int32).reshape(-1, 3), np.zeros(n, np.int32))
    nodes = bvh.build([(mesh.vertices, mesh.faces)], 1).nodes.view(np.int32)[:, bvh.CHILD :]
    depth = np.zeros(len(nodes), np.int64)
    for k, children in enumerate(nodes):
        depth[children[children > k]] = depth[k] + 1
    assert depth.max() <= bvh.DEEPEST + 24
    assert sorted(np.concatenate([np.arange(w >> 4, (w >> 4) + (w & 15)) for w in ~nodes[nodes < 0]])) == list(range(n))


def test_an_unknown_name_is_refused_in_one_sentence():
    with pytest.raises(SceneError, match=r"^rays must be one of .*bvh, grid3d, octree, binary_tree, bsp, none, got "):
        Solver(coloured_room(()), photons=10, rays="kd_tree")
    assert Model(coloured_room(()), rays="octree").accelerator.rays == "octree"


@pytest.mark.slow
def test_without_embreex_rays_are_traced_by_bvh_and_one_line_says_so():
    """A subprocess that cannot import embreex opens a scene, moves an object, equals the solution from scratch.

    It compiles no kernel of a structure that is not chosen.
    """
    code = """
from app.cli.progress import Bar
from gi_core.base.kernel_cache import problems
from gi_core.files.load import load_scene
from gi_core.photons.trace import _follow, _trace_paths
from gi_core.rays import bvh
from gi_core.rays.structures import STRUCTURES
from gi_core.scene.types import Pose
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, coloured_room

solver = Solver(coloured_room((box_mobile(size=0.1),)), photons=2000, radius=0.1)
solver.solve()
solver.move("box", Pose((0.4, 0.5, 0.3)))
assert (solver.irradiance == solver.from_scratch()).all() and solver.frame.changes.photons_cut
assert solver.model.accelerator.rays == "bvh" and "embree" not in STRUCTURES
compiled = {scenes.instance_class for kernel in (_follow, _trace_paths) for scenes, *_ in kernel.signatures}
assert [kind.__module__ for kind in compiled] == [bvh.__name__], compiled
others = [name for name, module in STRUCTURES.items() if name != "bvh" and module.trace.signatures]
assert not others, others
print(*problems, sep="\\n")
"""
    path = os.pathsep.join(map(str, (ROOT / "tests" / "support" / "no_embreex", ROOT)))
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    (line,) = ran.stdout.splitlines()
    assert line.startswith("Embree cannot be loaded (No module named 'embreex'): rays are traced by bvh")


@pytest.mark.parametrize("name", OTHERS)
def test_leaf_boxes_are_the_cells_that_rays_visit(name):
    """Every hit lies in a visited cell that lists triangles; but for a bvh's, cells fill the object's box."""
    meshes = [soup(60, 1), soup(200, 2, 0.1)]
    scenes = STRUCTURES[name].build([(m.vertices, m.faces) for m in meshes])
    for o, mesh in enumerate(meshes):
        boxes = leaf_boxes(scenes, o)
        volume = (boxes.high - boxes.low).prod(axis=1).sum()
        if name != "bvh":
            assert volume == pytest.approx((scenes.cells.high[o] - scenes.cells.low[o]).prod())
        origins, d = CASES["random"](300)[1]
        t, face = Accelerator(surfaces_of(mesh), rays=name).nearest(0, origins, d, np.full(300, 9, np.float32))
        for k in np.flatnonzero(face >= 0):
            seen = visited(boxes, origins[k], d[k], float(t[k]) + 1e-6)
            point = origins[k] + t[k].astype(np.float64) * d[k]
            inside = (boxes.low - 1e-6 <= point) & (point <= boxes.high + 1e-6)
            assert (seen & inside.all(axis=1) & (boxes.triangles > 0)).any()
            assert seen.sum() <= 0.6 * len(boxes.low) + 8
    assert leaf_boxes(STRUCTURES["none"].build([(meshes[0].vertices, meshes[0].faces)]), 0) is None
