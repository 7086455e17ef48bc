"""Error of a scene's light at rest, by estimator and gathered, everywhere and in view.

    python -m studies.light_error cornell room.glb+chair.glb --points 1000 --noise 1 --rounds 2

Luminance error (l1, gi_core.geometry.error) [%] of the static part's light without mobiles: of photons by every
estimator, and of gathered light before and after denoising. The truth uses other paths until its noise is `--noise`;
it is kept on disk, and its noise is subtracted in squares. *everywhere*: receivers drawn by area; *in view*: those
that the first view shows; *open*: without the unreached receivers of gi_core.display.dilation, which pictures fill.
*noise*: the error everywhere due to photon noise, from another seed; *bias*: the rest.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gi_core.base.pause import pause, steps
from gi_core.gather.reference_sample import draw_by_area
from tests.support.receiver_samples import in_view

TRUTH_SEED, SAMPLE_SEED = 77, 10  # of nothing else
GROUPS = ("everywhere", "open", "in view", "in view, open")


class Sample(NamedTuple):
    """Receivers, the truth there, and which of GROUPS each belongs to."""

    rows: np.ndarray  # (n,) int64
    weights: np.ndarray  # (groups, n) float64, 0 where a receiver does not belong
    truth: np.ndarray  # (n, 3) float64 [W/m2]
    noise: np.ndarray  # (groups,) float64 of the truth, relative, l1


def static_solver(what: str, **settings):
    """Return a solver of a scene as it opens (`room.glb+chair.glb`), with its mobiles taken away."""
    from app.settings import Settings, make_solver, open_scene

    static, *mobiles = what.split("+")
    asked = Settings(scene=static, mobiles=tuple(mobiles), **settings)
    return make_solver(replace(open_scene(asked), mobiles=()), asked)


def sample(solver, light: np.ndarray, points: int, noise: float) -> Sample:
    """Draw receivers and gather the truth there; `light` (R, 3) decides which of them are unreached."""
    from app.rest.reference_store import ReferenceStore

    areas = solver.receivers.areas
    draws = [draw_by_area(rows, areas, points, SAMPLE_SEED) for rows in (np.flatnonzero(areas > 0), in_view(solver))]
    rows = np.unique(np.concatenate([drawn for drawn, _ in draws]))
    is_open = ~np.isin(rows, unreached_rows(solver, light))
    weights = []
    for drawn, times in draws:
        w = np.zeros(len(rows))
        w[np.searchsorted(rows, drawn)] = times
        weights += [w, w * is_open]
    store = ReferenceStore(solver.model, rows=rows, seed=TRUTH_SEED, weights=weights[0] + weights[2])
    *_, reached = store.gather(noise)
    of_truth = np.array([reached.state.noise(w) for w in weights])
    return Sample(rows, np.array(weights), reached.state.mean, of_truth)


def unreached_rows(solver, light: np.ndarray) -> np.ndarray:
    """Return the receivers that pictures fill by the light (R, 3)."""
    from gi_core.display.dilation import Dilation

    return Dilation(solver.model, solver.scene_size).find_static(light).rows


def gathered_light(solver, rounds: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Gather whole rounds; return light (R, 3) before and after denoising, and the predicted noise before it."""
    from gi_core.gather.static import StaticGather

    g = StaticGather(solver.model, solver.seed)
    for progress in steps(lambda: g._whole_paths(lambda: pause(g.progress(picture=True)))):
        if progress.picture and g.state.sets.min() >= rounds:
            break
    return g.state.mean.copy(), g.estimate.irradiance, g.noise


def errors(E: np.ndarray, of: Sample) -> list[float]:
    """Return the relative l1 error of E (R, 3) in each of GROUPS, without the truth's noise."""
    from gi_core.geometry.error import bias_left, relative_error

    totals = [relative_error(E[of.rows], of.truth, w).l1 for w in of.weights]
    return [bias_left(total, noise) for total, noise in zip(totals, of.noise, strict=True)]


def scatter(E: np.ndarray, other: np.ndarray, of: Sample) -> float:
    """Return the relative l1 noise of E (R, 3) everywhere, from the light of another seed."""
    from gi_core.geometry.error import relative_error

    return relative_error(E[of.rows], other[of.rows], of.weights[0]).l1 / np.sqrt(2)


def measure(
    what: str, points: int, noise: float, rounds: int, estimators: list[str], least: int | None = None, **settings
) -> list[str]:
    """Return the lines of a scene's table; least: smallest photon subset with a line, None for all photons alone."""
    from gi_core.geometry.error import bias_left

    solver = static_solver(what, **settings)
    raw, smooth, predicted = gathered_light(solver, rounds)
    of = sample(solver, raw, points, noise)
    lines = [_line(f"gathered, {rounds} rounds (predicted {100 * predicted:.1f})", errors(raw, of))]
    lines.append(_line("the same, smoothed", errors(smooth, of)))
    other = static_solver(what, **settings | {"seed": 1})
    for estimator in estimators:
        for s in (solver, other):
            s.configure(estimator=estimator, subset_only=True)
            s.solve()
        for photons in solver.frame.subsets:
            if photons < solver.photons and (least is None or photons < least):
                continue
            for s in (solver, other):
                s.move_all({}, photons)
            found, by_chance = errors(solver.irradiance, of), scatter(solver.irradiance, other.irradiance, of)
            name = f"{estimator}, {photons:,} photons"
            name += f", {solver.setting.radius:.3g} m" if estimator == "tangent_plane" else ""
            lines.append(_line(name, found, by_chance, bias_left(found[0], by_chance)))
    counts = [np.count_nonzero(w) for w in of.weights]
    lines.append("| receivers | " + " | ".join(f"{n:,}" for n in counts) + " | | |")
    return [*lines, _line("noise of the truth", list(of.noise))]


def _line(name: str, values: list[float], *more: float) -> str:
    cells = [f"{100 * v:.1f}" for v in (*values, *more)]
    return f"| {name} | " + " | ".join(cells + [""] * (len(GROUPS) + 2 - len(cells))) + " |"


def main() -> None:
    from gi_core.estimators import ESTIMATORS

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--points", type=int, default=1000, help="receivers of each kind")
    parser.add_argument("--noise", type=float, default=1.0, help="of the truth [%%]")
    parser.add_argument("--rounds", type=int, default=2, help="of gathering")
    parser.add_argument("--estimators", nargs="+", default=list(ESTIMATORS), choices=list(ESTIMATORS))
    parser.add_argument("--from", type=int, dest="least", metavar="N", help="also measure photon subsets from N on")
    for name, kind in (("photons", int), ("radius", float), ("max-edge", float)):
        parser.add_argument(f"--{name}", type=kind)
    asked = parser.parse_args()
    subprocess.run([sys.executable, "-m", "gi_core.instruments.compile_ahead"], stdout=subprocess.DEVNULL, check=True)
    given = {name: getattr(asked, name) for name in ("photons", "radius", "max_edge")}
    for what in asked.scenes:
        print(
            f"\n| {'+'.join(part.rpartition('/')[2] for part in what.split('+'))} |",
            *(f"{g} |" for g in GROUPS),
            "noise | bias |",
        )
        for line in measure(
            what, asked.points, asked.noise / 100, asked.rounds, asked.estimators, asked.least, **given
        ):
            print(line, flush=True)


if __name__ == "__main__":
    main()
