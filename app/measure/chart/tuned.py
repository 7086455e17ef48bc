"""The choice of `tune` for a budget as a point of the chart, and its error over the best measured error."""

from __future__ import annotations

import math
from collections.abc import Iterable

from app.measure.chart.settings import RESTED, TUNED, Choice
from app.measure.tuning import Tuned
from app.settings import BUDGET
from gi_core.estimators import ESTIMATORS

LATE = 1.1  # of the budget: a frame of this length still keeps it
JUDGED = {"all": "all receivers", "affected": "receivers that mobiles change", "mobile": "mobiles"}


def choice_of(found: Tuned, traced: Iterable[int], subsets: Iterable[int]) -> Choice:
    """Return the setting of the chart that is like a choice of tune: the most photons predicted to keep the budget.

    traced: numbers of photons traced before; subsets: photons that a frame of an estimator with additive sums may use.
    """
    setting, most = found.choice.setting, max(traced)
    additive = ESTIMATORS[setting.estimator].additive
    counts = sorted(subsets if additive else traced)
    frame = max((n for n in counts if n <= found.choice.frame), default=counts[0])
    return Choice(
        setting.estimator, frame, most if additive else frame, setting.radius, setting.neighbours, setting.control,
        "best", setting.border_correction, setting.textbook, found.paths or 0, True,
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
