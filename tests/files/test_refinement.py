"""Bare meshes: a budget of receivers is spent on lit surfaces in view, none on sides without light."""

import numpy as np
import pytest

from gi_core.files import load
from gi_core.files.completion.pilot import Rays, useful_box
from gi_core.files.completion.refinement import FINEST, UNSEEN_FACTOR, refined
from gi_core.files.completion.sides import one_sided_where_dark
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import face_normals, flatten
from gi_core.scene import Camera, PointLight, Scene
from gi_core.solver import Solver
from tests.support.mesh_writers import BOX, BOX_FACES, write_obj, write_room
from tests.support.scene_builders import box, grey, lamp, merge, quad

TWO_SIDED, LAMP = grey(0.5, two_sided=True), lamp(10.0)
BULB = PointLight("bulb", (1.5, 2.5, 1.5), (10.0, 10.0, 10.0))


def spent(scene: Scene, budget: int):
    rays = Rays(scene)
    mesh, edge = refined(scene, rays, useful_box(scene, rays), budget)
    _, receivers = flatten(Scene(mesh, scene.materials))
    return mesh, edge, len(receivers.positions)


def edges(mesh, rows) -> np.ndarray:
    p = mesh.vertices[mesh.faces[rows]]
    d = p - np.roll(p, 1, axis=1)
    return np.sqrt((d * d).sum(axis=2)).max(axis=1)


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("budget", [2000, 6000])
def test_both_sides_count_in_the_budget(budget, two_sided):
    """A room of 3 m: at most the budget, and at least half of it is used."""
    room = box((0, 0, 0), (3, 3, 3), inward=True)
    _, edge, receivers = spent(Scene(room, (grey(0.5, two_sided),), (), (BULB,)), budget)
    assert 0.5 * budget < receivers < 1.1 * budget and edge > FINEST * 3


def test_refinement_stops_at_the_finest_useful_edge():
    mesh, edge, receivers = spent(Scene(box((0, 0, 0), (3, 3, 3), inward=True), (grey(0.5),), (), (BULB,)), 10**6)
    assert edge == pytest.approx(FINEST * 3, rel=0.05) and receivers < 60_000


def test_finest_where_light_lands_and_the_camera_looks():
    """Two rooms: a lamp in the one, the other closed and dark. The camera sees one half of the lit one."""
    two = merge(box((0, 0, 0), (3, 3, 3), inward=True), box((4, 0, 0), (7, 3, 3), inward=True))
    camera = Camera((1.5, 1.5, 1.6), (1.5, 1.5, 0.0), 60.0)
    mesh, edge, _ = spent(Scene(two, (grey(0.5),), (), (BULB,), camera=camera), 20_000)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    dark = middle[:, 0] > 4.5
    seen = (middle[:, 2] < 0.01) & (np.abs(middle[:, :2] - 1.5) < 0.6).all(axis=1)
    behind = (middle[:, 2] > 2.99) & (np.abs(middle[:, :2] - 1.5) < 0.6).all(axis=1)
    assert edges(mesh, seen).mean() < 0.9 * edges(mesh, behind).mean()
    assert edges(mesh, dark).mean() > 2 * edges(mesh, seen).mean()
    assert edges(mesh, behind).max() <= UNSEEN_FACTOR * edge * 1.01


def test_fine_parts_leave_budget_for_coarse_ones():
    """A grid of 20,000 triangles on one wall of a room: over the budget already, and the floor is cut all the same."""
    fine = quad((0, 0, 0), (0, 3, 0), (0, 0, 3), (100, 100))
    room = merge(fine, box((0, 0, 0), (3, 3, 3), inward=True))
    mesh, _, _ = spent(Scene(room, (TWO_SIDED,), (), (BULB,)), 9000)
    floor = (mesh.vertices[mesh.faces][..., 1] == 0).all(axis=1)
    assert floor.sum() > 100


