"""The unbiased reference for the scene as it stands, at some of its receivers: brought on a step at a time at rest.

For the poses that a scene opens with it is kept on disk (app/rest/reference_store.py), and is there at once next time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from app.rest.reference_store import ReferenceStore
    from gi_core.gather.reference import Gathered
    from gi_core.scene import Pose
    from gi_core.solver import Solver

PATHS_PER_STEP = 1 << 12  # paths: a drag that begins now waits for no more


class Truth:
    """Used in the solver's thread alone, but for reading what a step has left."""

    def __init__(
        self, solver: Solver, poses: Mapping[str, Pose], rows: np.ndarray, weights: np.ndarray, even: bool = False
    ) -> None:
        """`even`: as many paths for each receiver, for a picture; else where they lower the error of the whole most."""
        from app.rest.reference_store import ReferenceStore

        self.rows, self.weights = rows, weights  # (n,) receivers, and the area or the count of draws of each
        self.noise = float("inf")  # relative, l1
        self._store = ReferenceStore(solver.model, poses, rows, weights=weights)
        self._is_kept = dict(poses) == solver.model.start_poses()
        self.state: Gathered | None = self._store.load() if self._is_kept else None
        self._saved = self.rounds
        # Not a method: one under way would hold this object, which holds it, and both the scene.
        self._rounds = _rounds(self._store, self.state, None if even and self.state is None else self.weights)

    def step(self) -> None:
        self.state = next(self._rounds)
        self.noise = self.state.noise(self.weights)

    def keep(self) -> None:
        """Write to disk what has been gathered at the poses that the scene opens with."""
        if self._is_kept and self.rounds > self._saved:
            self._store.keep(self.state)
            self._saved = self.rounds

    @property
    def irradiance(self) -> np.ndarray:
        """Return what is known (n, 3) [W/m2], nan where nothing is."""
        if self.state is None:
            return np.full((len(self.rows), 3), np.nan)
        return np.where(self.state.sets[:, None] > 0, self.state.mean, np.nan)

    @property
    def seen(self) -> float:
        """Return the share of receivers that have been seen."""
        return 0.0 if self.state is None else np.count_nonzero(self.state.sets) / max(len(self.rows), 1)

    @property
    def paths(self) -> float:
        """Return how many paths there are a receiver, on average."""
        return 0.0 if self.state is None else float(self.state.paths.mean())

    @property
    def rounds(self) -> int:
        """Return how often every receiver has been seen."""
        return 0 if self.state is None or not len(self.rows) else int(self.state.sets.min())


def _rounds(store: ReferenceStore, found: Gathered | None, weights: np.ndarray | None) -> Iterator[Gathered]:
    """Go through what is known after every step, first what was found on disk."""
    from gi_core.gather.reference import gather_rounds

    if found is not None and found.sets.min(initial=2) > 1:
        yield found
    given = (store.model.scene, store.positions, store.normals, store.seed, weights, store.poses)
    yield from gather_rounds(*given, model=store.model, state=found, step=PATHS_PER_STEP)
