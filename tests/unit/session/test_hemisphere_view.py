"""The hemisphere over a glossy receiver."""

from __future__ import annotations

import numpy as np

from app.session.hemisphere_view import hemisphere_view
from gi_core.files.load import load_scene
from gi_core.gloss.sharp import in_probes
from gi_core.solver import Solver


def test_receivers_that_a_reflection_shows_have_no_light_by_direction():
    """Their cells are even, whatever arrives."""
    solver = Solver(load_scene("showroom"), photons=4096)
    solver.solve()
    s, rows = solver.surfaces, solver.frame.gloss.rows
    corners = np.concatenate([c[in_probes(s)].ravel() for c in (s.corner_front, s.corner_back)])
    by_probe, none = np.isin(rows, corners), (np.zeros((0, 2, 3)), np.zeros(0, np.int64))

    def light(some: np.ndarray) -> list[float]:
        return [float(hemisphere_view(solver, int(r), *none).cells[:, :3].sum()) for r in some[::200]]

    assert by_probe.any() and not any(light(rows[by_probe])) and max(light(rows[~by_probe])) > 0
