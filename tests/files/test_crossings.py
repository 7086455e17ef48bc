"""Edges that enter other parts get corners in front of them; all other meshes stay as they are."""

import numpy as np
import pytest

from gi_core.discs.region import look_from
from gi_core.files.completion.crossings import with_corners_at_crossings as cut
from gi_core.files.edits import Insert, edited
from gi_core.files.load import load_scene
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import evaluation_points, face_normals
from gi_core.model import Model
from gi_core.scene.types import Mesh, PointLight, Scene
from tests.support.mesh_writers import write_obj, write_scene
from tests.support.scene_builders import box, grey, lamp, merge, quad, solve

POSTS = box((-0.55, -0.05, 0), (-0.45, 0.05, 0.6)), box((0.45, -0.05, 0), (0.55, 0.05, 0.6))
RAIL = box((-0.5, -0.02, 0.3), (0.5, 0.02, 0.34))
RACK = merge(*POSTS, RAIL)
ONE, TWO = (grey(0.7),), (grey(0.7, two_sided=True),)


def rail_of(mesh: Mesh) -> np.ndarray:
    """Return which faces are of the rail, without its ends."""
    p = mesh.vertices[mesh.faces]
    return (np.abs(p[..., 1]) < 0.03).all(axis=1) & (np.ptp(p[..., 0], axis=1) > 0)


@pytest.mark.parametrize("materials", [ONE, TWO])
def test_a_rail_between_posts_gets_corners_in_front_of_them(materials):
    mesh = cut(RACK, materials)
    x = mesh.vertices[mesh.faces[rail_of(mesh)]][..., 0]
    open_ = np.abs(x) < 0.45
    assert ((np.abs(x) > 0.435) | ~open_).all() and open_.sum() > 24
    assert not ((x < -0.45) & (np.roll(x, 1, axis=1) > 0.45)).any()  # no edge from post to post
    assert len(mesh.faces) < 4 * len(RACK.faces)
    edges = np.sort(weld(mesh.vertices)[mesh.faces][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert face_normals(mesh)[1].sum() == pytest.approx(face_normals(RACK)[1].sum())


def test_a_board_gets_corners_in_front_of_both_cupboards():
    """All but the tenth in the middle is inside two cupboards."""
    cupboards = box((-1.0, -0.3, 0), (-0.02, 0.3, 0.6)), box((0.08, -0.3, 0), (1.0, 0.3, 0.6))
    mesh = cut(merge(*cupboards, box((-0.9, -0.1, 0.3), (0.9, 0.1, 0.32))), ONE)
    x = mesh.vertices[(np.abs(mesh.vertices[:, 1]) < 0.2) & (mesh.vertices[:, 2] < 0.4)][:, 0]
    assert ((x > -0.02) & (x < 0.01)).any() and ((x > 0.05) & (x < 0.08)).any()


@pytest.mark.parametrize("height", [0.0, -0.1])
def test_a_floor_has_corners_round_the_foot_of_a_box(height):
    """It stands on the floor, or reaches below. All edges of the floor that cross its sides get a corner there."""
    floor = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (8, 8))
    mesh = cut(merge(floor, box((-0.4, -0.4, height), (0.4, 0.4, 0.5))), ONE)
    p = mesh.vertices[mesh.faces]
    p = p[(np.abs(p[..., 2]) < 1e-9).all(axis=1) & (np.abs(p[..., :2]).max(axis=2) > 0.41).any(axis=1)]
    outside = np.abs(p[..., :2]).max(axis=2)
    assert ((outside < 0.4) | (outside > 0.4)).all()
    foot = (outside > 0.4) & (outside < 0.405)
    assert foot.sum() > 60
    enters = (outside < 0.4).any(axis=1)
    # The foot of a face that goes on below the box lies beside the box, but at its four corners.
    assert ((outside > 0.405) & enters[:, None]).any(axis=1).sum() <= 8


@pytest.mark.parametrize(
    "mesh",
    [
        RAIL,  # in the open
        box((0, 0, 0), (1, 1, 1), inward=True),  # corners of a room
        merge(box((-1, -1, 0), (1, 1, 1)), box((-0.5, -0.5, 0.2), (0.5, 0.5, 0.8))),  # altogether inside
        merge(quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), box((0.2, -0.1, 0), (0.3, 0.0, 0.5))),  # within a face
        merge(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((1.0002, 0, 0), (0, 0, 1), (0, 1, 0))),  # touching
        Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int32)),
        Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32)),  # without area
    ],
)
@pytest.mark.parametrize("materials", [ONE, TWO])
def test_other_meshes_stay_as_they_are(mesh, materials):
    assert cut(mesh, materials) is mesh


