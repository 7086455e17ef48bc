"""Tessellation: no T-junctions, nothing lost, the same for any order of the faces."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import face_normals, flatten
from gi_core.geometry.tessellation import Cuts, cut_edges, tessellate
from gi_core.scene import Material, Mesh, Paint, Scene, SceneError, Texture


def box(size=(1.0, 0.7, 0.3), repeat_vertices=False) -> Mesh:
    """Return a closed box of two materials; with repeated vertices as float32 files have them."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64) * size
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    material = np.array([0, 1] * 6, np.int32)
    if repeat_vertices:
        corners, faces = corners[faces.reshape(-1)], np.arange(36, dtype=np.int32).reshape(12, 3)
    return Mesh(corners, faces, material)


def edges_of(mesh: Mesh) -> np.ndarray:
    faces = weld(mesh.vertices)[mesh.faces]
    return np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)


def longest(mesh: Mesh) -> float:
    p = mesh.vertices[mesh.faces]
    d = p - np.roll(p, 1, axis=1)
    return float(np.sqrt((d * d).sum(axis=2)).max())


@pytest.mark.parametrize("repeat", [False, True])
@pytest.mark.parametrize("max_edge", [5.0, 0.4, 0.11, 0.037])
def test_closed_surface_stays_closed(max_edge, repeat):
    """Every edge of a closed surface has exactly two faces: a T-junction would leave edges with one."""
    mesh = tessellate(box(repeat_vertices=repeat), max_edge)
    _, counts = np.unique(edges_of(mesh), axis=0, return_counts=True)
    assert (counts == 2).all()
    assert longest(mesh) <= max_edge or max_edge == 5.0


def test_a_mesh_of_graded_edges_stays_closed():
    def allowed(middle, length):
        return np.maximum(0.1, (np.sqrt((middle * middle).sum(axis=-1)) - length / 2) / 4)

    mesh = tessellate(box((20.0, 20.0, 20.0)), 0.1, allowed)
    _, counts = np.unique(edges_of(mesh), axis=0, return_counts=True)
    assert (counts == 2).all()
    assert len(mesh.faces) < 20_000 < 2 * 6 * (20 / 0.1) ** 2  # far away it stays coarse


def test_thin_faces_are_split_only_with_their_neighbours():
    mesh = tessellate(box((1.0, 1.0, 0.005)), 0.1, None, 0.02)
    _, counts = np.unique(edges_of(mesh), axis=0, return_counts=True)
    assert (counts == 2).all()
    alone = box((1.0, 0.005, 0.005))
    assert len(tessellate(alone, 0.1, None, 0.02).faces) == 12


@pytest.mark.parametrize("repeat", [False, True])
@pytest.mark.parametrize(
    ("rows", "edges"), [([0], [1]), ([3, 8], [0, 2]), ([5, 5, 5], [0, 1, 2]), (range(12), [0] * 12)]
)
def test_chosen_edges_are_cut_at_their_places(rows, edges, repeat):
    before = box((1.0, 0.7, 0.1), repeat_vertices=repeat)
    rows, edges, places = np.array(rows), np.array(edges), np.linspace(0.2, 0.7, len(rows))
    mesh, pieces = cut_edges(before, Cuts(rows, edges, (edges + 1) % 3, places))
    _, counts = np.unique(edges_of(mesh), axis=0, return_counts=True)
    assert (counts == 2).all()
    assert face_normals(mesh)[1].sum() == pytest.approx(face_normals(before)[1].sum())
    start, end = before.vertices[before.faces[rows, edges]], before.vertices[before.faces[rows, (edges + 1) % 3]]
    wanted = start + places[:, None] * (end - start)
    apart = np.abs(mesh.vertices[:, None] - wanted).max(axis=2).min(axis=0)
    assert apart.max() < 1e-12
    old = {tuple(sorted(map(tuple, p))) for p in before.vertices[before.faces].tolist()}
    new = np.array([tuple(sorted(map(tuple, p))) not in old for p in mesh.vertices[mesh.faces].tolist()])
    assert np.array_equal(np.flatnonzero(new), pieces) and len(pieces) >= 2 * len(np.unique(rows))


