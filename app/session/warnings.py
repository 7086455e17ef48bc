"""What is to be said of light that is complete, where it is not what was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gi_core.base.fixed_point import MAX_SEGMENTS
from gi_core.geometry.error import luminance

if TYPE_CHECKING:
    from gi_core.solver import Solver

MUCH = 0.02  # of the light that may be cut off without a word: less than settings choose as error


def caveats(solver: Solver) -> dict[str, str]:
    """Return a sentence about each thing that is amiss: "memory", "truncated"; empty where nothing is."""
    found = {"memory": _memory(solver), "truncated": _truncated(solver)}
    return {what: text for what, text in found.items() if text}


def _memory(solver: Solver) -> str:
    if not solver.frame.store.memory_full:
        return ""
    return f"memory holds no more than {solver.frame.photons:,} of the {solver.photons:,} photons wanted"


def _truncated(solver: Solver) -> str:
    fates = solver.frame.fates
    emitted, cut_off = (float(luminance(fates[name])) for name in ("emitted", "truncated"))
    if cut_off <= MUCH * emitted:
        return ""
    return (
        f"{100 * cut_off / emitted:.0f} % of the light is cut off after {MAX_SEGMENTS} segments of its paths, and the "
        "picture is too dark by about as much: let what reflects nearly all light reflect less (white paint: 0.8)"
    )
