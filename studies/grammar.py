"""Scene files by grammar for the loaders: `python -m studies.grammar --cases 5000 [--first 0]`.

`tests.support.grammar` writes them. Each case may use 20 s of computing and 1 GB beyond the imports; warnings are
errors. It must end in a scene that is lit, or in one sentence that names the file. Refusals of valid files are listed.
Linux alone (memory limit, alarm).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

from tests.support.grammar.cases import case, write

SECONDS, MEMORY = 20, 1 << 30
WARM = 40  # cases that compile kernels


def outcome(path: Path) -> str:
    """Load a file and light it by 200 photons; return "lit", or the sentence of its refusal."""
    from gi_core.files.load import load_scene
    from gi_core.scene import SceneError
    from gi_core.solver import Solver

    try:
        scene = load_scene(path, max_edge=float("inf"))
        solver = Solver(scene, photons=200, threads=1)
        solver.solve()
        assert (solver.irradiance >= 0).all(), "irradiance is negative or NaN"
    except SceneError as error:
        text = str(error)
        assert path.name in text and text.isprintable(), f"not a sentence that names the file: {text}"
        return text
    return "lit"


def hang(*_) -> None:
    raise TimeoutError(f"took more than {SECONDS} s")


def peak() -> float:
    """Return the largest resident memory of this process since the last call [MB]."""
    kilobytes = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]
    Path("/proc/self/clear_refs").write_text("5")
    return int(kilobytes) / 1e3


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    counts, worst = Counter(), [0.0, 0.0]
    with tempfile.TemporaryDirectory() as root:
        for seed in range(WARM):  # imports and kernels
            with contextlib.suppress(Exception):
                outcome(write(Path(root) / f"warm {seed}", seed))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        signal.signal(signal.SIGPROF, hang)
        warnings.simplefilter("error")
        for seed in range(options.first, options.first + options.cases):
            path, oddity = write(Path(root) / str(seed), seed), case(seed)[2]
            peak()
            begun = time.process_time()
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            try:
                ended = kind = outcome(path)
                kind = "lit" if ended == "lit" else "refused"
            except Exception:
                ended, kind = traceback.format_exc(), "found"
            signal.setitimer(signal.ITIMER_PROF, 0)
            seconds = time.process_time() - begun
            worst = [max(worst[0], seconds), max(worst[1], peak())]
            counts[path.suffix, kind] += 1
            if kind == "found" or (kind == "refused" and not oddity) or seconds > SECONDS / 4:
                print(f"seed {seed}, oddity {oddity}, {seconds:.1f} s: {ended}", flush=True)
            shutil.rmtree(path.parent)
    print(f"{sum(counts.values())} cases, slowest {worst[0]:.1f} s, largest process {worst[1]:.0f} MB")
    for (suffix, kind), count in sorted(counts.items()):
        print(suffix, kind, count)
    return 1 if any(kind == "found" for _, kind in counts) else 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
