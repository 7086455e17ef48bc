"""The hemisphere over a glossy receiver."""

from __future__ import annotations

import numpy as np

from app.session.method_view import hemisphere_view
from gi_core.files.load import load_scene
from gi_core.gloss.sharp import is_sharp
from gi_core.solver import Solver


def test_receivers_that_a_reflection_shows_have_no_light_by_direction():
    """Their cells are even, whatever arrives."""
    solver = Solver(load_scene("showroom"), photons=4096)
    solver.solve()
    s, rows = solver.surfaces, solver.frame.gloss.rows
    corners = np.concatenate([c[is_sharp(s)].ravel() for c in (s.corner_front, s.corner_back)])
    by_probe, none = np.isin(rows, corners), (np.zeros((0, 2, 3)), np.zeros(0, np.int64))

    for reflected in (True, False):
        views = [hemisphere_view(solver, int(r), *none) for r in rows[by_probe == reflected][::200]]
        assert views and all(v.reflected is reflected for v in views)
        assert any(v.cells[:, :3].any() for v in views) is not reflected
