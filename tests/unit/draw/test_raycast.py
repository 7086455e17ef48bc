"""Irradiance over the picture, for the scale of false colours: only the faces that rays hit are placed."""

from __future__ import annotations

import numpy as np
import pytest

from app.draw import raycast, visible
from app.draw.shot import Shot
from app.settings import Settings
from gi_core.solver import Solver
from tests.support.viewer_support import room


@pytest.mark.parametrize("cull", [True, False])
def test_visible_irradiance_is_that_of_all_faces_placed(cull, monkeypatch):
    solver = Solver(room(24), photons=2_000, radius=0.06)
    solver.solve()
    shot, model, drawn = Shot(solver, Settings(show="illuminance")), solver.model, solver.drawn(solver.irradiance)
    at, counts, place = model.transforms(solver.poses), [], visible.place

    def counted(meshes, at):
        counts.append(sum(len(mesh.triangles) for mesh in meshes))
        return place(meshes, at)

    monkeypatch.setattr(raycast, "place", counted)
    seen = raycast.visible_light(model.accelerator, at, shot.meshes, drawn, shot.camera, 1.5, cull)
    rays = 24 * 16 * 4
    assert len(seen) <= rays and max(counts) <= rays < sum(len(mesh.triangles) for mesh in shot.meshes)

    world = place(shot.meshes, at)
    monkeypatch.setattr(raycast, "_parts", lambda meshes, faces: (meshes, faces))
    monkeypatch.setattr(raycast, "place", lambda meshes, at: world)
    whole = raycast.visible_light(model.accelerator, at, shot.meshes, drawn, shot.camera, 1.5, cull)
    np.testing.assert_allclose(seen, whole, rtol=1e-5)