def test_a_corner_on_the_plane_of_a_wall_is_kept_from_its_dark_side():
    """A floor goes on below a wall; corners lie on the wall's plane. Those may take the light of either side."""
    floor = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (8, 8))
    wall = box((-1.1, 0.0, -0.2), (1.1, 0.7, 1.0))
    p = cut(merge(floor, wall), ONE).vertices
    y = np.unique(p[(np.abs(p[:, 2]) < 1e-9) & (np.abs(p[:, 1]) < 0.1)][:, 1])
    assert 0.0 in y and ((y < -0.001) & (y > -0.006)).any()
    wall = box((-1.1, 0.0, 0.0), (1.1, 0.7, 1.0))
    joint = merge(quad((-1, -1, 0), (2, 0, 0), (0, 1, 0), (8, 4)), wall)  # the floor ends there
    assert cut(joint, ONE) is joint


def test_regions_of_new_corners_are_measured_from_in_front_of_the_wall():
    """A large disc: a hundredth of its radius is more than the way to the wall."""
    wall = box((-1.1, 0.06, -0.2), (1.1, 0.7, 1.0))
    scene = Scene(cut(merge(quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (8, 8)), wall), ONE), ONE, up=(0, 0, 1))
    model = Model(scene, 1)
    points, normals = look_from(model, 0, 0.6)
    y = model.object_receivers.positions[:, 1]
    new = (normals[:, 2] > 0.9) & (points[:, 2] < 0.1) & (y > 0.05) & (y < 0.06)
    assert new.sum() > 8 and (points[new, 1] < 0.06).all()


def test_short_edges_stay():
    """A cube of 4 cm lies across the joint of two large ones: they get corners round it, it gets none."""
    large = box((-1, -1, 0), (0, 1, 1), 8), box((0, -1, 0), (1, 1, 1), 8)
    small = box((-0.02, -0.02, 0.98), (0.02, 0.02, 1.02))
    p = cut(merge(*large, small), ONE)
    on_small = (np.abs(p.vertices[p.faces][..., :2]) < 0.021).all(axis=(1, 2)) & (
        p.vertices[p.faces][..., 2] > 0.97
    ).all(1)
    assert on_small.sum() == 12


def test_a_soup_of_triangles_ends():
    rng = np.random.default_rng(3)
    points = (rng.random((3000, 1, 3)) + 0.2 * rng.normal(size=(3000, 3, 3))).reshape(-1, 3)
    soup = Mesh(points, np.arange(9000, dtype=np.int32).reshape(-1, 3), np.zeros(3000, np.int32))
    mesh = cut(soup, TWO)
    assert len(mesh.faces) < 150_000 and np.isfinite(mesh.vertices).all()
    assert face_normals(mesh)[1].sum() == pytest.approx(face_normals(soup)[1].sum())


SCENE = """
[static]
mesh = "room.obj"
max_edge = 10

[[light]]
type = "point"
position = [0, -1, 1]
flux = [10, 10, 10]

[[mobile]]
name = "rack"
mesh = "rack.obj"
position = [0, 0, 0]
"""


def test_scenes_with_racks_equal_however_the_rack_comes(tmp_path):
    """By a scene file, by an option, and by an edit: as static part and as mobile."""
    write_obj(tmp_path / "rack.obj", RACK.vertices, RACK.faces)
    room = box((-2, -2, 0), (2, 2, 2), 4, inward=True)
    write_obj(tmp_path / "room.obj", room.vertices, room.faces)
    described = load_scene(write_scene(tmp_path, 'up = "z"\n' + SCENE))
    faces = len(described.mobiles[0].mesh.faces)
    assert len(RACK.faces) < faces == len(cut(RACK, TWO).faces)
    inserted = edited(described, [Insert("other", str(tmp_path / "rack.obj"))])
    given = load_scene(tmp_path / "scene.toml", mobiles=[tmp_path / "rack.obj"])
    assert np.array_equal(inserted.mobiles[-1].mesh.faces, given.mobiles[-1].mesh.faces)
    both = load_scene(tmp_path / "rack.obj", max_edge=np.inf)
    assert rail_of(both.static).sum() > rail_of(RACK).sum()


def test_a_rail_is_as_bright_as_the_reference_says():
    room = box((-1, -1, 0), (1, 1, 1.5), 8, inward=True)
    mesh = merge(room, quad((-0.4, -0.3, 1.49), (0, 0.6, 0), (0.6, 0, 0), (2, 2), 1), cut(RACK, ONE))
    scene = Scene(mesh, (grey(0.5), lamp(5.0)), (), (PointLight("p", (-0.5, -0.5, 1.0), (3.0,) * 3),), up=(0, 0, 1))
    model = Model(scene, 2)
    points, normals = evaluation_points(model.surfaces, model.object_receivers)
    on_rail = (np.abs(points[:, 1]) < 0.03) & (np.abs(points[:, 0]) < 0.45) & (np.abs(points[:, 2] - 0.32) < 0.03)
    truth, _ = reference_irradiance(scene, points[on_rail], normals[on_rail], 400, 1, model=model)
    solver = solve(scene, photons=200_000, radius=0.03, light="photons")
    assert on_rail.sum() >= 4 and truth.min() > 0.1 * truth.max()
    areas = solver.receivers.areas[on_rail]
    assert areas @ solver.irradiance[on_rail] == pytest.approx(areas @ truth, rel=0.15)
