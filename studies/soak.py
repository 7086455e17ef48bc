"""Hours of use in minutes: `python -m studies.soak --minutes 5 [--scene cornell] [--fresh] [--json FILE]`.

A window without a screen repeats a user's actions at full speed: drags, turns, play, undo, switches of estimator,
radius and photons, resizes, panel folds, loads. Memory, memory in use inside malloc, and frames are recorded every few
seconds. Exit code 1 in three cases: memory grows in the second half after a minute of warm-up; the log has an error;
the last light differs from a solution from scratch. Linux alone (it reads /proc).
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import random
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.support.memory_use import memory_use, trim

EVERY = 5.0  # s between notes
FRESH_REST = 45.0  # s at rest before anything else, with --fresh: longer than twice the pause between two saves
WARM_UP = 60.0  # s in which settings, sizes and loads occur for the first time and malloc finds its level
SETTLED = 0.5  # share of the time after the warm-up, after which memory must not grow
ALLOWED = 0.03  # of it, that memory may differ by afterwards, or ...
LEAST = 25.0  # MB


def act(rng: random.Random, viewer, hand_over: dict) -> str:
    """Perform one random action of a user; return its name."""
    from gi_core.estimators import ESTIMATORS

    session = viewer.session
    solver = session.light._solver
    name = rng.choice(list(session.poses)) if session.poses else None
    what = rng.choices(
        (
            "drag",
            "turn",
            "play",
            "undo",
            "redo",
            "reset",
            "setting",
            "look",
            "resize",
            "panel",
            "camera",
            "still",
            "load",
        ),
        (40, 8, 6, 6, 3, 3, 10, 5, 3, 2, 6, 8, 3),
    )[0]
    if what in ("drag", "turn") and name:
        low, high = solver.chosen.low, solver.chosen.high
        pose = session.poses[name]
        session.begin_drag()
        target = np.array([rng.uniform(a, b) for a, b in zip(low, high, strict=True)])
        hand_over["drag"] = (name, np.array(pose.position), target, pose, 20, what)
    elif what == "setting":
        key, value = rng.choice(
            [
                ("estimator", rng.choice(list(ESTIMATORS))),
                ("radius", solver.scene_size * rng.choice([0.005, 0.01, 0.02, 0.04])),
                ("photons", rng.choice([20_000, 50_000, 100_000])),
                ("neighbours", rng.choice([10, 50, 200])),
                ("control", rng.random() < 0.5),
            ]
        )
        session.want(replace(session.settings, **{key: value}))
    elif what == "look":
        session.want(replace(session.settings, show=rng.choice(["radiance", "irradiance"]), cull=rng.random() < 0.5))
    elif what == "resize":
        import glfw

        window = glfw.get_current_context()
        if window:
            glfw.set_window_size(window, rng.randint(200, 1600), rng.randint(150, 1000))
    else:
        actions = {"reset": "reset all", "panel": "toggle panel", "load": "reload"}
        if what in (*actions, "play", "undo", "redo"):
            viewer._do(actions.get(what, what))
        elif what == "camera":
            viewer._do(rng.choice(["reset view", "meter"]))
    return what


def go_on(viewer, hand_over: dict) -> None:
    """Take a drag one frame further."""
    from gi_core.scene import Pose
    from gi_core.scene.pose import axis_angle

    name, start, end, pose, left, what = hand_over["drag"]
    t = 1 - (left - 1) / 20
    if what == "turn":
        moved = Pose(tuple(start), axis_angle((0, 1, 0), 360 * t))
    else:
        moved = Pose(tuple(start + t * (end - start)), pose.quaternion)
    viewer.session.move({name: moved})
    if left == 1:
        viewer.session.end_drag(keep=True)
        del hand_over["drag"]
    else:
        hand_over["drag"] = (name, start, end, pose, left - 1, what)


class Soak:
    """Called once per frame by the viewer's loop."""

    def __init__(self, viewer, minutes: float, seed: int, at_rest: float) -> None:
        """`at_rest`: seconds before the first action."""
        self.viewer, self.seconds, self.at_rest = viewer, 60 * minutes, at_rest
        self.rng, self.hand = random.Random(seed), {}
        self.begun: float | None = None
        self.noted, self.wait = 0.0, 0
        self.counts: dict[str, int] = {}
        self.notes: list[tuple[float, float, float, int]] = []  # seconds, MB resident, of them held, frames
        self.wrong: str | None = None
        self.frame = viewer._begin_frame
        viewer.params.callbacks.show_gui = self

    def __call__(self) -> None:
        self.frame()
        viewer = self.viewer
        viewer.params.app_shall_exit |= self.wrong is not None
        if not viewer._ready or self.wrong:
            return
        now = time.monotonic()
        self.begun = self.begun or now
        if viewer.log.last is not None and viewer.log.last.level == "error":
            self.wrong = viewer.log.last.text
        if self.hand:
            go_on(viewer, self.hand)
        elif now - self.begun > self.seconds:
            self._finish()
        elif now - self.begun < self.at_rest:
            pass
        elif self.wait:
            self.wait -= 1
        else:
            what = act(self.rng, viewer, self.hand)
            self.counts[what] = self.counts.get(what, 0) + 1
            self.wait = self.rng.choice((0, 0, 1, 5)) if what != "still" else 40
        if now - self.noted > EVERY:
            self.noted = now
            use = memory_use()
            self.notes.append(
                (round(now - self.begun, 1), round(use.resident, 1), round(use.held, 1), viewer.clock.frames)
            )
            print(f"{self.notes[-1][0]:.0f} s, frame {viewer.clock.frames}: {use}", flush=True)

    def _finish(self) -> None:
        """Come to rest, compare with a solution from scratch, close."""
        session = self.viewer.session
        if session.motion.playing:
            session.toggle_play()
        if session.refining or session.light.busy or self.viewer.reload.coming is not None:
            return
        if not np.array_equal(session.irradiance, session.light._solver.from_scratch()):
            self.wrong = "light at the end is not that of a solution from scratch"
        self.viewer.params.app_shall_exit = True


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--scene", default="cornell")
    parser.add_argument(
        "--mobile", action="append", default=[], help="file of a thing to move, besides the scene's own"
    )
    parser.add_argument("--photons", type=int, default=50_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument(
        "--fresh", choices=["store", "all"], nargs="?", const="store",
        help="begin with an empty reference store, or with an empty kernel cache too, and with a long rest",
    )  # fmt: skip
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CONFIG_HOME"] = folder
        if options.fresh:
            os.environ["GI_VIEWER_REFERENCE_DIR"] = f"{folder}/references"
        if options.fresh == "all":
            os.environ["NUMBA_CACHE_DIR"] = f"{folder}/kernels"
        return run(options)


def run(options: argparse.Namespace) -> int:
    """Run the viewer, print the records, return the exit code."""
    from tests.support import viewer_support

    reason = viewer_support.screenless()
    if reason:
        print(f"no window can be opened: {reason}", file=sys.stderr)
        return 4
    from imgui_bundle import immapp

    from app.settings import Settings
    from app.window import window
    from app.window.viewer import Viewer

    mobiles = tuple(options.mobile)
    viewer = Viewer(Settings(scene=options.scene, mobiles=mobiles, photons=options.photons, size=(800, 600)))
    viewer.may_sleep = False
    viewer.params.ini_disable = True
    viewer.params.app_window_params.restore_previous_geometry = False
    soak = Soak(viewer, options.minutes, options.seed, FRESH_REST if options.fresh else 0.0)
    window.prepare()
    immapp.run(viewer.params)
    gc.collect()
    trim()
    level, growth = settled(soak.notes, soak.seconds)
    result = {
        "scene": options.scene, "minutes": options.minutes, "frames": viewer.clock.frames, "actions": soak.counts,
        "resident MB": [n[1] for n in soak.notes], "held MB": [n[2] for n in soak.notes],
        "growth in the second half MB": round(growth, 1), "after trimming": str(memory_use()),
        "threads at the end": threading.active_count(), "wrong": soak.wrong,
    }  # fmt: skip
    print(json.dumps(result, indent=1))
    if options.json:
        options.json.write_text(json.dumps(result) + "\n")
    return int(bool(soak.wrong) or growth > max(ALLOWED * level, LEAST))


def settled(notes: list[tuple], seconds: float) -> tuple[float, float]:
    """Return resident memory [MB] in the first third of the settled time, and its growth to the last third.

    notes: (s, resident MB, ...) of a run of `seconds`.
    """
    begin = WARM_UP + SETTLED * (seconds - WARM_UP)
    late = [mb for s, mb, *_ in notes if s > begin] or [0.0]
    third = max(len(late) // 3, 1)
    level = float(np.mean(late[:third]))
    return level, float(np.mean(late[-third:])) - level


if __name__ == "__main__":
    sys.exit(main())
