"""Gathering the unbiased answer until it is good enough: saved on the way, and whatever ends it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

from app.rest.reference_store import ReferenceStore
from gi_core.gather.reference import Gathered

SAVE_EVERY = 20.0  # s


class Reached(NamedTuple):
    """Where a run is."""

    state: Gathered
    noise: float  # l1 error that chance makes, of all receivers; inf before the second round
    fraction: float  # 0 .. 1 of the paths that are foretold to be needed
    seconds_left: float | None  # None: too early to tell


def run(store: ReferenceStore, error: float) -> Iterator[Reached]:
    """Gather until the noise is at most `error` (0.01: 1 %); yields after each step, a last time when it is.

    What was gathered is saved every now and then and when the run ends, in whatever way: by Ctrl+C, by
    closing the iterator; not where the disk does not allow it. A run that is good enough from the start gathers
    nothing.
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
            if now - saved > SAVE_EVERY:
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
