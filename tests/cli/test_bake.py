"""`bake`: light in the vertices of a GLB file, read back by the program's own reader and by trimesh."""

import io
import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from app import __main__ as cli
from app.commands import bake
from app.draw.baking import baked
from app.draw.shot import Shot
from app.settings import Settings, make_solver
from gi_core.bsdf.models import lobe
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.gltf_buffers import Document
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.formats.metallic_roughness import metallic_roughness
from gi_core.scene import Material, Mobile, Pose, Scene
from gi_core.scene.origin import translated
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Gloss, Mesh, Paint
from tests.cli.test_render import checkered_room
from tests.support.cli_support import FAST, one_line
from tests.support.scene_builders import complete, quad
from tests.unit.draw.test_light_map import bilinear

SETTINGS = Settings(photons=4000, radius=0.06, size=(192, 144), light="photons", tone_map="clip", exposure=1.0)
TURN = axis_angle((0.3, 1.0, 0.2), 40.0)


def two_sided_room() -> Scene:
    """The room with textures, and a leaf lit from both sides, turned and moved."""
    room = checkered_room()
    leaf = quad((-0.1, -0.1, 0), (0.2, 0, 0), (0, 0.2, 0), (3, 3), material=len(room.materials))
    material = Material("leaf", (0.3, 0.5, 0.2), two_sided=True)
    mobiles = (*room.mobiles, Mobile("leaf", leaf, Pose((0.2, 0.7, 0.4), TURN)))
    return replace(room, materials=(*room.materials, material), mobiles=mobiles)


def solved(scene: Scene, settings: Settings = SETTINGS) -> Shot:
    solver = complete(make_solver(scene, settings))
    return Shot(solver, settings)


def glb_of(shot: Shot, exposure: float | None = None) -> bytes:
    return baked(shot, exposure).glb


def described(glb: bytes) -> dict:
    return json.loads(glb[20 : 20 + struct.unpack_from("<I", glb, 12)[0]])


@pytest.fixture(scope="module")
def shot() -> Shot:
    return solved(two_sided_room())


def sorted_rows(rows: np.ndarray) -> np.ndarray:
    return rows[np.lexsort(rows.T[::-1])]


def expected_triangles(shot: Shot, o: int) -> np.ndarray:
    """Return position and irradiance of the corners of each lit side of object o, (n, 18) float32."""
    s, E = shot.solver.surfaces, shot.solver.irradiance
    of = s.face_range(o)
    sides = []
    for receivers, way in ((s.corner_front[of], [0, 1, 2]), (s.corner_back[of], [2, 1, 0])):
        lit = receivers[:, 0] >= 0
        corners = np.concatenate([s.vertices[o][s.faces[o][lit]], E[receivers[lit]]], axis=2)
        sides.append(corners[:, way].reshape(-1, 18))
    return np.concatenate(sides).astype(np.float32)


def test_irradiance_is_the_solvers_bit_for_bit(shot, tmp_path):
    """By the program's reader: every side of every face, static and mobile, with its own light."""
    glb = glb_of(shot)
    file = Document(tmp_path / "a.glb", glb, "a.glb", Boundary(tmp_path))
    for o, name in enumerate(["static", *shot.solver.model.names]):
        node = next(n for n in file.json["nodes"] if n.get("name") == name)
        found = []
        for p in file.json["meshes"][node["mesh"]]["primitives"]:
            order = file.accessor(p["indices"]).reshape(-1, 3)
            values = [file.accessor(p["attributes"][a])[order] for a in ("POSITION", "_IRRADIANCE")]
            found.append(np.concatenate(values, axis=2).reshape(-1, 18))
        rows = sorted_rows(np.concatenate(found).astype(np.float32))
        np.testing.assert_array_equal(rows, sorted_rows(expected_triangles(shot, o)))


def test_trimesh_reads_the_light_and_the_poses(shot):
    read = trimesh.load(io.BytesIO(glb_of(shot)), file_type="glb")
    given = [m.vertex_attributes["_IRRADIANCE"] for m in read.geometry.values()]
    known = {row.tobytes() for row in shot.solver.irradiance.astype(np.float32)}
    rows = np.concatenate(given)
    assert rows.dtype == np.float32 and {row.tobytes() for row in rows} <= known and len(rows) > 600
    placed = trimesh.transform_points(read.geometry[read.graph["leaf"][1] or "leaf"].vertices, read.graph["leaf"][0])
    own = shot.solver.model.vertices_at(2, shot.solver.poses)
    np.testing.assert_allclose(np.unique(placed.round(5), axis=0), np.unique(own.round(5), axis=0), atol=2e-5)


