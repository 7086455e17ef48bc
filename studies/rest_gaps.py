"""Work at rest that a drag must wait for: `python -m studies.rest_gaps cornell office --seconds 60`.

Work at rest looks at the stop flag between tasks and within frames. One line per kind of task: its number, and wall ms
between two looks at the flag, in the median, at the 99th percentile and at most. The last line is the wait of a drag
that begins at a random moment: mean, 99th percentile, most. Run it alone on the machine. The first task of a kind sets
up arrays once per scene, and after a change of kernels loads them.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time

import numpy as np

from app.rest.scheduler import RestWork
from app.settings import Settings, make_solver, open_scene
from gi_core.base.pause import breaking_off


def wait_quantile(gaps: np.ndarray, q: float) -> float:
    """Return the quantile of the time left of the gap that a random moment meets, in the unit of gaps (n,)."""
    low, high = 0.0, float(gaps.max())
    for _ in range(40):
        wait = 0.5 * (low + high)
        longer = np.maximum(gaps - wait, 0.0).sum() > (1 - q) * gaps.sum()
        low, high = (wait, high) if longer else (low, wait)
    return high


def measure(scene: str, seconds: float, photons: int | None) -> None:
    settings = Settings(scene=scene, light="best", photons=photons)
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    gaps: list[float] = []
    looked = [0.0]

    def look() -> bool:
        now = time.perf_counter()
        gaps.append(now - looked[0])
        looked[0] = now
        return False

    work, found = RestWork(solver, time.perf_counter), {}
    begun = time.perf_counter()
    while time.perf_counter() - begun < seconds and (task := work.next_task(settings)) is not None:
        looked[0], frame = time.perf_counter(), solver.frame
        with breaking_off(look):
            task.run()
        look()
        stage = " with a frame" if solver.frame is not frame else ""
        found.setdefault(task.name + stage, []).extend(gaps)
        gaps.clear()
    every = 1e3 * np.array([gap for each in found.values() for gap in each])
    print(f"{scene}: {len(solver.irradiance):,} receivers, {solver.frame.photons:,} photons")
    for name, each in sorted(found.items()):
        ms = 1e3 * np.array(each)
        print(f"  {name:50} {len(ms):6}   {np.median(ms):5.1f}   {np.quantile(ms, 0.99):5.1f}   {ms.max():5.1f}")
    mean, most = 0.5 * (every**2).sum() / every.sum(), every.max()
    print(f"  {'a drag waits':50} {len(every):6}   {mean:5.1f}   {wait_quantile(every, 0.99):5.1f}   {most:5.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--seconds", type=float, default=60.0, help="at rest")
    parser.add_argument("--photons", type=int)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GI_VIEWER_REFERENCE_DIR"] = folder  # nothing is known from before
        for scene in asked.scenes:
            measure(scene, asked.seconds, asked.photons)


if __name__ == "__main__":
    main()
