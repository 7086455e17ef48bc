"""Time from an interrupt to the end of the program: `python -m studies.interrupts [--scene cornell] [--after 2 8 20]`.

Starts commands and the window. Presses Ctrl+C (SIGINT to the whole group, as a terminal does) or closes the window.
Prints the time to the end, the exit code, the last lines and files left behind. Exit code 1 if an end took longer
than SOON, had another exit code, or left a partial file. Linux alone.
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
SOON = 3.0  # s, on a busy machine
STOPPED = 130  # exit code of a command; a closed window ends with 0
WINDOW = """
import sys
sys.path.insert(0, {root!r})
from tests.support import viewer_support
if viewer_support.screenless():
    sys.exit(4)
from imgui_bundle import immapp
from app.window import window
from app.settings import Settings
from app.window.viewer import interruptible
from app.window.viewer import Viewer
import time, threading
viewer = Viewer(Settings(scene={scene!r}, photons={photons}, size=(640, 480), light={light!r}))
viewer.params.ini_disable = True
window.prepare()
def now():
    session = viewer.session
    if session.opening or not session.ready:
        return session.opening.progress[0] if session.opening else ""
    if session.light.progress is not None:
        return session.light.progress.stage
    gathered = session.light._solver.frame_light.static.gathered
    return "at rest" if gathered is None or gathered.enough else "gathering"
def close():
    while viewer.clock.frames < {frames} or {doing!r} not in ("", now()):
        time.sleep(0.001)
    doing = now()
    print(time.time(), doing, flush=True)
    if {closes}:
        viewer.params.app_shall_exit = True
threading.Thread(target=close, daemon=True).start()
with interruptible(viewer):
    immapp.run(viewer.params)
"""


def commands(scene: str) -> dict[str, list[str]]:
    """Return the commands to interrupt: all that take more than a moment."""
    many, few = ["--photons", "20000000"], ["--photons", "5000"]
    return {
        "render": ["render", scene, "--out", "a.png", *many],
        "render --frames": ["render", scene, "--out", "b.png", "--frames", "500", *few],
        "render gathered": ["render", scene, "--out", "c.png", "--light", "best"],
        "bench": ["bench", scene, *many],
        "chart": ["chart", scene, "--quick", "--frames", "2", "--out", "chart"],
        "reference": ["reference", scene, "--error", "0.1"],
        "atlas": ["atlas", "--out", "atlas"],
    }


def started(command: list[str], folder: str) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "GI_VIEWER_REFERENCE_DIR": str(Path(folder) / "references")}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, **pipes)


def ended(name: str, process: subprocess.Popen, since: float, code: int) -> bool:
    """Wait for the end and print it; return whether it was as required."""
    try:
        _, err = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        process.kill()
        print(f"{name}: DID NOT END in 60 s", flush=True)
        return False
    seconds, text = time.time() - since, err.decode().strip().splitlines()
    good = seconds < SOON and process.returncode == code and len(text) == int(code == STOPPED)
    line = f"{name}: {seconds:.2f} s, exit code {process.returncode}, {' / '.join(text[-2:]) or 'not a word'}"
    print(line + ("" if good else "  WRONG"), flush=True)
    return good


def interrupted(name: str, command: list[str], after: float, folder: str) -> bool:
    process = started([sys.executable, "-m", "app", *command], folder)
    time.sleep(after)
    if process.poll() is not None:
        good = process.returncode == 0
        print(f"{name}: had ended by itself{'' if good else '  WRONG: ' + process.communicate()[1].decode()[-300:]}")
        return good
    since = time.time()
    os.killpg(process.pid, signal.SIGINT)
    return ended(f"{name}, Ctrl+C after {after:g} s", process, since, STOPPED)


def closed(scene: str, frames: int, doing: str, closes: bool, folder: str) -> bool:
    """Open a window and end it after a number of frames, while it works, by its button or by Ctrl+C."""
    gathers = doing == "gathering"
    what = {"light": "best" if gathers else "photons", "photons": 20_000 if gathers else 2_000_000}
    code = WINDOW.format(root=str(ROOT), scene=scene, frames=frames, doing=doing, closes=closes, **what)
    process = started([sys.executable, "-c", code], folder)
    when, _, found = process.stdout.readline().decode().strip().partition(" ")
    how = "closed" if closes else "Ctrl+C"
    if not closes:
        os.killpg(process.pid, signal.SIGINT)
    return ended(f"window, {how} after {frames} frames ({found})", process, float(when or time.time()), 0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="cornell")
    parser.add_argument("--after", type=float, nargs="*", default=[1.0, 4.0, 10.0, 30.0], help="seconds before Ctrl+C")
    parser.add_argument("--only", nargs="*", help="names of commands, or `window`")
    options = parser.parse_args()
    chosen = {n: c for n, c in commands(options.scene).items() if not options.only or n in options.only}
    good = True
    with tempfile.TemporaryDirectory() as folder:
        for after in options.after:
            for name, command in chosen.items():
                good &= interrupted(name, command, after, folder)
        moments = (2, ""), (60, ""), (200, ""), (0, "tracing: indexing"), (0, "tracing"), (0, "gathering")
        for frames, doing in moments if not options.only or "window" in options.only else ():
            for closes in (True, False):
                good &= closed(options.scene, frames, doing, closes, folder)
        left = sorted(str(p.relative_to(folder)) for p in Path(folder).rglob("*") if p.is_file())
        half = [p for p in left if p.endswith(".part")]
        print(f"{len(left)} files left; not whole: {half}", flush=True)
    return int(not good or bool(half))


if __name__ == "__main__":
    sys.exit(main())
