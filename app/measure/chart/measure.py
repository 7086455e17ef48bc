"""One setting of the chart: frame time along the path, error in each class, flicker."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from app.measure.chart.gloss import drawn_gloss
from app.measure.chart.settings import Choice
from app.measure.chart.truth import PoseTruth, background_of, light_of, steady_and_moved
from gi_core.gather.reference_sample import draw_by_area
from gi_core.geometry.error import noise_of_truth, relative_error
from gi_core.geometry.receiver_classes import CLASSES
from gi_core.solver import Solver

WATCHED = 3000  # static receivers drawn; their light is recorded in every frame


class Walk(NamedTuple):
    """The frames of every setting."""

    lap: list  # poses of each frame
    cases: list[PoseTruth]
    watched: np.ndarray  # (n,) static receivers
    areas: np.ndarray  # (n,) float64, in proportion to the area per receiver
    steady: np.ndarray  # (n,) bool, of the watched: not changed by mobiles
    moved: np.ndarray  # (n,) bool, of the watched: changed by mobiles
    change: float  # sum over frames and moved receivers of area x change from frame to frame, by the most photons


class AtCases(NamedTuple):
    """Light at the points of each case."""

    irradiance: list[np.ndarray]  # (n, 3) [W/m2]
    gloss: list[np.ndarray | None]  # (m, 3) [W/m2/sr]; None: the scene has none, or this light


class Recorded(NamedTuple):
    """Frame times and light of one setting."""

    ms: np.ndarray  # (frames,) time of each GI frame
    at_cases: AtCases
    light: np.ndarray  # (frames, watched) luminance


def make_walk(finest, lap: list, cases: list[PoseTruth], seed: int) -> Walk:
    """Return the walk, with the changes that the solver of most photons finds."""
    static = finest.surfaces.receiver_range(0).stop
    areas = finest.receivers.areas[:static]
    watched, weights = draw_by_area(np.flatnonzero(areas > 0), areas, WATCHED, seed)
    background = light_of(background_of(finest), watched)
    nothing = np.zeros(len(watched), bool)
    blank = Walk(lap, [], watched, weights, nothing, nothing, 0.0)
    light = go(finest, blank).light
    steady, moved = steady_and_moved(light, background, weights)
    return Walk(lap, cases, watched, weights, steady, moved, _jump(light[:, moved], weights[moved]))


def go(solver: Solver, walk: Walk, photons: int | None = None, paths: int | None = None) -> Recorded:
    """Move a solved solver along the walk; only the frame itself is timed."""
    ms, light, by_frame = [], [], {}
    solver.move_all(walk.lap[-1], photons, paths)
    for k, poses in enumerate(walk.lap):
        started = time.perf_counter()
        solver.move_all(poses, photons, paths)
        ms.append(1e3 * (time.perf_counter() - started))
        light.append(light_of(solver.irradiance, walk.watched))
        for case in walk.cases:
            if case.frame == k:
                by_frame[k] = solver.irradiance[case.rows], drawn_gloss(solver, case.gloss)
    return Recorded(np.array(ms), _at_cases([by_frame[c.frame] for c in walk.cases]), np.array(light))


def _at_cases(pairs: list[tuple[np.ndarray, np.ndarray | None]]) -> AtCases:
    return AtCases([E for E, _ in pairs], [gloss for _, gloss in pairs])


def at_cases(solver: Solver, walk: Walk, seconds: float = 0.0) -> AtCases:
    """Return the light of each case, gathered at its pose for so many CPU seconds."""
    out = []
    for case in walk.cases:
        solver.move_all(walk.lap[case.frame])
        started = time.process_time()
        for _ in solver.gather_pose_steps() if seconds else ():
            if time.process_time() - started > seconds:
                break
        out.append((solver.irradiance[case.rows], drawn_gloss(solver, case.gloss)))
    return _at_cases(out)


def row(choice: Choice, seen: Recorded, limit: AtCases | None, walk: Walk, first_frame: float) -> dict:
    """Return the columns of a setting: times [ms] and relative errors of `gi_core.geometry.error`."""
    numbers = {
        **choice._asdict(),
        "curve": choice.curve,
        "frame_ms": float(np.median(seen.ms)),
        "frame_p95_ms": float(np.quantile(seen.ms, 0.95)),
        "first_frame_ms": 1e3 * first_frame,
        "flicker": flicker(seen.light, walk),
        "jump": _jump(seen.light[:, walk.moved], walk.areas[walk.moved]) / walk.change if walk.change else float("nan"),
    }
    return numbers | errors(seen.at_cases, limit, walk.cases)


def errors(found: AtCases, limit: AtCases | None, cases: list[PoseTruth]) -> dict[str, float]:
    """Return noise, bias, total (l1), total (l2) and the noise of the truth.

    They are those of all receivers, of each class, and of gloss where the scene has some.
    """
    T, s, w, kind = (np.concatenate(a) for a in zip(*(c[4:6] + (c.weights, c.kind) for c in cases), strict=True))
    E = np.concatenate(found.irradiance)
    end = None if limit is None else np.concatenate(limit.irradiance)
    out: dict[str, float] = {}
    for name in ("all", *CLASSES):
        of = slice(None) if name == "all" else kind == CLASSES.index(name)
        out |= _errors(name, E[of], None if end is None else end[of], T[of], s[of], w[of])
    shining = [k for k, case in enumerate(cases) if case.gloss is not None and found.gloss[k] is not None]
    if shining:
        L, end = (None if of is None else _together([of.gloss[k] for k in shining]) for of in (found, limit))
        T, s, w = (np.concatenate(a) for a in zip(*(cases[k].gloss[3:] for k in shining), strict=True))
        out |= _errors("gloss", L, end, T, s, w)
    return out


def _together(parts: list[np.ndarray | None]) -> np.ndarray | None:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def _errors(name: str, found, end, T: np.ndarray, s: np.ndarray, w: np.ndarray) -> dict[str, float]:
    total = relative_error(found, T, w)
    return {
        f"noise {name}": float("nan") if end is None else relative_error(found, end, w).l1,
        f"bias {name}": float("nan") if end is None else relative_error(end, T, w).l1,
        f"total {name}": total.l1,
        f"total l2 {name}": total.l2,
        f"truth {name}": noise_of_truth(s, T, w),
        f"points {name}": len(w),
    }


def flicker(light: np.ndarray, walk: Walk) -> float:
    """Return the standard deviation over frames / mean light, at receivers that mobiles do not change."""
    still, w = light[:, walk.steady], walk.areas[walk.steady]
    mean = float((w * still.mean(axis=0)).sum())
    return float((w * still.std(axis=0)).sum()) / mean if mean > 0 else float("nan")


def _jump(light: np.ndarray, areas: np.ndarray) -> float:
    """Return the sum of area x change over all frames."""
    return float((areas * np.abs(np.diff(light, axis=0))).sum())
