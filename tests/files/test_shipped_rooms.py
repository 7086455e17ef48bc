"""living_room, gallery, office and second_tree agree with their comments: light, paths of mobiles, images."""

import json
from importlib import resources

import numpy as np
import pytest

from app.rest.surface_grid import level_of
from gi_core.files.load import load_scene
from gi_core.geometry.error import luminance
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import mean_colours
from gi_core.gloss.reflectors import ways
from gi_core.model import Model
from gi_core.photons.trace import trace_background
from gi_core.scene.pose import pose_at, to_world
from gi_core.scene.types import PhotometricLight, PointLight
from scenes import make_classroom, make_gallery, make_living_room, make_office, make_second_tree, make_showroom
from scenes import office_furniture as furniture
from tests.support.photometry import table_flux

FLUX = {
    "living_room": {
        "glass": make_living_room.WINDOW_FLUX,
        "diffuser": make_living_room.DIFFUSER_FLUX,
        "shade": make_living_room.SHADE_FLUX,
        "ball": make_living_room.BALL_FLUX,
    },
    "gallery": {
        "ceiling light": make_gallery.CEILING_FLUX,
        "ring": make_gallery.RING_FLUX,
        "bulb": make_gallery.BULB_FLUX,
    },
    "office": make_office.lamp_flux(),
    "second_tree": {"sky": make_second_tree.SKY_FLUX, "lamp": make_second_tree.LAMP_FLUX},
    "showroom": {"strips": make_showroom.STRIP_FLUX, "slots": make_showroom.SLOT_FLUX},
}


@pytest.fixture(scope="module", params=FLUX)
def shipped(request):
    return request.param, load_scene(request.param)


def test_luminous_faces_emit_the_stated_flux(shipped):
    """pi L A of each material, and no other material emits. Radiance is rounded to 1e-4."""
    name, scene = shipped
    _, areas = face_normals(scene.static)
    assert {m.name for m in scene.materials if any(m.emission)} == set(FLUX[name])
    for i, m in enumerate(scene.materials):
        if any(m.emission):
            area = areas[scene.static.face_material == i].sum()
            np.testing.assert_allclose(np.pi * np.array(m.emission) * area, FLUX[name][m.name], rtol=2e-3)


def test_no_photon_leaves(shipped):
    """Rooms are closed, the sky stands on the meadow: any gap, any lamp outside, would show as escaped flux."""
    _, scene = shipped
    m = Model(scene)
    _, fates = trace_background(m.accelerator, m.world, m.static, m.emitters, 3, 0, 20_000)
    assert fates.emitted.sum() > 0 and fates.escaped.sum() == 0 and fates.truncated.sum() == 0


def test_walls_of_the_rooms_face_inwards():
    """Seen from the camera, the wall in front of it shows its back; from within it shows its front."""
    for name in ("living_room", "gallery"):
        scene = load_scene(name)
        normals, _ = face_normals(scene.static)
        middle = scene.static.vertices[scene.static.faces].mean(axis=1)
        front = middle[:, 2] > middle[:, 2].max() - 1e-6
        assert front.any() and (normals[front][:, 2] < -0.999).all()
        assert scene.camera.position[2] > middle[:, 2].max() + 1


GALLERY = ("gallery.glb", "stone.glb")
OFFICE = ("office.glb", "office_chair.glb", "office_screen.glb", "office_cabinet.glb")


def test_images_are_small_and_used():
    for name in ("living_room.glb", "cat.glb", "living_chair.glb", *GALLERY, *OFFICE):
        data = (resources.files("scenes") / name).read_bytes()
        assert len(data) < 1.5e6
        said = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
        textured = {
            i for i, m in enumerate(said["materials"]) if "baseColorTexture" in m["pbrMetallicRoughness"]
        }  # fmt: skip
        assert len(textured) == len(said["images"]) > 0
        primitives = said["meshes"][0]["primitives"]
        assert all("TEXCOORD_0" in p["attributes"] for p in primitives)
        assert textured <= {p["material"] for p in primitives}


def test_textures_drive_transport():
    """The rug is red, cream and blue by turns; the cat's belly is paler than its back."""
    scene = load_scene("living_room")
    names = [m.name for m in scene.materials]
    rug = mean_colours(scene.static.paint)[scene.static.face_material == names.index("rug")]
    assert len(rug) > 200 and np.ptp(rug[:, 2]) > 0.15
    cat = scene.mobiles[1].mesh
    y = cat.vertices[cat.faces].mean(axis=1)[:, 1]
    rho = mean_colours(cat.paint)
    belly, back = rho[y < 0.12].mean(axis=0), rho[(y > 0.22) & (y < 0.3)].mean(axis=0)
    assert (belly > 1.3 * back).all() and back[0] > 2 * back[2]


