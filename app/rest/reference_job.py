"""The unbiased reference at the current poses and some receivers, traced in steps at rest.

The reference at a scene's start poses is saved (app/rest/reference_store.py) and loaded at the next start.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from app.rest.results import ReferencePicture
    from gi_core.scene import Pose
    from gi_core.solver import Solver


class ReferenceJob:
    """The reference of some receivers; only the solver's thread uses it."""

    def __init__(
        self, solver: Solver, poses: Mapping[str, Pose], rows: np.ndarray, weights: np.ndarray, shares: np.ndarray,
        even: bool = False,
    ) -> None:  # fmt: skip
        """`weights` (n,) of receivers: area, or number of draws. Errors and noise count them times `shares` (n,).

        `even`: equal path counts per receiver, for a picture; else counts that minimise the total error by `weights`.
        """
        from app.rest.reference_store import ReferenceStore

        self.rows, self.weights = rows, weights * shares  # (n,) receivers, and their weights in errors
        self.picture: ReferencePicture | None = None  # None before the first step
        self._store = ReferenceStore(solver.model, poses, rows, weights=weights, levels=solver.levels)
        self._is_kept = dict(poses) == solver.model.start_poses() and bool((solver.levels == 1).all())
        self._gathered = self._store.rounds(even, self._is_kept)
        self._saved = self.rounds
        self.noise = self._gathered.state.noise(self.weights)  # relative, l1

    def step(self) -> None:
        self._gathered.step()
        self.noise = self._gathered.state.noise(self.weights)

    def keep(self) -> None:
        """Save the state at the scene's start poses."""
        if self._is_kept and self.rounds > self._saved:
            self._store.keep(self._gathered.state)
            self._saved = self.rounds

    @property
    def irradiance(self) -> np.ndarray:
        """Irradiance (n, 3) [W/m2], nan where unknown."""
        state = self._gathered.state
        return np.where(state.sets[:, None] > 0, state.mean, np.nan)

    @property
    def seen(self) -> float:
        """Share of receivers with at least one round, 0 .. 1."""
        return np.count_nonzero(self._gathered.state.sets) / max(len(self.rows), 1)

    @property
    def paths(self) -> float:
        """Paths per receiver, on average."""
        return float(self._gathered.state.paths.mean())

    @property
    def look(self) -> tuple[int, int]:
        """A pair that changes when the result changes visibly: at powers of two of the rounds."""
        return self.rounds.bit_length(), int(16 * self.seen)

    @property
    def rounds(self) -> int:
        """Rounds that every receiver has had."""
        return self._gathered.state.rounds
