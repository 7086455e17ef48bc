"""Draw meshes after an edit: those of objects that stay are taken over, and all equal new ones.

Colours of draw vertices, compared with numpy, and their kernels. Irradiance over the picture, for the scale of false
colours: only the faces that rays hit are placed.
"""

from dataclasses import replace

import numpy as np
import pytest

from app.draw import raycast, visible
from app.draw.draw_mesh import Turning, draw_meshes, meshes_of, other_diagonals
from app.draw.shot import Shot
from app.draw.vertex_colours import colours, weights
from app.settings import Settings, open_scene
from gi_core.display import vertex_light
from gi_core.files.edits import Finish, Remove, edited
from gi_core.geometry.error import REC709
from gi_core.model import Model
from gi_core.scene import Material, Scene
from tests.support.scene_builders import merge, quad, solve
from tests.support.viewer_support import room

RED = (("reflectance", (0.7, 0.2, 0.1)),)
EDITS = {
    "a mobile's colour": (Finish("chair", RED), {0}),
    "a mobile less": (Remove("chair"), {0}),
    "a wall": (Finish("wall", RED), {1, 2, 3}),
}


@pytest.fixture(scope="module")
def office():
    model = Model(open_scene(Settings(scene="office")))
    return model, meshes_of(model)


@pytest.mark.parametrize("name", EDITS)
def test_meshes_after_an_edit_are_those_of_a_new_model(office, name):
    """office has textured paint on its static part: its means are taken over too."""
    before, meshes = office
    edit, kept = EDITS[name]
    scene = edited(before.given, [edit])
    mine, new = Model(scene, before=before), Model(scene)
    for field in ("reflectance", "emission", "corner_front", "lobe"):
        np.testing.assert_array_equal(getattr(mine.surfaces, field), getattr(new.surfaces, field))
    after, fresh = meshes_of(mine, (before, meshes)), meshes_of(new)
    assert {o for o, mesh in enumerate(after) if o < len(meshes) and mesh is meshes[o]} >= kept
    for a, b in zip(after, fresh, strict=True):
        for x, y in zip(a, b, strict=True):
            if isinstance(x, np.ndarray):
                np.testing.assert_array_equal(x, y)


def test_a_brighter_lamp_does_not_keep_its_mesh(office):
    """Emission is in the mesh, too: one lamp of the material brighter."""
    before, meshes = office
    glowing = [k for k, m in enumerate(before.given.materials) if any(m.emission)]
    materials = list(before.given.materials)
    materials[glowing[0]] = materials[glowing[0]]._replace(emission=(9.0, 9.0, 9.0))
    after = meshes_of(Model(replace(before.given, materials=tuple(materials)), before=before), (before, meshes))
    assert after[0] is not meshes[0]


MATERIALS = Material("wall", (0.5, 0.4, 0.3)), Material("leaf", (0.2, 0.3, 0.4), two_sided=True)


@pytest.fixture
def mesh():
    """A wall, and a leaf with light on both sides."""
    wall, leaf = quad((0, 0, 0), (2, 0, 0), (0, 1, 0), (6, 4)), quad((0, 0, 1), (2, 0, 0), (0, 1, 0), (5, 5))
    both = merge(wall, leaf._replace(face_material=np.ones(len(leaf.faces), np.int32)))
    return draw_meshes(Model(Scene(both, MATERIALS)).surfaces)[0]


@pytest.fixture
def irradiance(mesh):
    return np.random.default_rng(5).random((max(mesh.front.max(), mesh.back.max()) + 1, 3))


def test_weights_are_those_of_receivers(mesh, irradiance):
    of_receivers = np.random.default_rng(6).random(len(irradiance)).astype(np.float32)
    out = weights(mesh, of_receivers)
    assert np.array_equal(out[:, 0], of_receivers[mesh.front])
    assert np.array_equal(out[:, 1], np.where(mesh.back >= 0, of_receivers[mesh.back], 1.0))


def test_diagonals_are_those_of_least_difference(mesh, irradiance):
    front, back = colours(mesh, irradiance)
    of_vertices = np.ones((len(front), 2), np.float32)
    of_vertices[::7, 0] = 0.001
    (a, b, d, c), L = mesh.quads.corners, np.stack([front @ REC709, back @ REC709])
    shared, other = (np.abs(L[:, i] - L[:, j]).sum(axis=0) for i, j in ((b, c), (a, d)))
    keeps = (of_vertices[mesh.quads.corners] < 1).any(axis=(0, 2))
    assert np.array_equal(other_diagonals(mesh, front, back), other < shared)
    assert keeps.any() and np.array_equal(other_diagonals(mesh, front, back, of_vertices), (other < shared) & ~keeps)


def test_light_that_is_not_known_keeps_its_diagonals(mesh, irradiance):
    front, back = colours(mesh, np.full_like(irradiance, np.nan))
    assert np.isnan(front).all() and not other_diagonals(mesh, front, back).any()


def test_no_kernel_compiles_for_a_picture(mesh, irradiance):
    """A window compiles these kernels in its first look's process."""
    vertex_light.compile_kernels()
    kernels = [vertex_light.light_vertices, vertex_light.weigh_vertices]
    kernels += [vertex_light.follow_light, vertex_light.turn_triangles]
    before = [set(k.signatures) for k in kernels]
    front, back = colours(mesh, irradiance)
    colours(mesh, irradiance, with_reflectance=False)
    of_vertices = weights(mesh, np.ones(len(irradiance), np.float32))
    for given in (None, of_vertices):
        Turning(mesh).turn(other_diagonals(mesh, front, back, given))
    assert [set(k.signatures) for k in kernels] == before


@pytest.mark.parametrize("cull", [True, False])
def test_visible_irradiance_is_that_of_all_faces_placed(cull, monkeypatch):
    solver = solve(room(24), photons=2_000, radius=0.06)
    shot, counts, place = Shot(solver, Settings(show="illuminance")), [], visible.place
    lit = shot.lit

    def counted(meshes, at):
        counts.append(sum(len(mesh.triangles) for mesh in meshes))
        return place(meshes, at)

    monkeypatch.setattr(raycast, "place", counted)
    seen = raycast.visible_light(lit, shot.camera, 1.5, cull)
    rays = 24 * 16 * 4
    assert len(seen) <= rays and max(counts) <= rays < sum(len(mesh.triangles) for mesh in lit.meshes)

    world = place(lit.meshes, lit.at)
    monkeypatch.setattr(raycast, "_parts", lambda meshes, faces: (meshes, faces))
    monkeypatch.setattr(raycast, "place", lambda meshes, at: world)
    whole = raycast.visible_light(lit, shot.camera, 1.5, cull)
    np.testing.assert_allclose(seen, whole, rtol=1e-5)