def sides(static, lights=(BULB,)):
    scene = Scene(static, (TWO_SIDED, LAMP), (), lights)
    return one_sided_where_dark(scene, useful_box(scene, Rays(scene)))


def two_sided(scene: Scene, rows=slice(None)) -> np.ndarray:
    return np.array([m.two_sided for m in scene.materials])[scene.static.face_material[rows]]


ROOM = box((0, 0, 0), (3, 3, 3), inward=True)


@pytest.mark.parametrize("inside_out", [False, True])
def test_inside_of_a_crate_is_removed(inside_out):
    """A crate in an open hall, wound either way, and one face of it turned: all fronts look outwards afterwards."""
    crate = box((1, 0.1, 1), (2, 1.1, 2), inward=inside_out)
    crate.faces[3] = crate.faces[3][::-1]
    scene = sides(merge(quad((0, 0, 0), (0, 0, 3), (3, 0, 0)), crate))
    rows = slice(2, 14)
    assert not two_sided(scene, rows).any()
    outwards = scene.static.vertices[scene.static.faces[rows]].mean(axis=1) - (1.5, 0.6, 1.5)
    assert ((face_normals(scene.static)[0][rows] * outwards).sum(axis=1) > 0).all()
    assert any("one-sided: no light gets to their other side" in n for n in scene.notes)
    assert face_normals(scene.static)[1].sum() == pytest.approx(9 + 6)


def test_an_obj_is_two_sided_in_a_scene_file_and_one_sided_alone_where_dark(tmp_path):
    """As docs/your-own-room.md says; the room of a shipped helper: only its lamp keeps both sides."""
    (write_room(tmp_path) / "a.toml").write_text('[static]\nmesh = "room.obj"')
    described, alone = (load_scene(tmp_path / name, max_edge=np.inf) for name in ("a.toml", "room.obj"))
    assert two_sided(described).all() and not any("one-sided" in note for note in described.notes)
    assert not two_sided(alone, slice(12)).any() and any("12 of 14 triangles are one-sided" in n for n in alone.notes)


def test_outside_of_a_lit_room_is_removed():
    for room in (ROOM, box((0, 0, 0), (3, 3, 3))):
        scene = sides(room)
        inwards = (1.5, 1.5, 1.5) - scene.static.vertices[scene.static.faces].mean(axis=1)
        assert not two_sided(scene).any()
        assert ((face_normals(scene.static)[0] * inwards).sum(axis=1) > 0).all()


CRATE = box((1, 0.1, 1), (2, 1.1, 2))


@pytest.mark.parametrize("what", ["lamp", "point"])
def test_crate_with_a_lamp_inside_keeps_its_inner_side(what):
    bulb = quad((1.4, 0.5, 1.4), (0.1, 0, 0), (0, 0, 0.1), material=1)
    parts = [quad((0, 0, 0), (0, 0, 3), (3, 0, 0)), CRATE, *([bulb] if what == "lamp" else [])]
    scene = sides(merge(*parts), (BULB, PointLight("p", (1.5, 0.6, 1.5), (1.0,) * 3)) if what == "point" else (BULB,))
    assert two_sided(scene, slice(2, 14)).all()


def test_open_sheet_lit_on_both_sides_keeps_both():
    sheet = quad((1, 1, 1), (1, 0, 0), (0, 0, 1))
    scene = sides(merge(ROOM, sheet), (BULB, PointLight("q", (1.5, 0.5, 1.5), (10.0,) * 3)))
    assert two_sided(scene, slice(12, 14)).all()


def test_kept_side_has_the_same_light():
    """Irradiance on the fronts, with the dark sides and without, photon by photon."""
    room = merge(ROOM, box((1, 0, 1), (2, 1, 2)))
    before = Scene(room, (TWO_SIDED,), (), (BULB,))
    after = one_sided_where_dark(before, useful_box(before, Rays(before)))
    assert np.array_equal(after.static.faces, room.faces)  # nothing had to be turned
    with_backs, without = (Solver(s, photons=2000, radius=0.3, seed=1) for s in (before, after))
    with_backs.solve()
    without.solve()
    n = len(without.irradiance)
    assert n == len(with_backs.irradiance) / 2
    np.testing.assert_array_equal(without.irradiance, with_backs.irradiance[:n])


