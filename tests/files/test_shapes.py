"""Tables [[shape]]: closed forms of area and volume, normals, tight seams, light, mistakes."""

import numpy as np
import pytest

from app.cli import saved_scene
from app.settings import Settings, open_scene
from gi_core.files.formats.shapes import SHAPES
from gi_core.files.load import load_scene
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.receivers import weld
from gi_core.geometry.surfaces import face_normals
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import axis_angle, rotation
from gi_core.scene.types import Camera, Mesh, Pose

L = [[0, 0], [1, 0], [1, 0.25], [0.25, 0.25], [0.25, 1], [0, 1]]
BAND = np.pi * (0.5**2 - 0.3**2) / 2 + 2 * 0.2 * 0.7  # of the arch: half a ring on two legs
AROUND = np.pi * 0.8 + 2 * 2 * 0.7  # its two curves
SOLIDS = {  # values, volume, area
    "room": ("size = [4, 2.5, 3]", -30.0, 2 * (10 + 12 + 7.5)),
    "box": ("size = [4, 2.5, 3]", 30.0, 2 * (10 + 12 + 7.5)),
    "sphere": ("radius = 0.5", np.pi / 6, np.pi),
    "cylinder": ("radius = 0.5\nheight = 2", np.pi / 2, 2.5 * np.pi),
    "cone": ("radius = 0.5\nheight = 1.2", np.pi * 0.1, np.pi * 0.5 * (0.5 + 1.3)),
    "cone top": ("radius = 0.3\ntop = 0.5\nheight = 0.2", 0.2 * np.pi * 0.49 / 3, np.pi * (0.34 + 0.8 * 0.08**0.5)),
    "arch": ("size = [1, 1.2, 0.4]\nthickness = 0.2", 0.4 * BAND, 2 * BAND + 0.4 * (AROUND + 0.4)),
    "extrusion": (f"outline = {L}\nheight = 0.5", 0.5 * 0.4375, 2 * 0.4375 + 0.5 * 4),
    "extrusion closed": (f"outline = {[*L, [0, 0.5], L[0]]}\nheight = 0.5", 0.5 * 0.4375, 2 * 0.4375 + 0.5 * 4),
    "extrusion clockwise": (f"outline = {L[::-1]}\nheight = 0.5", 0.5 * 0.4375, 2 * 0.4375 + 0.5 * 4),
}


def scene_of(folder, text: str):
    (folder / "a.toml").write_text(text + "\n[camera]\nposition = [0, 1, 5]\ntarget = [0, 0, 0]\n")
    return load_scene(folder / "a.toml")


def table(name: str, values: str = "") -> str:
    return f'[[shape]]\nname = "thing"\ntype = "{name.split()[0]}"\n{values or SOLIDS[name][0]}\n'


LIT = '[[light]]\ntype = "sky"\nradiance = [1, 1, 1]\n'


def of_static(folder, text: str, max_edge: float | None = 0.05) -> Mesh:
    static = f"[static]\nmax_edge = {max_edge}\n" if max_edge else ""
    return scene_of(folder, static + LIT + text).static


