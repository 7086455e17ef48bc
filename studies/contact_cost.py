"""Cost of contact: the time that frames spend on regions shortened by other objects.

    python -m studies.contact_cost living_room --photons 100000 --frames 40

Each pose of the walk is computed twice in a row, with contact and without, in alternating order.
Other load on the machine then affects both alike.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from app.draw import motion
from app.settings import STEP_PER_FRAME, Settings, make_solver, open_moving_scene
from gi_core.discs.stale_receivers import ContactDiscs
from gi_core.solver import Solver


@contextmanager
def without_contact(solver: Solver) -> Iterator[None]:
    """Compute frames meanwhile with the region of each object alone."""
    estimate = solver.frame.background.estimate
    kept, discs = estimate._contact, [s.discs for s in estimate.searches]
    estimate._contact = ContactDiscs(estimate.model, estimate.radius, discs, False)
    try:
        yield
    finally:
        estimate._contact = kept


def measure(solver: Solver, frames: int) -> dict[str, float]:
    """Return medians: ms and CPU ms per frame with contact and without, receivers in contact on each side."""
    lap, taken = motion.walk(motion.paths_of(solver), STEP_PER_FRAME * solver.scene_size, frames), defaultdict(list)

    def frame(name: str, k: int) -> None:
        # Contacts of the current poses are cached: a frame elsewhere empties the cache.
        solver.move_all(lap[(k - 1) % frames])
        clock, cpu = time.perf_counter(), time.process_time()
        solver.move_all(lap[k])
        taken[f"{name} CPU"].append(1e3 * (time.process_time() - cpu))
        taken[name].append(1e3 * (time.perf_counter() - clock))

    for k in range(frames):
        for contact in (True, False) if k % 2 else (False, True):
            if contact:
                frame("with", k)
                taken["static"].append(solver.frame.control_facts.stale)
                taken["on mobiles"].append(solver.frame.control_facts.on_mobiles)
            else:
                with without_contact(solver):
                    frame("without", k)
    return {name: float(np.median(values)) for name, values in taken.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scene")
    parser.add_argument("--photons", type=int, default=100_000)
    parser.add_argument("--frames", type=int, default=40)
    arguments = parser.parse_args()
    settings = Settings(arguments.scene, photons=arguments.photons, light="photons")
    solver = make_solver(open_moving_scene(settings), settings)
    solver.solve()
    found = measure(solver, arguments.frames)
    print(f"in contact: {found['static']:,.0f} static receivers, {found['on mobiles']:,.0f} on mobiles")
    for name in ("without", "with"):
        print(f"{name:<8}{found[name]:8.2f} ms per frame, CPU {found[f'{name} CPU']:8.2f} ms")


if __name__ == "__main__":
    main()