def test_cat_faces_its_path_and_touches_nothing():
    scene = load_scene("living_room")
    cat = scene.mobiles[1]
    assert cat.mesh.vertices[:, 1].min() == pytest.approx(0, abs=1e-6)
    size = cat.mesh.vertices.max(axis=0) - cat.mesh.vertices.min(axis=0)
    assert 0.35 < size[2] < 0.7 and size[1] < 0.6  # a cat
    x0, z0 = make_living_room.TABLE
    times = np.linspace(0, cat.path.times[-1], 73)
    for t in times[:-1]:
        pose = pose_at(cat.path, t)
        ahead = np.array(pose_at(cat.path, t + 0.01).position) - pose.position
        facing = to_world(pose, np.array([[0, 0, 1.0]]))[0] - pose.position
        assert facing @ ahead / np.sqrt(ahead @ ahead) > 0.97
        v = to_world(pose, cat.mesh.vertices)
        assert v[:, 1].min() == pytest.approx(make_living_room.RUG_THICKNESS, abs=1e-6)
        assert np.hypot(v[:, 0] - x0, v[:, 2] - z0).min() > 0.44  # the table's radius
        assert v[:, 2].min() > -1.24  # the front of the sofa
        assert v[:, 0].max() < 0.9  # the chair's legs where it stands first


def test_chair_stands_on_the_floor_and_keeps_off_the_walls():
    scene = load_scene("living_room")
    chair = scene.mobiles[0]
    assert chair.mesh.vertices[:, 1].min() == pytest.approx(0, abs=2e-3)
    assert 0.8 < chair.mesh.vertices[:, 1].max() < 0.9
    for t in np.linspace(0, chair.path.times[-1], 41):
        v = to_world(pose_at(chair.path, t), chair.mesh.vertices)
        assert v[:, 0].max() < make_living_room.RIGHT - 0.02 and v[:, 2].min() > -1.8


def test_living_room_has_an_uplight_in_its_floor_lamp():
    scene = load_scene("living_room")
    (uplight,) = scene.lights
    names = [m.name for m in scene.materials]
    disc = scene.static.vertices[scene.static.faces[scene.static.face_material == names.index("diffuser")]].reshape(
        -1, 3
    )
    top = disc[disc[:, 1] > disc[:, 1].max() - 1e-6]
    middle = (top.min(axis=0) + top.max(axis=0)) / 2
    assert isinstance(uplight, PhotometricLight) and uplight.direction == (0, 1, 0)
    np.testing.assert_allclose(uplight.position, middle + [0, 0.005, 0], atol=2e-3)
    assert np.hypot(*uplight.size) / 2 < (top[:, 0].max() - top[:, 0].min()) / 2 + 1e-3


def test_gallery_has_luminaires_of_every_kind_where_their_bodies_are():
    scene = load_scene("gallery")
    spots = [light for light in scene.lights if isinstance(light, PhotometricLight)]
    points = [light for light in scene.lights if isinstance(light, PointLight)]
    assert len(spots) == 3 and len(points) == 1 and len(scene.lights) == 4
    np.testing.assert_allclose([s.position for s in spots], make_gallery.SPOTS)
    np.testing.assert_allclose(points[0].position, make_gallery.BULB)
    for spot, (x, *_) in zip(spots, make_gallery.PICTURES, strict=True):
        reach = (make_gallery.BACK - spot.position[2]) / spot.direction[2]
        aim = np.array(spot.position) + reach * np.array(spot.direction)
        np.testing.assert_allclose(aim, [x, make_gallery.PICTURE_HEIGHT, make_gallery.BACK], atol=1e-6)


def test_stone_stays_in_the_hall_and_touches_nothing():
    scene = load_scene("gallery")
    names = [m.name for m in scene.materials]
    oak = scene.static.vertices[scene.static.faces[scene.static.face_material == names.index("oak")]].reshape(-1, 3)
    end, front = oak[:, 0].max(), oak[:, 2].min()  # of the bench
    (stone,) = scene.mobiles
    assert stone.mesh.vertices[:, 1].min() == pytest.approx(0, abs=1e-6)
    for t in np.linspace(0, stone.path.times[-1], 60):
        v = to_world(pose_at(stone.path, t), stone.mesh.vertices)
        assert v[:, 0].max() < make_gallery.RIGHT - 0.3 and v[:, 2].min() > make_gallery.BACK + 0.6
        assert (v[v[:, 2] > front][:, 0] > end).all()
        assert np.hypot(v[:, 0] - 3.35, v[:, 2] + 2.35).min() > 0.4  # the plinth on the right


