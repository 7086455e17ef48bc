"""What `tune` chooses for a budget, as a point of the chart, and how near it comes to the best that was measured."""

from __future__ import annotations

import math

from app.measure.chart.settings import TUNED, Choice
from app.rest.tuning import tune

BUDGET = 16.0  # ms a frame, the panel's own
LATE = 1.1  # times the budget still keeps it: another moment of the machine
JUDGED = {"all": "all receivers", "affected": "what the mobiles change", "mobile": "the mobiles"}


def tuned_choice(solver, traced: int, bar) -> Choice:
    """Return what tune chooses for a solver that has solved with `traced` photons, its light gathered as the window's.

    The frame is of the largest prefix of photons that it foretells to keep the budget.
    """
    from app.rest.tuning import finished

    found = finished(tune(solver, 1e-3 * BUDGET), bar)
    setting = found.choice.setting
    prefixes = [n for n in solver.prefixes if n <= max(found.choice.frame, solver.prefixes[0])]
    return Choice(
        setting.estimator, prefixes[-1], traced, setting.radius, setting.neighbours, setting.control, "best",
        setting.border_correction, setting.textbook, found.paths or 0, True,
    )  # fmt: skip


def nearness(rows: list[dict]) -> dict[str, float]:
    """Return, by class of receivers, the error of tune's choice over the least of what is no slower (of what keeps
    the budget, if it does); {} where it was not measured.
    """
    tuned = [r for r in rows if r["curve"] == TUNED]
    if not tuned:
        return {}
    chosen = tuned[-1]
    limit = max(LATE * BUDGET, chosen["frame_ms"])
    out = {}
    for name in JUDGED:
        others = [r[f"total {name}"] for r in rows if r["curve"] != TUNED and r["frame_ms"] <= limit]
        others = [e for e in others if isinstance(e, float) and math.isfinite(e) and e > 0]
        if others and isinstance(chosen[f"total {name}"], float):
            out[name] = chosen[f"total {name}"] / min(others)
    return out


def told(rows: list[dict]) -> str:
    """Return that in words, "" where it was not measured."""
    near = nearness(rows)
    if not near:
        return ""
    chosen = [r for r in rows if r["curve"] == TUNED][-1]
    choice = Choice(*(chosen[name] for name in Choice._fields))
    parts = ", ".join(f"{ratio:.2f} x on {JUDGED[name]}" for name, ratio in near.items())
    return (
        f"tune's choice for {BUDGET:g} ms ({choice.estimator}, {choice.told()}) takes {chosen['frame_ms']:.1f} ms; "
        f"its error is {parts}, relative to the least of every setting that is no slower"
    )
