"""Pictures of the page: the truth, and the best setting of each estimator with an error map."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.draw import raycast
from app.draw.colour_map import signed_colours
from app.draw.shot import Shot
from app.measure.chart.run import Run
from app.measure.chart.settings import Choice
from app.rest.reference_store import ReferenceStore
from gi_core.estimators import ESTIMATORS
from gi_core.geometry.error import relative_error, signed_error

SIZE = (480, 320)  # pixels
SOON_ENOUGH = 40.0  # ms: longest frame among the best settings
SCALE = 0.5  # relative error at the ends of the colour scale


class PagePicture(NamedTuple):
    """A picture and its caption."""

    title: str
    text: str
    image: np.ndarray  # (h, w, 3) uint8
    error_map: np.ndarray | None


def best_rows(rows: list[dict]) -> list[dict]:
    """Return per estimator the row of least error within SOON_ENOUGH, else its fastest row."""
    out = []
    for estimator in ESTIMATORS:
        own = [r for r in rows if r["estimator"] == estimator]
        soon = [r for r in own if r["frame_ms"] <= SOON_ENOUGH]
        if own:
            out.append(min(soon, key=lambda r: r["total all"]) if soon else min(own, key=lambda r: r["frame_ms"]))
    return out


def pictures(run: Run, rows: list[dict]) -> list[PagePicture]:
    """Return the truth and the best row of each estimator, at the first pose where errors were measured."""
    poses = run.lap[run.truth_frames[0]]
    solver = run.measurer.base.twin()
    solver.move_all(poses)
    store = ReferenceStore(solver.model, solver.poses, seed=run.settings.seed, levels=solver.levels)
    for reached in store.gather(run.effort.picture_truth):
        run.bar("truth of the pictures", reached.fraction)
    truth, areas = reached.state.mean, store.weights
    solver.frame = solver.frame._replace(irradiance=truth)
    shot = Shot(solver, replace(run.settings, size=SIZE))
    out = [PagePicture("truth", f"unbiased path tracing, noise {100 * reached.noise:.1f} %", shot.take(), None)]
    settings = replace(run.settings, size=SIZE, exposure=shot.exposure)
    for row in best_rows(rows):
        run.bar(f"picture of {row['estimator']}", 0.0)
        choice = Choice.of(row)
        solver, _ = run.measurer.solved(choice)
        solver.move_all(poses, *choice.frame)
        shot = Shot(solver, settings)
        error = signed_error(solver.irradiance, truth, areas)
        total = relative_error(solver.irradiance, truth, areas)
        text = f"{choice.summary()}: {row['frame_ms']:.3g} ms per frame; error {100 * total.l1:.1f} % here"
        out.append(PagePicture(choice.curve, text, shot.take(), _map(shot, error)))
    return out


def _map(shot: Shot, error: np.ndarray) -> np.ndarray:
    """Return an error map (h, w, 3) uint8 of relative errors (R,): blue too dark, red too bright."""
    display = signed_colours(np.nan_to_num(error) / SCALE)
    linear = np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)  # of sRGB
    colours = [(linear[m.front], linear[np.maximum(m.back, 0)]) for m in shot.meshes]
    model, solver = shot.solver.model, shot.solver
    at, camera = model.transforms(solver.poses), shot.camera.relative_to(model.origins[0])
    return raycast.picture(
        model.accelerator, at, shot.meshes, colours, camera, SIZE, 0.0, "clip", shot.settings.cull, textured=False
    )
