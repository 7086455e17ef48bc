"""A run of the reference to a given noise, saved at intervals and at its end."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

from app.rest.reference_store import ReferenceStore
from gi_core.gather.reference import Gathered

SAVE_SECONDS = 20.0


class Reached(NamedTuple):
    """Progress of a run."""

    state: Gathered
    noise: float  # l1, over all receivers; inf before the second round
    fraction: float  # 0 .. 1 of the predicted paths
    seconds_left: float | None  # None: no prediction yet


def run(store: ReferenceStore, error: float) -> Iterator[Reached]:
    """Trace paths until the noise is at most `error` (0.01: 1 %); yield progress after each step and at the end.

    The state is saved every SAVE_SECONDS and at the end, also after Ctrl+C or a closed iterator; a failed save is
    ignored. A stored state with little enough noise traces nothing.
    """
    state = store.load()
    if state is not None and (noise := state.noise(store.weights)) <= error:
        yield Reached(state, noise, 1.0, 0.0)
        return
    saved = started = time.monotonic()
    before = 0 if state is None else int(state.paths.sum())
    noise, round_ = float("inf"), -1
    try:
        for state in store.steps():
            now = time.monotonic()
            done = int(state.paths.sum())
            if state.sets.min() != round_:
                round_ = int(state.sets.min())
                noise = state.noise(store.weights)
                per_path = None if noise == float("inf") else done * (noise / error) ** 2
            if not noise > error:  # nan: there is no light
                break
            if now - saved > SAVE_SECONDS:
                store.keep(state)
                saved = now
            yield _reached(state, noise, done, per_path, before, now - started)
    finally:
        if state is not None:
            store.keep(state)
    yield Reached(state, noise, 1.0, 0.0)


def _reached(state, noise, done, needed, before, seconds) -> Reached:
    if needed is None or done == before:
        return Reached(state, noise, 0.0, None)
    needed = max(needed, done)
    return Reached(state, noise, done / needed, (needed - done) * seconds / (done - before))
