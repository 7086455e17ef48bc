"""The unbiased reference for the scene as it stands, at some of its receivers: gathered a step at a time at rest.

For the poses that a scene opens with it is kept on disk (app/rest/reference_store.py), and is there at once next time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gi_core.display.dilation import Drawn
    from gi_core.scene import Pose
    from gi_core.solver import Solver


class Truth:
    """Used in the solver's thread alone, but for reading the result of a step."""

    def __init__(
        self, solver: Solver, poses: Mapping[str, Pose], rows: np.ndarray, weights: np.ndarray, even: bool = False
    ) -> None:
        """`even`: as many paths for each receiver, for a picture; else where they lower the error of the whole most."""
        from app.rest.reference_store import ReferenceStore

        self.rows, self.weights = rows, weights  # (n,) receivers, and the area or the count of draws of each
        self.drawn: Drawn | None = None  # the picture of it; None before there is one
        self._store = ReferenceStore(solver.model, poses, rows, weights=weights)
        self._is_kept = dict(poses) == solver.model.start_poses()
        self._gathered = self._store.rounds(even, self._is_kept)
        self._saved = self.rounds
        self.noise = self._gathered.state.noise(weights)  # relative, l1

    def step(self) -> None:
        self._gathered.step()
        self.noise = self._gathered.state.noise(self.weights)

    def keep(self) -> None:
        """Write to disk what has been gathered at the poses that the scene opens with."""
        if self._is_kept and self.rounds > self._saved:
            self._store.keep(self._gathered.state)
            self._saved = self.rounds

    @property
    def irradiance(self) -> np.ndarray:
        """Irradiance (n, 3) [W/m2], nan where nothing is gathered yet."""
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
        """Return a pair that changes when there is something new to see; rounds count double."""
        return self.rounds.bit_length(), int(16 * self.seen)

    @property
    def rounds(self) -> int:
        """Rounds that have come to every receiver."""
        return self._gathered.state.rounds