@pytest.fixture(scope="module")
def office():
    return load_scene("office")


def test_office_has_twelve_lamps_by_name(office):
    """Nine materials and three luminaires, each at the mouth of its lamp and of the name of its diffuser."""
    assert office.units == "photometric"
    glowing = {m.name for m in office.materials if any(m.emission)}
    spots = {light.name: light for light in office.lights}
    assert len(glowing | set(spots)) == 12 and set(spots) <= glowing
    names = [m.name for m in office.materials]
    for (name, spot), mouth in zip(spots.items(), make_office.mouths(), strict=True):
        peak = luminance(spot.flux) * spot.intensity.max() / table_flux(spot)
        assert isinstance(spot, PhotometricLight) and peak == pytest.approx(make_office.DESK_LAMP_PEAK, abs=0.2)
        assert luminance(spot.flux) == pytest.approx(table_flux(spot), rel=1e-3)
        np.testing.assert_allclose(spot.position, mouth, atol=1e-9)
        disc = office.static.vertices[office.static.faces[office.static.face_material == names.index(name)]]
        np.testing.assert_allclose(disc.reshape(-1, 3).mean(axis=0), mouth + [0, 0.002, 0], atol=0.003)
    for name, lumens in (("panel door back", 5500), ("pendant", 3000), ("wall washer", 2500), ("window sky", 12_000)):
        assert luminance(make_office.lamp_flux()[name]) == pytest.approx(lumens)


def test_office_probes_lie_on_desks(office):
    """One centimetre above a top."""
    assert len(office.probes) == 7
    oak = office.static.face_material == [m.name for m in office.materials].index("oak")
    p = office.static.vertices[office.static.faces[oak]]
    for probe in office.probes:
        x, y, z = probe.position
        low, high = p.min(axis=1), p.max(axis=1)
        below = (low[:, 0] <= x) & (x <= high[:, 0]) & (low[:, 2] <= z) & (z <= high[:, 2]) & (high[:, 1] > 0.7)
        assert p[below][:, :, 1].max() == pytest.approx(furniture.TOP) and y == furniture.TOP + 0.01


def test_office_mobiles_rest_on_the_floor_and_the_chair_touches_nothing(office):
    screen, cabinet, chair = office.mobiles
    assert [m.name for m in office.mobiles] == ["screen", "cabinet", "chair"]
    static = office.static.vertices
    for mobile in office.mobiles:
        v = mobile.mesh.vertices
        assert v[:, 1].min() == pytest.approx(0, abs=1e-5) and mobile.pose.position[1] == 0
        axes = to_world(mobile.pose, np.eye(3)) - mobile.pose.position
        local = (static - mobile.pose.position) @ axes.T
        assert not ((local > v.min(axis=0)) & (local < v.max(axis=0))).all(axis=1).any(), mobile.name
    solid = static[(static[:, 1] > 0.02) & (static[:, 1] < 1.1)]
    others = np.concatenate([to_world(m.pose, m.mesh.vertices) for m in (screen, cabinet)])
    obstacles = np.concatenate([solid, others])[:, [0, 2]]
    for t in np.linspace(0, chair.path.times[-1], 40):
        x, _, z = pose_at(chair.path, t).position
        assert np.hypot(*(obstacles - [x, z]).T).min() > np.hypot(*chair.mesh.vertices[:, [0, 2]].T).max()


def test_office_is_light_enough_for_a_drag(office):
    assert len(Model(office).object_receivers.areas) <= 39_000


@pytest.fixture(scope="module")
def classroom():
    return load_scene("classroom")


def test_classroom_has_its_luminaires_below_their_housings(classroom):
    """Eight in two rows and a washer, each with the opening and the watts of its file; sun and sky by day."""
    lights = [light for light in classroom.lights if isinstance(light, PhotometricLight)]
    places = [
        (x, make_classroom.LUMINAIRE_Y, z) for z in make_classroom.LUMINAIRE_Z for x in make_classroom.LUMINAIRE_X
    ]
    np.testing.assert_allclose([light.position for light in lights], [*places, make_classroom.WASHER_AT])
    assert {light.size for light in lights[:-1]} == {make_classroom.LUMINAIRE}
    assert lights[-1].size == make_classroom.WASHER and lights[-1].watts == make_classroom.WASHER_WATTS
    assert {light.watts for light in lights[:-1]} == {make_classroom.WATTS}
    for light in lights:
        assert luminance(light.flux) == pytest.approx(table_flux(light), rel=1e-3)
    assert [light.name for light in classroom.lights][-2:] == ["sun", "sky"]


