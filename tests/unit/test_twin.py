"""A twin of a solver: shared photons, separate settings and poses."""

from __future__ import annotations

import numpy as np

from gi_core.solver import Solver
from tests.support import viewer_support as support


def test_twin_shares_photons_but_not_settings():
    """Settings and poses are separate; both equal a solver without a twin, bit for bit."""
    solver = Solver(support.room(), photons=8192, radius=0.06)
    solver.solve()
    before, pose = solver.irradiance, solver.poses["block"]
    twin = solver.twin()
    twin.configure(estimator="photon_map", neighbours=20)
    twin.solve()
    twin.move("block", pose._replace(position=(0.6, 0.3, 0.5)))
    assert np.array_equal(twin.irradiance, twin.from_scratch())
    assert solver.setting.estimator == "tangent_plane" and solver.poses["block"] == pose and solver.irradiance is before
    alone = Solver(support.room(), "photon_map", photons=8192, radius=0.06, neighbours=20)
    alone.solve()
    twin.move("block", pose)
    assert np.array_equal(twin.irradiance, alone.irradiance)
    solver.move("block", pose)
    assert np.array_equal(solver.irradiance, before)
    # Photons traced by the twin are available to both.
    twin.configure(photons=10_000)
    twin.solve()
    solver.configure(photons=10_000)
    solver.solve()
    assert np.array_equal(solver.irradiance, solver.from_scratch()) and solver.frame.photons == 10_000
