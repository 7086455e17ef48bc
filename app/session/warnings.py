"""What is to be said of light that is complete, where it is not what was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gi_core.solver import Solver


def caveats(solver: Solver) -> dict[str, str]:
    """Return a sentence about each thing that is amiss: "memory"; empty where nothing is."""
    if not solver.frame.store.memory_full:
        return {}
    return {"memory": f"memory holds no more than {solver.frame.photons:,} of the {solver.photons:,} photons wanted"}
