"""The rows of `bench --sweep`: settings and variants of the scene, in the order of measurement."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import NamedTuple

from app.settings import Settings
from gi_core.estimators import DEFAULT, ESTIMATORS

PHOTONS = (10_000, 100_000, 1_000_000)
TRIANGLES = (72_000, 300_000, 1_000_000)  # the shipped tree has 72,000; surfaces are only cut finer
RADII = ("scaled", "fixed")  # of discs in finer meshes: see `app.measure.bench.row.vary`
GROWTH_PHOTONS = 100_000  # of rows that vary triangles or sides
NEIGHBOURS = 50
SLOW, SLOW_STEP = f"{PHOTONS[-1]} photons, {DEFAULT}, slow drag", 0.003  # of the scene size: 3 mm in a room of 1 m


class Row(NamedTuple):
    """One measurement; `variant` has keys of `app.measure.bench.row.vary`."""

    key: str
    settings: Settings
    frames: int
    variant: dict

    def spec(self) -> dict:
        """Return the input of a row's process as JSON returns it: lists for tuples."""
        spec = {"settings": asdict(self.settings), "frames": self.frames, "variant": self.variant}
        return json.loads(json.dumps(spec))


def rows(settings: Settings, frames: int) -> list[Row]:
    """Return all rows, cheap ones first; artifact control is off except in its own rows."""
    base = replace(settings, control=False, neighbours=settings.neighbours or NEIGHBOURS)
    out = []

    def add(key: str, photons: int, estimator: str = DEFAULT, control: bool = False, **variant) -> None:
        wanted = replace(base, photons=photons, estimator=estimator, control=control)
        out.append(Row(key, wanted, frames, variant))

    for photons in PHOTONS:
        for estimator in ESTIMATORS:
            add(photons_key(photons, estimator), photons, estimator)
        add(photons_key(photons, DEFAULT, control=True), photons, control=True)
    add(SLOW, PHOTONS[-1], step=SLOW_STEP)
    for sides in ("one-sided", "two-sided"):
        add(sides, GROWTH_PHOTONS, two_sided=sides == "two-sided")
    for triangles in TRIANGLES:
        for radius in RADII:
            add(triangles_key(triangles, radius), GROWTH_PHOTONS, triangles=triangles, radius=radius)
    return out


def photons_key(photons: int, estimator: str, control: bool = False) -> str:
    return f"{photons} photons, {estimator}" + (", artifact control" if control else "")


def triangles_key(triangles: int, radius: str) -> str:
    return f"{triangles} triangles, radius {radius}"
