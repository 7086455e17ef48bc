"""Light in a closed room that reflects nearly all: `python -m studies.white_room --reflectance 0.999 --seeds 28`.

The flux that arrives, over the closed form 1 / (1 - rho) of the emitted flux. A path's length has a standard deviation
of sqrt(rho) / (1 - rho), so P photons leave a standard error of sqrt(rho / P).
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from gi_core.solver import Solver
from tests.support.scene_builders import furnace_scene


def arrived(reflectance: float, photons: int, seed: int) -> float:
    """Return the flux that arrives over the closed form."""
    solver = Solver(furnace_scene(1.0, reflectance, 2), "impact_count", photons, radius=0.2, seed=seed)
    solver.solve()
    return float((solver.irradiance[:, 0] * solver.receivers.areas).sum()) * (1 - reflectance) / (6 * math.pi)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reflectance", type=float, default=0.999)
    parser.add_argument("--photons", type=int, default=4000, help="per seed")
    parser.add_argument("--seeds", type=int, default=28)
    asked = parser.parse_args()
    begun, found = time.process_time(), []
    for seed in range(asked.seeds):
        found.append(arrived(asked.reflectance, asked.photons, seed))
    predicted = math.sqrt(asked.reflectance / (asked.photons * asked.seeds))
    print(
        f"arrived / expected {np.mean(found):.4f}, standard error {predicted:.4f} "
        f"(from the seeds {np.std(found, ddof=1) / math.sqrt(len(found)):.4f}), {time.process_time() - begun:.0f} CPU s"
    )


if __name__ == "__main__":
    main()