def volume(mesh: Mesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


def borders(mesh: Mesh) -> np.ndarray:
    """Return the lengths of edges without a face on the other side that runs them backwards."""
    places = weld(mesh.vertices)[mesh.faces]
    ends = np.stack([places, np.roll(places, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, count = np.unique(ends, axis=0, return_counts=True)
    assert (count == 1).all()
    count = places.max() + 1
    a, b = edges[~np.isin(edges @ [count, 1], edges @ [1, count])].T
    at = np.zeros((count, 3))
    at[places] = mesh.vertices[mesh.faces]
    return np.sqrt(((at[a] - at[b]) ** 2).sum(axis=1))


@pytest.mark.parametrize("max_edge", [None, 0.05])
@pytest.mark.parametrize("name", SOLIDS)
def test_a_solid_is_tight_and_has_its_area_and_volume(name, max_edge, tmp_path):
    mesh = of_static(tmp_path, table(name), max_edge)
    _, of_solid, of_surface = SOLIDS[name]
    flat = name in ("room", "box") or name.startswith("extrusion")
    within = 1e-12 if flat else 0.004 if max_edge else 0.03
    normals, areas = face_normals(mesh)
    assert len(borders(mesh)) == 0
    assert volume(mesh) == pytest.approx(of_solid, rel=within)
    assert areas.sum() == pytest.approx(of_surface, rel=within)
    assert areas.min() > 0
    cosine = (mesh.corner_normals * normals[:, None]).sum(axis=2)
    assert cosine.min() > (1 - 1e-12 if flat else 0.85 if name == "cone" else 0.98)
    np.testing.assert_allclose((mesh.corner_normals**2).sum(axis=2), 1, atol=1e-9)
    if max_edge:
        p = mesh.vertices[mesh.faces]
        assert ((p - np.roll(p, 1, axis=1)) ** 2).sum(axis=2).max() <= max_edge**2


def test_every_type_is_tested():
    assert {name.split()[0] for name in SOLIDS} | {"plane"} == set(SHAPES)


def test_a_plane_faces_up(tmp_path):
    mesh = of_static(tmp_path, table("plane", "size = [2, 0.5]"))
    assert (mesh.corner_normals == [0, 1, 0]).all()
    assert borders(mesh).sum() == pytest.approx(5) and face_normals(mesh)[1].sum() == pytest.approx(1)


def test_normals_of_curved_sides_are_exact(tmp_path):
    mesh = of_static(tmp_path, table("sphere"))
    out = mesh.vertices[mesh.faces] - [0, 0.5, 0]
    np.testing.assert_allclose(mesh.corner_normals, out / 0.5, atol=1e-9)
    mesh = of_static(tmp_path, table("cylinder"))
    side = np.abs(mesh.corner_normals[:, 0, 1]) < 0.5
    out = mesh.vertices[mesh.faces[side]] * [1, 0, 1]
    np.testing.assert_allclose(mesh.corner_normals[side], out / 0.5, atol=1e-9)
    mesh = of_static(tmp_path, table("cone"))
    side = mesh.corner_normals[:, 0, 1] > 0
    n, p = mesh.corner_normals[side], mesh.vertices[mesh.faces[side]]
    np.testing.assert_allclose(n[..., 1], 0.5 / 1.3, atol=1e-9)
    beside = np.hypot(p[..., 0], p[..., 2]) > 1e-6
    across = n[..., 0] * p[..., 2] - n[..., 2] * p[..., 0]
    assert np.abs(across[beside]).max() < 1e-9 and (~beside).any()


@pytest.mark.parametrize("up", "xyz")
def test_shapes_stand_along_up_with_sizes_along_the_axes(up, tmp_path):
    room = table("room", 'size = [4, 2, 3]\nopenings = [{ wall = "left", position = [0.3, 0.4], size = [0.5, 0.7] }]')
    mesh = scene_of(tmp_path, f'up = "{up}"\n{LIT}{room}').static
    k = "xyz".index(up)
    low = np.array([-2.0, -1.0, -1.5])
    high = -low
    low[k], high[k] = 0, (4, 2, 3)[k]
    assert (mesh.vertices.min(axis=0) == low).all() and (mesh.vertices.max(axis=0) == high).all()
    wall = 1 if up == "x" else 0  # left is -x, but -y where x leads up
    along = next(m for m in range(3) if m not in (k, wall))
    normals, areas = face_normals(mesh)
    left = (mesh.vertices[mesh.faces][:, :, wall] == low[wall]).all(axis=1)
    assert (normals[left][:, wall] == 1).all()
    assert areas[left].sum() == pytest.approx((high - low)[[k, along]].prod() - 0.35)
    hole = mesh.vertices[mesh.faces[left]].mean(axis=1)[:, [along, k]]
    assert not ((hole > [0.3, 0.4]) & (hole < [0.8, 1.1])).all(axis=1).any()
    assert borders(mesh).sum() == pytest.approx(2.4)


def test_an_opening_has_a_reveal_where_walls_are_thick(tmp_path):
    window = '{ wall = "back", position = [-0.5, 0.9], size = [1, 1.2] }'
    door = '{ wall = "back", position = [1.1, 0], size = [0.9, 2] }'
    text = f'size = [4, 2.5, 3]\nopenings = [{window}, {door}]\nmaterials = {{ back = "brick" }}\nthickness = 0.3'
    colour = "[materials.brick]\nreflectance = [0.5, 0.1, 0.1]\n"
    scene = scene_of(tmp_path, f"[static]\nmax_edge = 0.2\n{LIT}{colour}{table('room', text)}")
    mesh, names = scene.static, [m.name for m in scene.materials]
    normals, areas = face_normals(mesh)
    assert borders(mesh).sum() == pytest.approx(4.4 + 5.8)  # all on the outside
    assert areas.sum() == pytest.approx(59 - 1.2 - 1.8 + 0.3 * (4.4 + 5.8))
    assert areas[mesh.face_material == names.index("brick")].sum() == pytest.approx(10 - 3 + 0.3 * 10.2)
    p = mesh.vertices[mesh.faces].mean(axis=1)
    outside = p[:, 2] < -1.5
    assert areas[outside].sum() == pytest.approx(0.3 * 10.2)
    of_window = outside & (p[:, 0] < 0.6)
    assert (((p - [0, 1.5, 0]) * normals)[of_window].sum(axis=1) < 0).all()  # towards its middle


def test_position_and_rotation_are_those_of_mobiles(tmp_path):
    place = "position = [1, 2, 3]\naxis = [0, 0, 1]\nangle = 30\n"
    box = table("box", "size = [1, 2, 3]")
    still = of_static(tmp_path, box + place, 0.3)
    moved = scene_of(tmp_path, f"{LIT}{box}{place}mobile = true\nmax_edge = 0.3\n{table('plane', 'size = [9, 9]')}")
    mobile = moved.mobiles[0]
    assert mobile.name == "thing" and mobile.pose == Pose((1, 2, 3), axis_angle((0, 0, 1), 30))
    turned = mobile.mesh.vertices @ rotation(mobile.pose).T + [1, 2, 3]
    both = (np.unique(np.round(vertices, 9), axis=0) for vertices in (turned, still.vertices))
    assert np.array_equal(*both)


def test_a_mobile_without_a_place_stands_on_the_floor_with_edges_of_its_own(tmp_path):
    room = table("room", "size = [4, 2, 3]").replace("thing", "room")
    path = "[shape.path]\ntimes = [0, 1]\npositions = [[0, 0, 0], [1, 0, 0]]\n"
    stool, cart = (table("cylinder", f"radius = 0.2\nheight = 0.5\nmobile = true\n{p}") for p in ("", path))
    scene = scene_of(tmp_path, LIT + room + stool + cart.replace("thing", "cart"))
    first, second = scene.mobiles
    assert first.pose.position[1] == pytest.approx(0, abs=0.01) and second.path.positions[1].tolist() == [1, 0, 0]
    p = first.mesh.vertices[first.mesh.faces]
    assert ((p - np.roll(p, 1, axis=1)) ** 2).sum(axis=2).max() <= (0.5 / 12) ** 2


def test_light_of_a_sphere_and_of_a_furnace(tmp_path):
    """E of a sphere of radiance L seen whole is pi L (r / d)^2; all walls of a furnace have pi Le / (1 - rho)."""
    lamp = f"[materials.thing]\nemission = [2, 1, 0.5]\n{table('sphere')}"
    floor = table("plane", "size = [9, 9]\nposition = [0, -2, 0]").replace("thing", "floor")
    black = "[materials.floor]\nreflectance = [0, 0, 0]\n"
    scene = scene_of(tmp_path, f"[static]\nmax_edge = 0.1\n{lamp}{black}{floor}")
    at, d = np.array([[1.5, -2.0, 0.0]]), np.hypot(2.5, 1.5)
    E, error = reference_irradiance(scene, at, np.array([[0.0, 1, 0]]), paths=200_000, seed=0)
    expected = np.pi * np.array([2, 1, 0.5]) * (0.5 / d) ** 2 * 2.5 / d
    assert (np.abs(E[0] - expected) < 4 * error[0] + 0.004 * expected).all() and (error[0] < 0.01 * expected).all()
    furnace = f"[materials.thing]\nemission = [2, 1, 0.5]\nreflectance = [0.5, 0.5, 0.5]\n{table('room')}"
    scene = scene_of(tmp_path, furnace)
    E, error = reference_irradiance(scene, np.array([[1.5, 0.0, 0.3]]), np.array([[0.0, 1, 0]]), paths=4000, seed=0)
    assert (np.abs(E[0] - 2 * np.pi * np.array([2, 1, 0.5])) < 4 * error[0] + 1e-6).all()


def test_the_edge_that_the_user_asks_for_comes_first(tmp_path):
    scene_of(tmp_path, f"[static]\nmax_edge = 0.3\n{LIT}{table('sphere')}max_edge = 0.12\n")
    for asked, longest in ((None, 0.12), (0.06, 0.06), (np.inf, 0.16)):
        mesh = load_scene(tmp_path / "a.toml", max_edge=asked).static
        p = mesh.vertices[mesh.faces]
        assert 0.7 * longest < np.sqrt(((p - np.roll(p, 1, axis=1)) ** 2).sum(axis=2).max()) <= longest
        np.testing.assert_allclose(np.sqrt(((p - [0, 0.5, 0]) ** 2).sum(axis=2)), 0.5, atol=1e-9)


def test_shapes_stand_beside_meshes(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n")
    text = f'static = {{ mesh = "a.obj", scale = 2 }}\n{LIT}{table("box", "size = [1, 1, 1]")}'
    mesh = scene_of(tmp_path, text).static
    assert face_normals(mesh)[1].sum() == pytest.approx(8)


def test_the_material_of_a_shape_is_suggested(tmp_path):
    oak, shape = "[materials.oak]\nreflectance = [0.5, 0.4, 0.3]\n", 'size = [1, 1, 1]\nmaterial = "oka"'
    with pytest.raises(SceneError, match="there is no material \"oka\"; did you mean 'oak'"):
        scene_of(tmp_path, f"{LIT}{oak}{table('box', shape)}")


def test_shapes_that_are_all_mobile_need_a_static_part(tmp_path):
    with pytest.raises(SceneError, match=r"\[static\] is missing"):
        scene_of(tmp_path, LIT + table("box") + "mobile = true")


def test_a_saved_scene_of_shapes_opens_with_the_same_bits(tmp_path):
    """In another folder; mobiles keep their poses."""
    (tmp_path / "there").mkdir()
    room = table("room", "size = [4, 2, 3]").replace("thing", "room")
    scene = scene_of(tmp_path, f"[static]\nmax_edge = 0.3\n{LIT}{room}{table('cone')}mobile = true\n")
    pose = Pose((0.5, 0.25, 0.125), axis_angle((1, 2, 3), 40))
    settings = Settings(str(tmp_path / "a.toml"))
    settings = saved_scene.with_view(settings, {"thing": pose}, Camera((0, 1, 5), (0, 0, 0)))
    saved_scene.write(tmp_path / "there" / "b.toml", settings, scene.files)
    (tmp_path / "a.toml").unlink()
    again = open_scene(saved_scene.read(str(tmp_path / "there" / "b.toml")))
    assert again.mobiles[0].pose == pose
    for a, b in ((scene.static, again.static), (scene.mobiles[0].mesh, again.mobiles[0].mesh)):
        assert all(np.array_equal(x, y) for x, y in zip(a[:4], b[:4], strict=True))


def test_edges_that_a_shape_asks_for_stay(tmp_path):
    """A room that asks for coarse edges is not refined for light; without them it is."""
    lamp = '[[light]]\ntype = "point"\nposition = [0.5, 1.2, 0.3]\nflux = [1, 1, 1]\n'
    room = '[[shape]]\ntype = "room"\nsize = [4, 3, 2.5]\n'
    asked, free = (len(scene_of(tmp_path, f"{lamp}{room}{edge}").static.faces) for edge in ("max_edge = 3\n", ""))
    assert asked < 100 < 1000 < free