def test_an_edge_is_cut_once_where_two_faces_ask_for_it():
    before = box()
    (f, g), (k, j) = np.nonzero((np.sort(before.faces[:, [[0, 1], [1, 2], [2, 0]]]) == [0, 1]).all(axis=2))
    one, _ = cut_edges(before, Cuts(*np.array([[f], [k], [(k + 1) % 3]]), np.array([0.3])))
    asked = np.array([[f, g, f], [k, j, (k + 1) % 3], [(k + 1) % 3, (j + 1) % 3, k]])
    both, _ = cut_edges(before, Cuts(*asked, np.array([0.3, 0.5, 0.6])))
    assert len(both.faces) == len(one.faces) == len(before.faces) + 2
    assert np.array_equal(both.vertices, one.vertices)


def test_paint_and_normals_are_interpolated_where_an_edge_is_cut():
    corners = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]], float)
    uv = np.array([[[0, 0], [1, 0], [0, 1]]], np.float32)
    colour = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], np.float32)
    normals = np.array([[[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]]])
    paint = Paint((), np.full(1, -1, np.int32), uv, colour)
    mesh = Mesh(corners, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32), normals, paint=paint)
    cut, _ = cut_edges(mesh, Cuts(*np.array([[0], [1], [0]]), np.array([0.75])))
    f, k = np.argwhere((cut.vertices[cut.faces] == [1, 0, 0]).all(axis=2))[0]
    np.testing.assert_allclose(cut.paint.corner_uv[f, k], [0.25, 0])
    np.testing.assert_allclose(cut.paint.corner_colour[f, k], [0.75, 0.25, 0])
    expected = np.array([0.15, 0, 0.95])
    np.testing.assert_allclose(cut.corner_normals[f, k], expected / np.linalg.norm(expected))


def test_area_material_and_orientation_are_kept():
    before = box()
    after = tessellate(before, 0.08)
    (n0, a0), (n1, a1) = face_normals(before), face_normals(after)
    for material in (0, 1):
        rows0, rows1 = before.face_material == material, after.face_material == material
        flux0 = (n0[rows0, :, None] * n0[rows0, None] * a0[rows0, None, None]).sum(axis=0)
        flux1 = (n1[rows1, :, None] * n1[rows1, None] * a1[rows1, None, None]).sum(axis=0)
        np.testing.assert_allclose(flux0, flux1, rtol=1e-12, atol=1e-15)
    p = after.vertices[after.faces]
    volume = (p[:, 0] * np.cross(p[:, 1], p[:, 2])).sum() / 6
    assert volume == pytest.approx(0.21, rel=1e-12)