def test_colours_are_light_at_the_highest_exposure_that_fits(shot, tmp_path):
    """Material and texture times COLOR_0 is radiance; lamps alone are cut off at 1, as glTF requires."""
    glb = glb_of(shot)
    file = Document(tmp_path / "a.glb", glb, "a.glb", Boundary(tmp_path))
    exposure = file.json["scenes"][0]["extras"]["exposure"]
    most = 0.0
    for node in (n for n in file.json["nodes"] if "mesh" in n):
        for p in file.json["meshes"][node["mesh"]]["primitives"]:
            assert file.json["accessors"][p["attributes"]["COLOR_0"]]["componentType"] == 5126
            colour, E = (file.accessor(p["attributes"][a]) for a in ("COLOR_0", "_IRRADIANCE"))
            material = file.json["materials"][p["material"]]
            assert colour.min() >= 0 and colour.max() <= 1 and "KHR_materials_unlit" in material["extensions"]
            if material["name"] == "lamp":
                assert colour.min() == 1.0
                continue
            most = max(most, colour.max())
            if material["name"] == "leaf":
                assert material["pbrMetallicRoughness"]["baseColorFactor"] == [0.3, 0.5, 0.2, 1.0]
                np.testing.assert_allclose(colour, E / np.pi * 2.0**exposure * shot.gains, rtol=1e-6)
    assert most == pytest.approx(1.0, abs=1e-6)
    cut = described(glb_of(shot, exposure + 3))
    assert cut["scenes"][0]["extras"]["exposure"] == exposure + 3


def test_textures_and_materials_stay(shot):
    document = described(glb_of(shot))
    textured = [m for m in document["materials"] if "baseColorTexture" in m["pbrMetallicRoughness"]]
    assert {m["name"] for m in document["materials"]} == {"white", "red", "green", "lamp", "leaf"}
    assert {m["name"] for m in textured} == {"white", "red", "green"} and len(document["images"]) == 2
    wraps = {(s["wrapS"], s["wrapT"]) for s in document["samplers"]}
    assert wraps == {(10497, 10497), (33648, 33071)}


def test_plain_materials_beside_a_texture_keep_their_base_colours(tmp_path):
    """One texture in a mesh put the base colours of all its materials into COLOR_0."""
    room, plain = checkered_room(), Material("plain", (0.6, 0.1, 0.08))
    static, more = room.static, quad((0.2, 0.1, 0.2), (0.2, 0, 0), (0, 0, 0.2), (2, 2), material=len(room.materials))
    add, paint = len(more.faces), static.paint
    assert static.face_reflectance is None and (paint.face_texture >= 0).any()
    colour = np.broadcast_to(np.float32(plain.reflectance), (add, 3, 3))
    longer = Paint(
        paint.textures,
        np.concatenate([paint.face_texture, np.full(add, -1, np.int32)]),
        np.concatenate([paint.corner_uv, np.zeros((add, 3, 2), np.float32)]),
        np.concatenate([paint.corner_colour, colour]),
    )
    mesh = Mesh(
        np.concatenate([static.vertices, more.vertices]),
        np.concatenate([static.faces, more.faces + len(static.vertices)]),
        np.concatenate([static.face_material, more.face_material]),
        paint=longer,
    )
    shot = solved(replace(room, materials=(*room.materials, plain), static=mesh))
    glb = glb_of(shot, 0.0)
    file = Document(tmp_path / "a.glb", glb, "a.glb", Boundary(tmp_path))
    (k,) = (k for k, m in enumerate(file.json["materials"]) if m["name"] == "plain")
    factor = file.json["materials"][k]["pbrMetallicRoughness"]["baseColorFactor"]
    assert factor == pytest.approx([*plain.reflectance, 1.0])
    (part,) = (p for m in file.json["meshes"] for p in m["primitives"] if p["material"] == k)
    E, light = (file.accessor(part["attributes"][a]) for a in ("_IRRADIANCE", "COLOR_0"))
    assert E.any()
    np.testing.assert_allclose(light, np.clip(E / np.pi * shot.gains, 0, 1), rtol=1e-5)


