"""How soon the program ends when told to: `python -m tests.interrupts [--scene cornell]`.

Starts commands and the window, lets each begin, sends Ctrl+C (SIGINT) or closes the window, and prints how long it
takes to end, with which exit code, what it said, and what it left behind. Linux alone.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WINDOW = """
import sys
sys.path.insert(0, {tests!r})
import viewer_support
reason = viewer_support.screenless()
if reason:
    sys.exit(4)
from imgui_bundle import immapp
from app import window
from app.settings import Settings
from app.viewer import Viewer
import time, threading
viewer = Viewer(Settings(scene={scene!r}, photons=2_000_000, size=(640, 480)))
viewer.params.ini_disable = True
window.prepare()
def close():
    while viewer.frames < {frames}:
        time.sleep(0.05)
    print("closing", time.time(), flush=True)
    viewer.params.app_shall_exit = True
threading.Thread(target=close, daemon=True).start()
immapp.run(viewer.params)
"""


def ended(process: subprocess.Popen, since: float) -> str:
    try:
        out, err = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        process.kill()
        return "did not end in 60 s"
    text = err.decode().strip().splitlines()
    return f"{time.time() - since:.2f} s, exit code {process.returncode}, {len(text)} lines: {text[-1:]}"


def interrupted(command: list[str], after: float, folder: str) -> str:
    """Run a command, interrupt it, and tell how it ended."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment)
    time.sleep(after)
    if process.poll() is not None:
        return f"had ended by itself: {process.communicate()[1].decode()[-300:]}"
    since = time.time()
    process.send_signal(signal.SIGINT)
    return ended(process, since)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="cornell")
    parser.add_argument("--after", type=float, nargs="*", default=[1.0, 4.0, 10.0], help="seconds before Ctrl+C")
    options = parser.parse_args()
    run = [sys.executable, "-m", "app"]
    many = ["--photons", "20000000"]
    with tempfile.TemporaryDirectory() as folder:
        for after in options.after:
            for name, command in {
                "render": [*run, "render", options.scene, "--out", "a.png", *many],
                "render --frames": [
                    *run,
                    "render",
                    options.scene,
                    "--out",
                    "b.png",
                    "--frames",
                    "500",
                    "--photons",
                    "5000",
                ],
                "bench": [*run, "bench", options.scene, *many],
                "bench --sweep": [*run, "bench", options.scene, "--sweep", "--out", "s"],
                "atlas": [*run, "atlas", "--out", "atlas"],
            }.items():
                print(f"{name}, Ctrl+C after {after:g} s: {interrupted(command, after, folder)}", flush=True)
        left = sorted(str(p.relative_to(folder)) for p in Path(folder).rglob("*") if p.is_file())
        print(f"{len(left)} files left; not whole: {[p for p in left if p.endswith('.part')]}", flush=True)
        for frames in (2, 60, 200):
            code = WINDOW.format(tests=str(ROOT / "tests"), scene=options.scene, frames=frames)
            process = subprocess.Popen(
                [sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )
            line = process.stdout.readline().split()
            since = float(line[1]) if len(line) == 2 else time.time()
            print(f"window closed after {frames} frames: {ended(process, since)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
