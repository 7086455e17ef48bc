"""The choice of `gi-viewer tune` beside every candidate, measured in full.

    python -m studies.tune_front cornell tree --budget 16

Each estimator and radius that tune tries, and its choice, is solved with all its photons. Frames of every photon
subset are timed, and their errors are measured at poses and receivers of another seed than tune's own. *best*: the
least error in motion within the budget; *ratio*: error of tune's choice in its largest frame within the budget / best.
"""

from __future__ import annotations

import argparse

from app.cli.progress import Bar, compile_kernels, solve
from app.measure.tuning import candidates, judged, tune
from app.settings import LIGHTS, Settings, make_solver, open_moving_scene
from gi_core.tuning.setting_trials import errors_of

LATE = 1.1  # times the budget still keeps it: another moment of the machine


def front(scene: str, budget: float, light: str) -> str:
    """Return one line of the table; budget [ms]."""
    settings = Settings(scene=scene, budget=budget, light=light)
    with Bar() as bar:
        compile_kernels(bar)
        solver = make_solver(open_moving_scene(settings), settings)
        solve(solver, bar)
        found = tune(solver, 1e-3 * budget, bar)
        judge, samples = judged(solver, lambda done: bar("tracing the reference", done))

        def least(photons: int, **setting) -> tuple[float, int, float]:
            """Return error, photons and ms of the best frame of a setting that keeps the budget."""
            judge.configure(photons=photons, **setting)
            judge.solve()
            out = [(float("inf"), 0, 0.0)]
            for subset in judge.frame.subsets:
                _, moving, used, seconds = errors_of(judge, samples, subset, found.paths)
                if 1e3 * seconds > LATE * budget:
                    break
                out.append((moving, used, 1e3 * seconds))
            return min(out)

        chosen = least(found.choice.photons, **found.choice.setting._asdict())
        every = []
        for k, candidate in enumerate(candidates(solver)):
            bar(f"measuring {candidate['estimator']}", k / 7)
            every.append((*least(solver.photons, **candidate), candidate))
    best = min((chosen, *every), key=lambda found: found[0])
    name = " ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in (best[3] if len(best) > 3 else {}).values())
    return (
        f"| {scene} | {found.choice.setting.estimator}, {found.choice.setting.radius:.3g} m | "
        f"{100 * found.choice.moving_error:.1f} % | {100 * chosen[0]:.1f} %, {chosen[1]:,}, {chosen[2]:.1f} ms | "
        f"{100 * best[0]:.1f} %, {best[1]:,}, {best[2]:.1f} ms, {name or 'the choice'} | {chosen[0] / best[0]:.2f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--budget", type=float, default=16.0, help="[ms]")
    parser.add_argument("--light", choices=LIGHTS, default="best")
    asked = parser.parse_args()
    print("| scene | chosen | predicted in motion | found | best | ratio |\n|---|---|---|---|---|---|")
    for scene in asked.scenes:
        print(front(scene, asked.budget, asked.light), flush=True)


if __name__ == "__main__":
    main()