def test_a_bare_file_keeps_to_its_budget(tmp_path, monkeypatch):
    write_room(tmp_path)
    monkeypatch.setattr(load, "MOST_RECEIVERS", 3000)
    scene = load_scene(tmp_path / "room.obj")
    _, receivers = flatten(scene)
    assert 1500 < len(receivers.positions) < 3300
    assert any(n.startswith("mesh refined for light, edges up to ") for n in scene.notes)
    whole = load_scene(tmp_path / "room.obj", max_edge=np.inf)
    assert len(whole.static.faces) == 14
    asked = load_scene(tmp_path / "room.obj", max_edge=0.2)
    assert edges(asked.static, slice(None)).max() <= 0.2


def test_closed_mesh_without_lights_is_one_sided(tmp_path):
    scene = load_scene(write_obj(tmp_path / "crate.obj", BOX, BOX_FACES), max_edge=np.inf)
    assert not two_sided(scene).any()


def test_faces_below_the_weld_do_not_count_as_made(tmp_path):
    """The weld drops tiny faces, so that a fine mesh lost more than it gained: the square root of a negative."""
    vertices, faces = [], []
    n = 30
    for k in range(6):  # a closed room of small squares
        a, b, c = np.roll(np.eye(3), k % 3, axis=0)
        side = np.stack([i * a + j * b + (k > 2) * n * c for i in range(n + 1) for j in range(n + 1)]) / n
        at = np.array([i * (n + 1) + j for i in range(n) for j in range(n)])
        quads = np.concatenate([at[:, None] + t for t in ([0, n + 1, n + 2], [0, n + 2, 1])])
        faces.append(quads + sum(len(v) for v in vertices))
        vertices.append(side)
    for place in np.random.default_rng(0).uniform(0.2, 0.8, (300, 1, 3)):
        faces.append(np.arange(3)[None] + sum(len(v) for v in vertices))
        vertices.append(place + 3e-7 * np.eye(3))
    scene = load_scene(write_obj(tmp_path / "room.obj", np.concatenate(vertices), np.concatenate(faces)))
    assert len(scene.static.faces) >= 6 * 2 * n * n


@pytest.mark.parametrize(
    "far, edge",
    [
        ("", 0.05),
        ("v 448e3 0 0\nv 448001 0 0\nv 448e3 0 1\nusemtl wall\nf 13 14 15\n", 0.05),
        ("v -25 -9 -25\nv 25 -9 -25\nv 0 -9 25\nusemtl wall\nf 13 14 15\n", 0.8),
    ],
    ids=["a room", "stray triangle", "ground below"],
)
def test_a_scene_file_of_long_edges_is_refined_as_its_mesh_alone(far, edge, tmp_path):
    """A floor of four corners had 26 lx in place of 18; what light does not reach is no reason to let it be.

    edge [m]: asked for, below and above those of refinement.
    """
    write_room(tmp_path)
    file, mesh = tmp_path / "room.toml", tmp_path / "room.obj"
    mesh.write_text(mesh.read_text() + far)
    file.write_text('title = "room"\n[static]\nmesh = "room.obj"\n')
    scene = load_scene(file)
    (note,) = (n for n in scene.notes if n.startswith("mesh refined for light"))
    assert f"triangles became {len(scene.static.faces):,}" in note and len(scene.static.faces) > 600
    as_it_is, finer = (load_scene(file, max_edge=asked) for asked in (np.inf, edge))
    file.write_text(file.read_text() + f"max_edge = {edge}\n")
    by_file = load_scene(file)
    for asked in (as_it_is, finer, by_file):
        assert not any("refined" in n for n in asked.notes)
    assert len(as_it_is.static.faces) < 20 < len(finer.static.faces) == len(by_file.static.faces)
