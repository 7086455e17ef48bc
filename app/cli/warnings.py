"""Warnings about complete light that differs from the request."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gi_core.solver import Solver


def warnings_of(solver: Solver) -> dict[str, str]:
    """Return one sentence per kind of warning: "memory"; empty without any."""
    if not solver.frame.store.memory_full:
        return {}
    return {"memory": f"memory holds no more than {solver.frame.photons:,} of the {solver.photons:,} photons wanted"}
