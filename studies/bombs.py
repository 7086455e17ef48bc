"""Time and memory of small files that ask for much: `python -m studies.bombs [NAME ...]`. Linux alone (fork)."""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path

from tests.support.bombs import ALL
from tests.support.mesh_writers import write_scene

SECONDS, MEMORY = 120, 8 << 30


def main() -> int:
    from gi_core.files.load import load_scene
    from gi_core.scene import SceneError

    load_scene(write_scene(Path(tempfile.mkdtemp())))  # imports and kernels
    for name in sys.argv[1:] or ALL:
        with tempfile.TemporaryDirectory() as folder:
            if not os.fork():  # writing takes memory too: in a separate process
                ALL[name](Path(folder))
                os._exit(0)
            os.wait()
            path = next(p for p in Path(folder).iterdir() if p.stem == "bomb" and p.suffix != ".mtl")
            if not os.fork():
                signal.alarm(SECONDS)
                resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
                begun, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
                try:
                    ended = f"loaded, {len(load_scene(path, max_edge=float('inf')).static.faces):,} triangles"
                except SceneError as error:
                    ended = str(error)
                except BaseException as error:
                    ended = f"FOUND {type(error).__name__}: {error}"
                after = resource.getrusage(resource.RUSAGE_SELF)
                cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
                peak = (after.ru_maxrss - before.ru_maxrss) / 1e3
                cost = f"{time.monotonic() - begun:.1f} s ({cpu:.1f} CPU s), {peak:.0f} MB"
                print(f"{name}: {path.stat().st_size / 1e3:.0f} kB, {cost}; {ended[:200]}", flush=True)
                os._exit(0)
            if code := os.wait()[1]:
                print(f"{name}: ended by signal {code & 127} after {SECONDS} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