def test_attributes_are_carried_along():
    """Normals (x, 0, 1) normalised over a unit square: interpolated, unit; reflectance is that of the parent."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    n = np.array([[0.0, 0, 1], [1, 0, 1], [1, 0, 1], [0, 0, 1]])
    n /= np.sqrt((n * n).sum(axis=1, keepdims=True))
    colours = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    mesh = tessellate(Mesh(vertices, faces, np.zeros(2, np.int32), n[faces], colours), 0.2)
    assert np.abs(np.sqrt((mesh.corner_normals**2).sum(axis=2)) - 1).max() < 1e-12
    x = mesh.vertices[mesh.faces][..., 0]
    angle = np.arctan2(mesh.corner_normals[..., 0], mesh.corner_normals[..., 2])
    assert np.abs(angle - x * np.pi / 4).max() < 1e-12  # halving an edge halves the angle
    below = mesh.vertices[mesh.faces].mean(axis=1)
    first = below[:, 1] < below[:, 0]
    np.testing.assert_array_equal(mesh.face_reflectance, np.where(first[:, None], colours[0], colours[1]))


def test_order_of_faces_does_not_matter():
    mesh = box()
    order = np.random.default_rng(3).permutation(12)
    permuted = mesh._replace(faces=mesh.faces[order], face_material=mesh.face_material[order])

    def in_order(m):
        t = tessellate(m, 0.09)
        rows = np.concatenate([t.vertices[t.faces].reshape(-1, 9), t.face_material[:, None]], axis=1)
        return rows[np.lexsort(rows.T)]

    np.testing.assert_array_equal(in_order(mesh), in_order(permuted))


def test_faces_of_different_materials_split_alike():
    """Two sheets with separate vertices meet at an edge: the shared edge gets the same points."""
    a = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, 1, 0]])
    b = np.array([[1.0, 0, 0], [0, 0, 0], [0.6, -0.2, 0.9]])
    mesh = Mesh(np.concatenate([a, b]), np.array([[0, 1, 2], [3, 4, 5]], np.int32), np.array([0, 1], np.int32))
    fine = tessellate(mesh, 0.13)
    on_edge = [np.unique(fine.vertices[fine.faces[fine.face_material == m]].reshape(-1, 3), axis=0) for m in (0, 1)]
    on_edge = [p[(p[:, 1] == 0) & (p[:, 2] == 0)] for p in on_edge]
    np.testing.assert_array_equal(*on_edge)
    assert len(on_edge[0]) == 9


def strewn_box(seed: int) -> Mesh:
    """A closed box with sides of very unequal cells, each cell of one of four materials.

    Faces share no vertices, as in files where materials or images change.
    """
    rng = np.random.default_rng(seed)
    cuts = [np.unique(np.concatenate([[0, 1], rng.random(3) ** 3])) * length for length in (2.0, 1.0, 0.5)]
    corners, material = [], []
    for axis in range(3):
        u, v = cuts[(axis + 1) % 3], cuts[(axis + 2) % 3]
        for end in (0, 1):
            for i in range(len(u) - 1):
                for j in range(len(v) - 1):
                    cell = np.zeros((4, 3))
                    cell[:, axis] = cuts[axis][-1] * end
                    cell[:, (axis + 1) % 3] = u[[i, i + 1, i + 1, i]]
                    cell[:, (axis + 2) % 3] = v[[j, j, j + 1, j + 1]]
                    cell = cell if end else cell[::-1]
                    turned = np.roll(cell, rng.integers(4), axis=0)
                    corners += [turned[[0, 1, 2]], turned[[0, 2, 3]]]
                    material += [rng.integers(4)] * 2
    order = rng.permutation(len(corners))
    corners = np.array(corners)[order].reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3), np.array(material, np.int32)[order])


def shared_edges(mesh: Mesh) -> np.ndarray:
    """Return the edges by vertex. Welding in cells of a millionth of the box would merge separate vertices."""
    return np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)


def vertices_inside_edges(mesh: Mesh) -> int:
    """Count T-junctions: vertices that lie on an edge of some face between its ends."""
    ends = np.unique(shared_edges(mesh), axis=0)
    a, b = mesh.vertices[ends[:, 0]], mesh.vertices[ends[:, 1]]
    half, points = np.sqrt(((b - a) ** 2).sum(axis=1)) / 2, mesh.vertices[np.unique(mesh.faces)]
    near = cKDTree(points).query_ball_point((a + b) / 2, half)  # a vertex inside an edge is in the ball around it
    edge = np.repeat(np.arange(len(ends)), [len(rows) for rows in near])
    along, off = (b - a)[edge], points[np.concatenate(near).astype(int)] - a[edge]
    length = (along * along).sum(axis=1)
    share = (along * off).sum(axis=1) / length
    away = ((off - share[:, None] * along) ** 2).sum(axis=1)
    return int(((away < 1e-18 * length) & (share > 1e-9) & (share < 1 - 1e-9)).sum())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("how", ["even", "near", "thin"])
def test_no_junctions_between_faces_of_any_material_and_size(seed, how):
    """Cells from a millionth to most of the side of a box, four materials: no vertex inside an edge, no edge alone."""
    near = (lambda middle, length: 0.11 + np.abs(middle).max(axis=-1) / 4) if how == "near" else None
    before = strewn_box(seed)
    mesh = tessellate(before, 0.11, near, 0.02 if how == "thin" else 0.0)
    assert len(mesh.faces) > len(before.faces)
    _, counts = np.unique(shared_edges(mesh), axis=0, return_counts=True)
    assert (counts == 2).all()
    assert vertices_inside_edges(mesh) == 0


def test_junction_count_detects_a_junction():
    """A whole edge beside two halves: the defect that the test above excludes."""
    v = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0], [0.3, -1, 0]])
    faces = np.array([[0, 1, 2], [0, 4, 3], [3, 4, 1]], np.int32)
    assert vertices_inside_edges(Mesh(v, faces, np.zeros(3, np.int32))) == 1


def test_triangles_of_several_colours_share_irradiance():
    """Report 3.4.2: E is stored per position and normal; materials, images and seams create no second receiver."""
    before = strewn_box(1)
    rng = np.random.default_rng(2)
    n = len(before.faces)
    images = (Texture(np.zeros((2, 2, 3), np.uint8)), Texture(np.ones((2, 2, 3), np.uint8)))
    paint = Paint(images, rng.integers(-1, 2, n).astype(np.int32), rng.random((n, 3, 2), np.float32),
                  rng.random((n, 3, 3), np.float32))  # fmt: skip
    mesh = tessellate(before._replace(paint=paint), 0.11)
    materials = tuple(Material(f"m{k}", (0.1 + 0.2 * k,) * 3) for k in range(4))
    surfaces, receivers = flatten(Scene(mesh, materials))
    normals, _ = face_normals(mesh)
    side = 2 * np.abs(normals).argmax(axis=1) + (normals.max(axis=1) > 0.5)
    place = weld(mesh.vertices)[mesh.faces]
    key = (place * 6 + side[:, None]).reshape(-1)
    pairs = np.unique(np.stack([key, surfaces.corner_front.reshape(-1)], axis=1), axis=0)
    assert len(pairs) == len(np.unique(key)) == len(receivers.areas)
    coloured = np.unique(np.stack([surfaces.corner_front[:, 0], mesh.face_material], axis=1), axis=0)
    assert len(coloured) > 1.05 * len(np.unique(coloured[:, 0])), "several materials do meet at receivers"


def test_absurd_lengths_are_refused():
    with pytest.raises(SceneError, match="makes more than 4,000,000 triangles; write a larger one"):
        tessellate(box(), 1e-5)
    with pytest.raises(SceneError, match="max_edge must be a length > 0, got 0"):
        tessellate(box(), 0)


@pytest.mark.parametrize(("length", "width", "most"), [(10.0, 0.001, 700), (10.0, 0.05, 700), (80.0, 0.001, 4500)])
def test_a_long_strip_is_cut_across(length, width, most):
    """Halved with its diagonals it would become 4,374 pieces, or 39,366; area, sides and attributes stay.

    Of pieces no longer than 0.1, a strip needs 200 (1,600) triangles; its diagonal is an edge of the file and cut too.
    """
    corners = np.array([[0, 0, 0], [length, 0, 0], [length, width, 0], [0, width, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uv = (corners[faces][..., :2] * [2.0, 30.0]).astype(np.float32)
    paint = Paint((Texture(np.zeros((2, 2, 3), np.uint8)),), np.zeros(2, np.int32), uv, np.ones((2, 3, 3), np.float32))
    lean = np.array([[0.0, 0, 1], [0.6, 0, 0.8], [0.6, 0, 0.8], [0, 0, 1]])[faces]
    fine = tessellate(Mesh(corners, faces, np.array([3, 4], np.int32), lean, paint=paint), 0.1)
    assert length / 0.1 * 2 <= len(fine.faces) < most
    assert longest(fine) < 0.1 * 1.2 and vertices_inside_edges(fine) == 0
    normals, areas = face_normals(fine)
    assert areas.min() > 0 and normals[:, 2].min() > 0
    for material in (3, 4):
        assert areas[fine.face_material == material].sum() == pytest.approx(length * width / 2)
    at = fine.vertices[fine.faces]
    np.testing.assert_allclose(fine.paint.corner_uv, at[..., :2] * [2.0, 30.0], atol=1e-4 * length)
    np.testing.assert_allclose((fine.corner_normals**2).sum(axis=2), 1.0)
    tilt = fine.corner_normals[..., 0]
    assert np.ptp(tilt[at[..., 0] == 0]) == 0 and np.abs(tilt[at[..., 0] == length] - 0.6).max() < 1e-12


@pytest.mark.slow
def test_endless_sliver_is_refused_before_it_fills_memory():
    corners = np.array([[0.0, 0, 0], [1e6, 0, 0], [5e5, 1e-6, 0]])
    sliver = Mesh(corners, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32))
    with pytest.raises(SceneError, match="max_edge 0.01 makes more than 4,000,000 triangles"):
        tessellate(sliver, 0.01)
