"""Draw meshes after an edit: those of objects that stay are taken over, and all equal new ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.draw.draw_mesh import meshes_of
from app.settings import Settings, open_scene
from gi_core.files.edits import Finish, Remove, edited
from gi_core.model import Model

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