def test_glossy_materials_keep_their_factors(tmp_path):
    """Base colour times COLOR_0 is the diffuse radiance; base colour, metallic and roughness are those given."""
    room = checkered_room()
    plastic = metallic_roughness(Material("plastic", (0.8, 0.4, 0.2)), 0.25, 0.3)
    gold = metallic_roughness(Material("gold", (0.9, 0.6, 0.2)), 1.0, 0.4)
    brushed = Material("brushed", brdf=(lobe("ward", {"ks": 0.5, "ax": 0.1, "ay": 0.4}),))
    leaves = [
        quad((-0.1, -0.1, 0.1 * k), (0.2, 0, 0), (0, 0.2, 0), (1, 1), material=len(room.materials) + k)
        for k in range(3)
    ]
    mobiles = tuple(Mobile(f"leaf {k}", leaf, Pose((0.3, 0.5, 0.4))) for k, leaf in enumerate(leaves))
    scene = replace(room, materials=(*room.materials, plastic, gold, brushed), mobiles=mobiles)
    shot = solved(scene)
    glb = glb_of(shot, 0.0)
    file = Document(tmp_path / "a.glb", glb, "a.glb", Boundary(tmp_path))
    found = {m["name"]: m for m in file.json["materials"]}
    for name, base, metallic, roughness in (("plastic", [0.8, 0.4, 0.2], 0.25, 0.3), ("gold", [0.9, 0.6, 0.2], 1, 0.4)):
        pbr = found[name]["pbrMetallicRoughness"]
        assert pbr["baseColorFactor"] == pytest.approx([*base, 1.0])
        assert (pbr["metallicFactor"], pbr["roughnessFactor"]) == pytest.approx((metallic, roughness))
    assert found["gold"]["extras"]["gloss"]["alpha"] == pytest.approx(0.16)
    assert found["brushed"]["extras"]["brdf"][0]["ax"] == 0.1
    for p in (p for mesh in file.json["meshes"] for p in mesh["primitives"]):
        described_by = file.json["materials"][p["material"]]
        if described_by["name"] in ("plastic", "gold"):
            colour, E = (file.accessor(p["attributes"][a]) for a in ("COLOR_0", "_IRRADIANCE"))
            base = np.array(described_by["pbrMetallicRoughness"]["baseColorFactor"][:3])
            rho = np.array(described_by["extras"]["reflectance"])
            np.testing.assert_allclose(base * colour, rho * E / np.pi * shot.gains, rtol=1e-5, atol=1e-7)
            assert E.min() > 0
    (tmp_path / "a.glb").write_bytes(glb)
    assert all(m.gloss is None for m in read_mesh_file(tmp_path / "a.glb").materials)  # unlit


def test_the_command_names_gloss_that_is_left_out():
    materials = Material("wall"), Material("gold", gloss=Gloss()), Material("velvet", brdf=(lobe("oren_nayar", {}),))
    assert bake._left_out(Scene(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1)), materials[:1])) == ""
    note = bake._left_out(Scene(quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1)), materials))
    assert '"gold", "velvet"' in note and "wall" not in note


def test_the_file_looks_like_the_picture(shot, tmp_path):
    """Opened as a scene, its reflectances are the light: drawn in even light, the picture is that of `render`.

    The reader limits reflectance to 0.98; the leaf counts by its front alone, since its two sides coincide.
    """
    one_sided = replace(shot.solver.scene, mobiles=shot.solver.scene.mobiles[:1])
    ours = solved(one_sided)
    (tmp_path / "a.glb").write_bytes(glb := glb_of(ours))
    notes = described(glb)["scenes"][0]["extras"]
    file = read_mesh_file(tmp_path / "a.glb")
    read = Scene(file.mesh, tuple(file.materials), camera=file.camera)
    again = replace(SETTINGS, exposure=notes["picture_exposure"] - notes["exposure"], white_balance=False)
    theirs = Shot(make_solver(read, again), again)
    even = np.full(theirs.solver.irradiance.shape, np.pi)
    theirs.solver.frame = theirs.solver.frame._replace(irradiance=even)
    a, b = (s.take().astype(float) for s in (ours, theirs))
    apart = np.abs(a - b).mean() / a.mean()
    assert apart < 0.03 and a.std() > 20, f"{apart:.2%}"


