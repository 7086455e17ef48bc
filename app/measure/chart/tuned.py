"""The choice of `tune` for a budget as a point of the chart, and its error over the best measured error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from app.measure.chart.settings import RESTED, TUNED, Choice
from app.measure.tuning import tune
from app.settings import BUDGET

if TYPE_CHECKING:
    from gi_core.solver import Solver

LATE = 1.1  # of the budget: a frame of this length still keeps it
JUDGED = {"all": "all receivers", "affected": "receivers that mobiles change", "mobile": "mobiles"}


def tuned_choice(solver: Solver, traced: int, bar) -> Choice:
    """Return the choice of tune for a solver with `traced` photons and gathered light.

    Its frame uses the largest photon subset that is predicted to keep the budget.
    """
    found = tune(solver, 1e-3 * BUDGET, bar)
    setting = found.choice.setting
    subsets = [n for n in solver.frame.subsets if n <= max(found.choice.frame, solver.frame.subsets[0])]
    return Choice(
        setting.estimator, subsets[-1], traced, setting.radius, setting.neighbours, setting.control, "best",
        setting.border_correction, setting.textbook, found.paths or 0, True,
    )  # fmt: skip


def nearness(rows: list[dict]) -> dict[str, float]:
    """Return by class of receivers: error of tune's choice / least error of all settings at most as slow.

    A choice within the budget is compared with every setting within the budget. {} if it was not measured.
    """
    tuned = [r for r in rows if r["curve"] == TUNED]
    if not tuned:
        return {}
    chosen = tuned[-1]
    limit = max(LATE * BUDGET, chosen["frame_ms"])
    moving = [r for r in rows if r["curve"] != TUNED and not r["curve"].endswith(RESTED)]
    out = {}
    for name in JUDGED:
        others = [r[f"total {name}"] for r in moving if r["frame_ms"] <= limit]
        others = [e for e in others if isinstance(e, float) and math.isfinite(e) and e > 0]
        if others and isinstance(chosen[f"total {name}"], float):
            out[name] = chosen[f"total {name}"] / min(others)
    return out


def summary(rows: list[dict]) -> str:
    """Return the nearness in words, "" if it was not measured."""
    near = nearness(rows)
    if not near:
        return ""
    chosen = [r for r in rows if r["curve"] == TUNED][-1]
    choice = Choice.of(chosen)
    parts = ", ".join(f"{ratio:.2f} x at {JUDGED[name]}" for name, ratio in near.items())
    return (
        f"tune's choice for {BUDGET:g} ms ({choice.estimator}, {choice.summary()}) takes {chosen['frame_ms']:.1f} ms; "
        f"its error is {parts}, relative to the least error of all settings that are no slower"
    )
