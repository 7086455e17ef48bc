"""`gi-viewer reference`: unbiased irradiance at every receiver, path traced once and kept."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from app.cli import options
from app.cli.options import settings_of
from app.cli.progress import opened, time_left
from app.cli.terminal import Exit
from app.cli.writable import check_folder
from app.settings import open_scene

if TYPE_CHECKING:
    from app.rest.reference_store import ReferenceStore


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, "lamps", "rays", "seed")
    add = options.measuring(parser)
    options.error(add)


class Stopped(KeyboardInterrupt):
    """Ctrl+C; the message names the files kept and the command that resumes."""


def run(arguments: argparse.Namespace) -> int:
    """Path trace until the noise is small, and print the result.

    Raises Stopped when interrupted, with all paths on disk.
    """
    from app.rest.reference_store import FOLDER_VARIABLE, ReferenceStore, reference_folder
    from gi_core.model import Model

    settings = settings_of(arguments)
    check_folder(FOLDER_VARIABLE, reference_folder())
    with opened(settings, open_scene) as (bar, scene):
        model = Model(scene, rays=settings.rays)
        lamps = model.emitters.lamps
        levels = lamps.changed(lamps.full(), settings.levels(()), scene.name)
        store = ReferenceStore(model, seed=settings.seed, levels=levels)
        started, first = time.monotonic(), None
        try:
            for reached in store.gather(arguments.error / 100):
                first = first or reached.fraction
                done = reached.fraction - first
                left = (1 - reached.fraction) * (time.monotonic() - started) / done if done else None
                bar(f"gathering{time_left(left)}", reached.fraction)
        except KeyboardInterrupt:
            raise Stopped(_kept(store)) from None
    light = (store.weights[:, None] * reached.state.mean).sum(axis=0) / store.weights.sum()
    print(f"{settings.scene}: {len(store.rows):,} receivers, {int(reached.state.paths.sum()):,} paths")
    print(f"noise: {100 * reached.noise:.2f} % of the light (l1, luminance, by area)")
    unit = "lux" if scene.units == "photometric" else "W/m2"
    print("mean irradiance: " + ", ".join(f"{c:.5g}" for c in light) + f" {unit}")
    print(f"kept in {store.path}")
    return Exit.OK


def _kept(store: ReferenceStore) -> str:
    state = store.load()
    if state is None:
        return "stopped before the first path"
    noise = state.noise(store.weights)
    at = f", noise {100 * noise:.2f} %" if noise < float("inf") else ""
    return f"stopped; {int(state.paths.sum()):,} paths are kept{at}: the same command goes on from there"