@pytest.mark.parametrize("up, carried", [((0, 0, 1), (0, 2, 1)), ((1, 0, 0), None), ((0, -1, 0), None)])
def test_up_becomes_the_files_up(up, carried, tmp_path):
    """A z-up scene is turned as Blender's exporter turns it: x, z, -y."""
    floor = replace(checkered_room(), static=quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 2)), mobiles=(), up=up)
    (tmp_path / "a.glb").write_bytes(glb_of(solved(floor)))
    p = read_mesh_file(tmp_path / "a.glb").mesh.vertices
    before = floor.static.vertices
    if carried:
        np.testing.assert_allclose(
            sorted_rows(p.round(6) + 0.0), sorted_rows(before[:, carried] * [1, 1, -1] + 0.0), atol=1e-6
        )
    np.testing.assert_allclose(sorted(p[:, 1]), sorted(before @ np.array(up, float)), atol=1e-6)


def test_a_scene_far_from_the_origin_keeps_its_details(tmp_path):
    """1,000 km away float32 resolves 6 cm; nodes carry the distance."""
    far = np.array([1e6, 0.0, 2e6])
    shot = solved(translated(replace(checkered_room(), mobiles=()), far))
    document = described(glb := glb_of(shot))
    file = Document(tmp_path / "a.glb", glb, "a.glb", Boundary(tmp_path))
    p = file.accessor(document["meshes"][0]["primitives"][0]["attributes"]["POSITION"])
    moved = np.array(document["nodes"][0]["translation"])
    np.testing.assert_allclose((p + moved).min(axis=0), far, atol=1e-6)


def test_the_command_writes_a_file_and_refuses_others(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["bake", *FAST, "--pose", "pawn=0.3,0.05,0.2", "--seconds", "0", "--out"]
    assert cli.main([*command, "a.glb"]) == 0
    assert capsys.readouterr().out == f"{(tmp_path / 'a.glb').resolve()}\n"
    again = (tmp_path / "a.glb").read_bytes()
    assert cli.main([*command, "a.glb"]) == 0 and (tmp_path / "a.glb").read_bytes() == again
    document = described(again)
    pawn = next(n for n in document["nodes"] if n["name"] == "pawn")
    assert pawn["translation"] == [0.3, 0.05, 0.2] and sorted(p.name for p in tmp_path.iterdir()) == ["a.glb"]
    assert cli.main([*command, "a.glb", "--exposure", "-1.5"]) == 0
    notes, before = (described(f)["scenes"][0]["extras"] for f in ((tmp_path / "a.glb").read_bytes(), again))
    assert notes["exposure"] == -1.5 and notes["picture_exposure"] == before["picture_exposure"]
    capsys.readouterr()
    assert cli.main([*command, "a.obj"]) == 2
    assert one_line(capsys.readouterr().err) == "gi-viewer: --out must name a .glb file, got a.obj\n"


def test_a_light_map_has_the_light_of_the_vertices(tmp_path, capsys, monkeypatch):
    """The image beside the file, read at the second UV set, against _IRRADIANCE: at every vertex of every side."""
    import OpenEXR

    monkeypatch.chdir(tmp_path)
    assert cli.main(["bake", *FAST, "--seconds", "0", "--light-map", "512", "--out", "a.glb"]) == 0
    assert capsys.readouterr().out.split() == [str((tmp_path / name).resolve()) for name in ("a.glb", "a.exr")]
    file = Document(tmp_path / "a.glb", (tmp_path / "a.glb").read_bytes(), "a.glb", Boundary(tmp_path))
    assert file.json["scenes"][0]["extras"]["light_map"] == {"file": "a.exr", "texCoord": 1}
    with OpenEXR.File("a.exr", separate_channels=True) as image:
        channels = {name: c.pixels for name, c in image.channels().items()}
        assert image.header()["gi-viewer content"] == "irradiance [W/m²]"
    light = np.stack([channels[c] for c in "RGB"], axis=2)
    assert light.dtype == np.float32 and 0.2 < channels["A"].mean() <= 1 and 400 < max(light.shape) < 700
    found, expected = [], []
    for mesh in file.json["meshes"]:
        for p in mesh["primitives"]:
            uv, E = (file.accessor(p["attributes"][name]) for name in ("TEXCOORD_1", "_IRRADIANCE"))
            corners = file.accessor(p["indices"]).reshape(-1, 3)
            found.append(bilinear(light, uv[corners].astype(float).mean(axis=1)))
            expected.append(E[corners].mean(axis=1))
    found, expected = np.concatenate(found), np.concatenate(expected)
    lit = expected.min(axis=1) > 0.1 * expected.mean()
    off = np.abs(found - expected)[lit] / expected[lit]
    assert lit.sum() > 5000 and np.median(off) < 0.01 and np.abs(found - expected)[lit].sum() < 0.03 * expected.sum()
