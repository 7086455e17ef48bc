"""Error of the changes that mobiles cause, in frames of few photons: as measured, and smoothed and shrunk.

    python -m studies.change_error living_room cornell tree

Poses: three places of the mobiles' path; static light of all photons. Luminance error (l1, gi_core.geometry.error) of
the static part by area, against the same static light with changes by TRUTH photons of another seed. Classes:
receivers whose change is less than TOUCHED of the mean, the others, and all.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from app.draw import motion
from app.settings import STEP, Settings, make_solver, open_moving_scene
from gi_core.frames.control_variate import AROUND, frame_irradiance
from gi_core.geometry.error import luminance, relative_error
from gi_core.photons.flux_sums import NOT_ADDITIVE, Evaluated
from gi_core.solver import Solver

PHOTONS, FRAMES = 1 << 20, (1 << 14, 1 << 16)
TRUTH, TRUTH_SEED = 1 << 22, 99
STEPS, PLACES = 40, (6, 20, 33)  # of the path, and those measured
TOUCHED = 0.03


def read(solver: Solver, photons: int, keep_all: bool) -> np.ndarray:
    """Return irradiance (n, 3) [W/m2] of the static part from the sums of the last frame."""
    estimate, frame = solver.frame.background.estimate, solver.frame.change
    sums: Evaluated = estimate.evaluate(frame)
    if keep_all:
        sums = sums._replace(new_flux=np.full_like(sums.new_flux, NOT_ADDITIVE))
    resting, better = (solver.frame.background.resting(n) for n in (photons, PHOTONS))
    flux_unit = solver.model.emitters.unit_flux / photons
    near = solver.light_source.around(AROUND * solver.setting.radius)
    given = sums, flux_unit, estimate.background(photons)[0], resting, better, solver.levels, near, 1
    return frame_irradiance(*given)[: len(better)]


def report(name: str) -> None:
    """Print the table of a scene."""
    settings = Settings(scene=name, photons=PHOTONS, light="best")
    scene = open_moving_scene(settings)
    solver, judge = (
        make_solver(scene, replace(settings, photons=n, seed=seed)) for n, seed in ((PHOTONS, 0), (TRUTH, TRUTH_SEED))
    )
    solver.solve()
    judge.solve()
    static = solver.surfaces.receiver_range(0)
    weights, still = solver.receivers.areas[static], judge.resting_irradiance
    lap = motion.walk(motion.paths_of(solver), STEP * solver.scene_size, STEPS)
    for photons in FRAMES:
        found = np.zeros((2, 3))
        for place in PLACES:
            judge.move_all(lap[place], paths=4)
            after = judge.irradiance[static]
            better = solver.frame.background.resting(PHOTONS)
            share = np.divide(after, still, out=np.ones_like(after), where=still > 0)
            truth = np.where(after < still, better * share, better + after - still)
            change = np.abs(luminance(after) - luminance(still))
            touched = change >= TOUCHED * np.average(luminance(still), weights=weights)
            solver.move_all(lap[place], photons, 4)
            for k, keep_all in enumerate((True, False)):
                E = read(solver, photons, keep_all)
                rows = (~touched, touched, np.ones_like(touched))
                found[k] += [relative_error(E, truth, weights, r).l1 / len(PLACES) for r in rows]
        for label, row in zip(("as measured", "smoothed and shrunk"), found, strict=True):
            cells = " | ".join(f"{100 * e:.2f}" for e in row)
            print(f"| {name} | {photons:,} | {label} | {cells} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    print("| scene | photons | change | hardly changed | changed | all (%) |\n|---|---|---|---|---|---|")
    for name in parser.parse_args().scenes:
        report(name)


if __name__ == "__main__":
    main()
