"""Warnings about light that differs from the request, or from the scene that was probably meant."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gi_core.solver import Solver


ESCAPES = 0.8  # of the photons at their first flight


def warnings_of(solver: Solver) -> dict[str, str]:
    """Return one sentence per kind of warning: "memory", "escapes", "behind"; empty without any."""
    from gi_core.files.completion.completion import lit_by_stand_ins

    sentences, chosen = {}, solver.chosen
    if solver.frame.store.memory_full:
        wanted = f"{solver.frame.photons:,} of the {solver.photons:,} photons wanted"
        sentences["memory"] = f"memory holds no more than {wanted}"
    if chosen.escaped_first > ESCAPES and not lit_by_stand_ins(solver.scene):  # added lights cannot be turned
        sentences["escapes"] = (
            f"{100 * chosen.escaped_first:.0f} % of the light leaves the scene at its first flight; close it, or turn "
            "its lights inwards: most photons are wasted and the picture is noisier than necessary"
        )
    if chosen.behind_first > 0.5:  # 0.5 of them, absorbed by backs of one-sided faces
        sentences["behind"] = (
            f"{100 * chosen.behind_first:.0f} % of the light first meets backs of one-sided faces, which are black; "
            "turn these faces over, or make their materials two-sided"
        )
    return sentences
