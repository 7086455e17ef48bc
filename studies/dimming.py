"""Time from a lamp's slider to new irradiance: `python -m studies.dimming [SCENE] [--max-edge M] [--light best]`.

Levels alternate, so that no frame is one that was computed before. CPU seconds count all threads.
"""

from __future__ import annotations

import argparse
import statistics
import time

from app.settings import Settings, make_solver, open_scene

FRAMES, BUDGET = 40, 0.016  # [s] per frame, of the window


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gallery")
    parser.add_argument("--max-edge", type=float)
    parser.add_argument("--light", default="photons", choices=("photons", "best"))
    given = parser.parse_args()
    settings = Settings(scene=given.scene, max_edge=given.max_edge, light=given.light)
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    names, found = solver.lamps.names, {}
    for k in range(FRAMES):
        begun, cpu = time.perf_counter(), time.process_time()
        paths = solver.size_within(BUDGET)[1] if given.light == "best" else None
        solver.set_lamps({names[k % len(names)]: 0.3 + 0.6 * (k % 2)}, paths)
        stages = {"whole": time.perf_counter() - begun, "CPU": time.process_time() - cpu, **solver.frame.timings}
        for stage, seconds in stages.items():
            found.setdefault(stage, []).append(seconds)
    print(f"{given.scene}: {len(solver.irradiance):,} receivers, {len(names)} lamps, {solver.frame.photons:,} photons")
    for stage, seconds in found.items():
        print(f"  {stage:9} median {1e3 * statistics.median(seconds):6.2f} ms, least {1e3 * min(seconds):6.2f} ms")


if __name__ == "__main__":
    main()
