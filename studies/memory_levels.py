"""Memory at equal settings over time: `python -m studies.memory_levels [--cycles 20] [--scene cornell]`.

A session without a window is dragged, switched to other estimators, radii and photons, and loaded again every fourth
cycle. Then it returns to its first settings, and memory is measured. Exit code 1 if memory in use inside malloc
exceeds its level after WARM cycles, when kernels and references are loaded. Linux alone.
"""

from __future__ import annotations

import argparse
import gc
import os
import random
import sys
import tempfile
import threading
import time
from dataclasses import replace

from tests.support.memory_use import memory_use, trim

WARM = 5  # cycles
ALLOWED = 0.1  # of the level after WARM cycles
FRAME = 1 / 60


def rest(session, seconds: float = 0.0) -> None:
    """Complete the light and run work at rest for a while."""
    end = time.monotonic() + seconds
    while session.refining or time.monotonic() < end:
        session.tick(FRAME)
        time.sleep(0.001)


def use(session, rng: random.Random, base) -> None:
    """Drag everything about and set something else, a few times over."""
    from gi_core.estimators import ESTIMATORS
    from gi_core.scene import Pose

    for _ in range(6):
        session.begin_drag()
        chosen = session.chosen
        for _ in range(5):
            where = tuple(rng.uniform(a, b) for a, b in zip(chosen.low, chosen.high, strict=True))
            session.move({name: Pose(where) for name in session.poses})
            session.tick(FRAME)
        session.end_drag()
        estimator = rng.choice(list(ESTIMATORS))
        radius = session.chosen.scene_size * rng.choice([0.005, 0.01, 0.02, 0.04])
        photons = rng.choice([20_000, 50_000, 100_000])
        session.want(replace(base, estimator=estimator, radius=radius, photons=photons))
        rest(session, 0.5)


def loaded_again(session, reload):
    """Return the session that takes the place of this one."""
    reload.again(session)
    while (new := reload.tick(session)) is None:
        assert not reload.problem, reload.problem
        session.tick(FRAME)
        time.sleep(0.005)
    session.close(0.0)
    return new


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="cornell")
    parser.add_argument("--cycles", type=int, default=20)
    options = parser.parse_args()
    from app.session.log import Log
    from app.session.opening import Opening
    from app.session.reload import Reload
    from app.session.session import Session
    from app.settings import Settings

    rng, held, begun = random.Random(0), [], time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GI_VIEWER_REFERENCE_DIR"] = folder
        session, reload = Session(Settings(options.scene, photons=20_000, exposure=0.0), Log()), Reload(Opening)
        while not session.ready:
            session.tick(FRAME)
            time.sleep(0.01)
        rest(session)
        base = session.settings
        for cycle in range(1, options.cycles + 1):
            use(session, rng, base)
            if cycle % 4 == 0:
                session = loaded_again(session, reload)
            session.reset_poses()
            session.want(base)
            rest(session, 1.0)
            gc.collect()
            before = memory_use()
            trim()
            held.append(before.held)
            text = f"cycle {cycle}, {time.monotonic() - begun:.0f} s: {before}; trimmed {memory_use().resident:.1f} MB"
            print(f"{text}; {threading.active_count()} threads", flush=True)
        session.close()
    late, warm = sum(held[-WARM:]) / WARM, sum(held[WARM : 2 * WARM]) / WARM
    print(f"held: {warm:.1f} MB in cycles {WARM + 1} to {2 * WARM}, {late:.1f} in the last {WARM}")
    return int(late > (1 + ALLOWED) * warm)


if __name__ == "__main__":
    sys.exit(main())
