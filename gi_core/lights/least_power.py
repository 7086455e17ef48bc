"""Levels of lamps that meet targets with the least power: a linear programme with cuts for what is convex.

A requirement on factors c (G,) of the lamps is concave, as light is linear and glare is a square:

    f(c) = linear . c + offset - CERTAIN |noise c| - squares . c^2 >= 0

|noise c| is the standard error of the linear part, so a requirement that holds does so by two standard errors. HiGHS
solves the programme of tangents of all f; tangents at its answer are added until f is met (Kelley 1960). A target may
be missed by a share v of itself at a price no power outweighs: where targets contradict, v says what is missing.
"""

from __future__ import annotations

from typing import NamedTuple

import highspy
import numpy as np

CERTAIN = 2.05  # standard errors: two, and room for TOLERANCE
TOLERANCE = 0.01  # of the standard error, or 1e-6 of the row, by which the last tangents may miss a requirement
MOST_CUTS = 20  # times that tangents are added
PENALTY = 1e3  # price of a whole target that is missed, over the power of all lamps
SHORT = 1e-4  # of a target: more is missing


class Quiet(highspy.Highs):
    """HiGHS without callbacks: their set-up prints a banner and makes a reference cycle."""

    def __init__(self) -> None:
        super(highspy.Highs, self).__init__()


class Requirements(NamedTuple):
    """m requirements of T targets on the factors of G lamps."""

    linear: np.ndarray  # (m, G) float64
    offset: np.ndarray  # (m,)
    noise: np.ndarray  # (m, G), standard errors of `linear`, independent between lamps
    squares: np.ndarray  # (m, G) >= 0
    target: np.ndarray  # (m,) int64, the target of each
    asked: np.ndarray  # (m, G + 1): asked . (c, 1) is the derivative by a relative change of the target

    def values(self, c: np.ndarray) -> np.ndarray:
        """Return f (m,) at factors c (G,)."""
        return self.linear @ c + self.offset - CERTAIN * self.deviation(c) - self.squares @ c**2

    def deviation(self, c: np.ndarray) -> np.ndarray:
        """Return the standard errors (m,) at factors c (G,)."""
        return np.sqrt(self.noise**2 @ c**2)

    def tangents(self, rows: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gradients (k, G) and offsets (k,) of requirements `rows` (k,) at factors c (G,)."""
        r = Requirements(*(a[rows] for a in self))
        deviation = np.maximum(r.deviation(c), 1e-300)[:, None]
        gradient = r.linear - CERTAIN * r.noise**2 * c / deviation - 2 * r.squares * c
        return gradient, r.offset + r.squares @ c**2


class Levels(NamedTuple):
    """The answer."""

    factors: np.ndarray  # (G,), 0 .. 1
    power: float  # of all lamps at these
    missing: np.ndarray  # (T,) share of each target that is missed, 0: it is met
    prices: np.ndarray  # (T,) power that one percent more of each target takes; nan where any is missed


def least_power(of: Requirements, power: np.ndarray, free: np.ndarray, targets: int) -> Levels:
    """Return factors of the least power. power (G,) >= 0: of each lamp at 1; free (G,) bool: others stay at 1."""
    G = len(power)
    highs, answer = Quiet(), np.ones(G)
    for name, value in {"output_flag": False, "threads": 1, "presolve": "off", "solver": "simplex"}.items():
        highs.setOptionValue(name, value)
    cost = np.append(power, np.full(targets, PENALTY * max(power.sum(), 1e-300)))
    cost /= max(power.max(initial=0.0), 1e-300)
    low = np.append(np.where(free, 0.0, 1.0), np.zeros(targets))
    high = np.append(np.ones(G), np.full(targets, highspy.kHighsInf))
    none = np.zeros(0)
    highs.addCols(G + targets, cost, low, high, 0, none.astype(np.int32), none.astype(np.int32), none)
    whole = of.asked.sum(axis=1)
    size = np.maximum(np.abs(whole), 1e-300)
    rows, of_cuts = np.arange(len(whole)), np.zeros(0, np.int64)
    for _ in range(MOST_CUTS):
        if not len(rows):
            break
        gradient, offset = of.tangents(rows, answer)
        values = np.zeros((len(rows), G + targets))
        values[:, :G] = gradient / size[rows, None]
        values[np.arange(len(rows)), G + of.target[rows]] = whole[rows] / size[rows]
        starts, index = np.arange(len(rows)) * (G + targets), np.tile(np.arange(G + targets), len(rows))
        highs.addRows(len(rows), -offset / size[rows], np.full(len(rows), highspy.kHighsInf), values.size,
                      starts.astype(np.int32), index.astype(np.int32), values.reshape(-1))  # fmt: skip
        of_cuts = np.append(of_cuts, rows)
        highs.run()
        solution = highs.getSolution()
        optimum = np.array(solution.col_value)
        answer, missing = np.clip(optimum[:G], low[:G], 1.0), np.maximum(optimum[G:], 0.0)
        slack = TOLERANCE * of.deviation(answer) + 1e-6 * size
        rows = np.flatnonzero(of.values(answer) + whole * missing[of.target] < -slack)
    prices = np.zeros(targets)
    if len(of_cuts):
        duals = np.array(solution.row_dual) / size[of_cuts] * power.max(initial=0.0)
        np.add.at(prices, of.target[of_cuts], 0.01 * duals * (of.asked @ np.append(answer, 1.0))[of_cuts])
    else:
        answer, missing = low[:G], np.zeros(targets)
    missing = np.where(missing > SHORT, missing, 0.0)
    return Levels(answer, float(power @ np.where(free, answer, 0.0)), missing, np.where(missing.any(), np.nan, prices))
