"""Error of the changes that mobiles cause, in frames of few photons: as measured, and smoothed and shrunk.

    python -m studies.change_error living_room cornell tree

Poses: three places of the mobiles' path; static light of all photons. Luminance error (l1, gi_core.geometry.error) of
the static part by area, against the same static light with changes by TRUTH photons of another seed. Classes:
receivers whose change is less than TOUCHED of the mean, the others, and all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from app.settings import Settings, make_solver, open_moving_scene
from gi_core.frames.control_variate import AROUND, Direct, frame_irradiance
from gi_core.geometry.error import relative_error
from gi_core.photons.flux_sums import NOT_ADDITIVE, Evaluated
from gi_core.solver import Solver
from studies.mobile_changes import FRAMES, places, print_rows, touched, with_change

PHOTONS = 1 << 20
TRUTH, TRUTH_SEED = 1 << 22, 99
TOUCHED = 0.03


def read(solver: Solver, photons: int, keep_all: bool) -> np.ndarray:
    """Return irradiance (n, 3) [W/m2] of the static part from the sums of the last frame."""
    estimate, frame = solver.frame.background.estimate, solver.frame.change
    sums: Evaluated = estimate.evaluate(frame)
    if keep_all:
        sums = sums._replace(new_flux=np.full_like(sums.new_flux, NOT_ADDITIVE))
    own, better = (solver.frame.background.irradiance(n) for n in (photons, PHOTONS))
    flux_unit = solver.model.emitters.unit_flux / photons
    near = solver.frame_light.static.around(AROUND * solver.setting.radius)
    given = (
        sums,
        flux_unit,
        estimate.background(photons)[0],
        own,
        better,
        Direct.unknown(len(better)),
        solver.levels,
        near,
        1,
    )
    return frame_irradiance(*given).irradiance[: len(better)]


def rows_of(name: str) -> Iterator[str]:
    """Yield the rows of a scene."""
    settings = Settings(scene=name, photons=PHOTONS, light="best")
    scene = open_moving_scene(settings)
    solver, judge = (
        make_solver(scene, replace(settings, photons=n, seed=seed)) for n, seed in ((PHOTONS, 0), (TRUTH, TRUTH_SEED))
    )
    solver.solve()
    judge.solve()
    static = solver.surfaces.receiver_range(0)
    weights, still, every = solver.receivers.areas[static], judge.static_irradiance, places(solver)
    for photons in FRAMES:
        found = np.zeros((2, 3))
        for poses in every:
            judge.move_all(poses, paths=4)
            after = judge.irradiance[static]
            truth = with_change(after, still, solver.frame.background.irradiance(PHOTONS))
            changed = touched(after, still, weights, TOUCHED)
            solver.move_all(poses, photons, 4)
            for k, keep_all in enumerate((True, False)):
                E = read(solver, photons, keep_all)
                rows = (~changed, changed, np.ones_like(changed))
                found[k] += [relative_error(E, truth, weights, r).l1 / len(every) for r in rows]
        for label, row in zip(("as measured", "smoothed and shrunk"), found, strict=True):
            cells = " | ".join(f"{100 * e:.2f}" for e in row)
            yield f"{photons:,} | {label} | {cells}"


if __name__ == "__main__":
    print_rows(__doc__, "change | hardly changed | changed | all (%)", rows_of)
