"""A row of the failure atlas: a failure, its prediction by theory, its measurement, its remedy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np

from gi_core.scene import Scene
from gi_core.solver import Solver

SEEDS = 8  # runs per standard error
RAYS: ContextVar[str | None] = ContextVar("rays", default=None)  # structure of rays of all rows


class Number(NamedTuple):
    """A measured mean and its standard error, 0 for numbers without chance."""

    mean: float
    error: float = 0.0
    runs: int = 1  # behind the error

    def __str__(self) -> str:
        if self.error <= 1e-12 * abs(self.mean):
            return f"{self.mean:.4g}"
        digits = max(1 - math.floor(math.log10(self.error)), 0)  # two digits of the error
        return f"{self.mean:.{digits}f} ± {self.error:.{digits}f}"


class View(NamedTuple):
    """The picture of a row: a scene under the setting that fails and under its remedy."""

    scene: Scene
    photons: int
    fails: dict  # fields of Setting
    helps: dict | None
    caption: str = "as it fails"  # without a remedy


class AtlasRow(NamedTuple):
    """One failure. Numbers are irradiance over truth unless `quantity` says otherwise."""

    key: str  # of its picture
    where: str
    theory: str
    predicted: float
    measured: Number
    remedy: str = "none needed"
    remedied: Number | None = None  # None: there is no remedy
    aim: float = 1.0  # prediction for `remedied`
    known: float = 0.0  # absolute uncertainty of the prediction
    cost: str = ""
    aim_known: float = 0.0  # absolute uncertainty of the aim
    view: View | None = None
    quantity: str = "E / truth"
    title: str = ""  # of the section of this row and its neighbours; "": `where`


def solved(scene: Scene, photons: int, seed: int = 0, poses=None, **setting) -> Solver:
    """Return a solver that has traced its photons, with mobiles at poses."""
    solver = Solver(
        scene, photons=photons, seed=seed, **{"neighbours": 50, "radius": 0.1, "rays": RAYS.get(), **setting}
    )
    solver.solve()
    if poses:
        solver.move_all(poses)
    return solver


def over_seeds(runs: Callable[[int], Sequence[float]], seeds: int) -> list[Number]:
    """Return mean and standard error over seeds of each number of `runs(seed)`."""
    samples = np.array([runs(seed) for seed in range(seeds)], float)
    errors = samples.std(axis=0, ddof=1) / math.sqrt(seeds)
    return [Number(float(m), float(e), seeds) for m, e in zip(samples.mean(axis=0), errors, strict=True)]


def ratios(
    scene: Scene, photons: int, places: Sequence, settings: Sequence[dict], seeds: int = SEEDS, truth: float = 1.0
):
    """Return irradiance / truth by setting and group of receivers.

    places: a function per group, receivers -> (R,) bool. All settings use the same photons.
    """

    def run(seed):
        solver, found = solved(scene, photons, seed, **settings[0]), []
        groups = [place(solver.receivers) for place in places]
        assert all(g.any() for g in groups)
        for setting in settings:
            solver.configure(**setting)
            solver.solve()
            found += [solver.irradiance[g, 1].mean() / truth for g in groups]
        return found

    flat = over_seeds(run, seeds)
    return [flat[k : k + len(places)] for k in range(0, len(flat), len(places))]


def near(*points, tolerance: float = 1e-6) -> Callable:
    """Return a function of receivers: which of them (R,) bool lie at one of the points."""

    def find(receivers):
        p = receivers.positions
        return np.any([np.abs(p - q).max(axis=1) < tolerance for q in np.asarray(points, float)], axis=0)

    return find
