"""The loop of studies of changes: places of the mobiles' path, receivers that change, errors, rows of a table."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable

import numpy as np

from app.draw import motion
from app.settings import STEP
from gi_core.geometry.error import luminance
from gi_core.scene import Pose
from gi_core.solver import Solver

FRAMES = (1 << 14, 1 << 16)  # photons
STEPS, PLACES = 40, (6, 20, 33)  # of the path, and those measured


def places(solver: Solver) -> list[dict[str, Pose]]:
    """Return the poses of the mobiles at the measured places."""
    lap = motion.walk(motion.paths_of(solver), STEP * solver.scene_size, STEPS)
    return [lap[place] for place in PLACES]


def with_change(frame: np.ndarray, rest: np.ndarray, better: np.ndarray) -> np.ndarray:
    """Return better light at rest with the change of a frame, as gi_core.frames.control_variate measures it."""
    share = np.divide(frame, rest, out=np.ones_like(frame), where=rest > 0)
    return np.where(frame < rest, better * share, better + frame - rest)


def touched(frame: np.ndarray, rest: np.ndarray, areas: np.ndarray, share: float) -> np.ndarray:
    """Return which receivers (n,) bool change by at least `share` of the mean light at rest. frame, rest: (n, 3)."""
    still = luminance(rest)
    return np.abs(luminance(frame) - still) >= share * np.average(still, weights=areas)


def print_rows(doc: str, header: str, rows: Callable[[str], Iterable[str]]) -> None:
    """Parse the names of scenes and print a table; `rows` yields the cells of a scene's rows after its name."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    print(f"| scene | photons | {header} |\n{'|---' * (header.count('|') + 3)}|")
    for name in parser.parse_args().scenes:
        for row in rows(name):
            print(f"| {name} | {row} |", flush=True)