def test_classroom_washer_is_aimed_at_the_board(classroom):
    washer = next(light for light in classroom.lights if light.name == "board washer")
    reach = (make_classroom.LEFT - washer.position[0]) / washer.direction[0]
    aim = np.array(washer.position) + reach * np.array(washer.direction)
    _, high, low = make_classroom.BOARD
    assert low < aim[1] < low + high and aim[2] == 0


def test_classroom_mobiles_touch_nothing(classroom):
    """The cupboard stands on the floor; blinds hang before the windows' reveals."""
    static = classroom.static.vertices
    for mobile in classroom.mobiles:
        v = mobile.mesh.vertices
        local = static - mobile.pose.position
        assert not ((local > v.min(axis=0)) & (local < v.max(axis=0))).all(axis=1).any(), mobile.name
    cupboard, *blinds = classroom.mobiles
    assert cupboard.mesh.vertices[:, 1].min() == pytest.approx(0, abs=1e-5) and cupboard.pose.position[1] == 0
    for blind in blinds:
        z = blind.mesh.vertices[:, 2] + blind.pose.position[2]
        assert z.max() < make_classroom.FRONT and np.ptp(blind.mesh.vertices[:, 0]) > make_classroom.WIDE


def test_classroom_floor_is_the_floor_of_its_surfaces(classroom):
    """The terrace outside is no floor, and panes let daylight in."""
    level = level_of(Model(classroom))
    assert level.low[2] == pytest.approx(0, abs=1e-6) and level.area == pytest.approx(63, rel=0.002)
    assert next(m for m in classroom.materials if m.name == "glass").pane is not None
    assert [s.name for s in classroom.surfaces] == ["tables", "board", "glare"]


def test_second_tree_has_a_tenth_of_the_triangles():
    """Section 2.7: another sort of tree, another ground, bigger triangles; discs of 0.03 as in table 2.4."""
    scene, first = load_scene("second_tree"), load_scene("tree")
    assert 0.05 < len(scene.static.faces) / len(first.static.faces) < 0.12
    assert scene.defaults.radius == 0.03 and scene.defaults.scene_size == 1.0
    names = [m.name for m in scene.materials]
    p = scene.static.vertices[scene.static.faces]
    edge = np.sqrt(((p - np.roll(p, 1, axis=1)) ** 2).sum(axis=2)).max(axis=1)
    for name in ("needles", "meadow"):
        assert 0.03 < np.median(edge[scene.static.face_material == names.index(name)]) < 0.12
    (bauble,) = scene.mobiles
    assert 300 < len(bauble.mesh.faces) < 700
    for t in np.linspace(0, bauble.path.times[-1], 60):
        x, y, z = (to_world(pose_at(bauble.path, t), bauble.mesh.vertices)).T
        assert (y > make_second_tree.height(np.hypot(x, z))).all()  # above the hill


def test_showroom_shows_each_kind_of_gloss_in_its_way():
    """Lobes that cells carry, planes and probes; the vase is a Ward lacquer, the pebble polished metal."""
    scene = load_scene("showroom")
    worn = np.concatenate([m.face_material for m in (scene.static, *(m.mesh for m in scene.mobiles))])
    noise, way, _ = ways(Model(scene))
    named = {m.name: worn == k for k, m in enumerate(scene.materials)}
    expected = {"floor": {"cells"}, "velvet": {"cells"}, "mirror": {"planar"}, "piano": {"planar"}}
    expected |= dict.fromkeys(("lacquer", "glass", "teal", "gold"), {"probe"})
    expected["steel"] = {"planar", "probe"}  # the pedestal's top and its curved side
    assert {name: set(way[named[name]]) for name in expected} == expected
    assert np.isnan(noise[named["clay"]]).all()
    assert [m.name for m in scene.mobiles] == ["vase", "bean"]
    # The vase passes between turntable and camera; the pebble stands on its pedestal.
    vase, bean = scene.mobiles
    reach = np.hypot(*(vase.path.positions[:, [0, 2]] - np.array(make_showroom.TABLE)).T)
    assert reach.min() > make_showroom.TABLE_RADIUS + 0.25
    np.testing.assert_allclose(bean.pose.position, (make_showroom.PEDESTAL[0], 0.8, make_showroom.PEDESTAL[1]))
