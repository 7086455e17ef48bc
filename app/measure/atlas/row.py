"""A row of the failure atlas: where a method fails, what theory says, what is measured, what helps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gi_core.scene import Scene
from gi_core.solver import Solver

SEEDS = 8  # runs that a standard error is taken from


class Number(NamedTuple):
    """A measured mean and its standard error; an error of 0 means that chance has no part in it."""

    mean: float
    error: float = 0.0
    runs: int = 1  # that the error is taken from

    def __str__(self) -> str:
        if self.error <= 1e-12 * abs(self.mean):
            return f"{self.mean:.4g}"
        digits = max(1 - math.floor(math.log10(self.error)), 0)  # two that chance reaches
        return f"{self.mean:.{digits}f} ± {self.error:.{digits}f}"


class View(NamedTuple):
    """What the picture of a row shows: a scene under two settings, where it fails and where it does not."""

    scene: Scene
    photons: int
    fails: dict  # fields of Setting
    helps: dict | None
    caption: str = "as it fails"  # where nothing helps


class Row(NamedTuple):
    """One failure. Numbers are irradiance over truth unless `what` says otherwise."""

    key: str  # of its pictures
    where: str
    theory: str
    predicted: float
    measured: Number
    remedy: str
    remedied: Number | None  # None: there is none
    aim: float = 1.0  # what `remedied` should be
    known: float = 0.0  # how well theory knows the prediction, absolutely
    cost: str = ""
    aim_known: float = 0.0  # how near to its aim theory lets a remedy come
    view: View | None = None
    what: str = "E / truth"
    title: str = ""  # what it and its neighbours of the same title are about; "": `where`


def solved(scene: Scene, photons: int, seed: int = 0, poses=None, **setting) -> Solver:
    """Return a solver that has traced its photons, with mobiles at poses."""
    solver = Solver(scene, photons=photons, seed=seed, **{"neighbours": 50, "radius": 0.1, **setting})
    solver.solve()
    if poses:
        solver.move_all(poses)
    return solver


def over_seeds(runs: Callable[[int], Sequence[float]], seeds: int) -> list[Number]:
    """Return mean and standard error of each number of `runs(seed)`, taken from the scatter over seeds."""
    samples = np.array([runs(seed) for seed in range(seeds)], float)
    errors = samples.std(axis=0, ddof=1) / math.sqrt(seeds)
    return [Number(float(m), float(e), seeds) for m, e in zip(samples.mean(axis=0), errors, strict=True)]


def ratios(
    scene: Scene, photons: int, places: Sequence, settings: Sequence[dict], seeds: int = SEEDS, truth: float = 1.0
):
    """Return irradiance over truth at each of some groups of receivers, one list of numbers for each setting.

    `places` are functions of receivers that return (R,) bool. All settings see the same photons.
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
    """Return what finds the receivers at any of some points."""

    def find(receivers):
        p = receivers.positions
        return np.any([np.abs(p - q).max(axis=1) < tolerance for q in np.asarray(points, float)], axis=0)

    return find
