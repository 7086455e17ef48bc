"""Modules between a pose and its pixels: `python -m studies.hops [SCENE]`.

A window without a screen drags a mobile. All threads are profiled through one frame of the drag. A module counts if one
of its functions runs: in the whole frame, and on the path from the cursor to the pixels alone (PATH). A profile misses
kernels called by kernels, so a kernel also counts if a function that ran, or such a kernel, calls it by name.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

ROOT = Path(__file__).resolve().parents[1]
INSIDE = (f"{ROOT}/app/", f"{ROOT}/gi_core/")
PANEL = "app/window/panel/"
WINDOW = "MainThread"
PHOTONS = 65_536
FRAMES = 6  # of the drag; the last one counts
PATIENCE = 60.0  # s for the move of one frame: a profiled one is slow


class Profile:
    """Functions of the program that ran while `on`, by thread: of the whole frame, and on the path alone."""

    def __init__(self) -> None:
        self.on = False
        self.roots: frozenset[CodeType] = frozenset()  # functions of the window's thread that the path begins with
        self.clear()

    def clear(self) -> None:
        self.frame: dict[str, dict[CodeType, dict]] = {}  # thread -> code -> its global names
        self.path: dict[str, dict[CodeType, dict]] = {}
        self._depth = 0  # of roots that the window's thread is in

    def __call__(self, frame, event: str, argument) -> None:
        code = frame.f_code
        if not self.on or event not in ("call", "return") or not code.co_filename.startswith(INSIDE):
            return
        thread = threading.current_thread().name
        if code in self.roots and thread == WINDOW:
            self._depth += 1 if event == "call" else -1
        self.frame.setdefault(thread, {})[code] = frame.f_globals
        if thread != WINDOW or self._depth:
            self.path.setdefault(thread, {})[code] = frame.f_globals


def modules(ran: dict[CodeType, dict]) -> set[str]:
    """Return the files of functions."""
    return {code.co_filename.removeprefix(f"{ROOT}/") for code in ran}


def kernels(ran: dict[CodeType, dict]) -> dict[CodeType, dict]:
    """Return the compiled functions that functions call by name, directly or not."""
    out: dict[CodeType, dict] = {}
    seen: set[CodeType] = set()
    todo = list(ran.items())
    while todo:
        code, names = todo.pop()
        if code in seen:
            continue
        seen.add(code)
        todo += [(c, names) for c in code.co_consts if isinstance(c, CodeType)]
        found = [names[n] for n in code.co_names if n in names]
        found += [getattr(m, n) for m in found if isinstance(m, ModuleType) for n in code.co_names if hasattr(m, n)]
        for kernel in (getattr(f, "py_func", None) for f in found):
            if isinstance(kernel, FunctionType) and kernel.__code__.co_filename.startswith(INSIDE):
                out[kernel.__code__] = kernel.__globals__
                todo.append((kernel.__code__, kernel.__globals__))
    return out


def dragged_frame(scene: str) -> tuple[dict, dict]:
    """Drag the first mobile in a window without a screen; return the functions of the last frame, and of its path."""
    from tests.support import viewer_support as support

    if reason := support.screenless():
        raise SystemExit(reason)
    profile = Profile()
    threading.setprofile(profile)
    sys.setprofile(profile)
    from app.session.opening import Opening
    from app.settings import Settings
    from app.window.drag import MobileDrag
    from app.window.viewer import Viewer
    from app.window.viewport import Viewport
    from tests.support.viewer_hand import Hand

    profile.roots = frozenset((MobileDrag.follow.__code__, Viewport.draw.__code__))
    viewer = Viewer(Settings(scene=scene, photons=PHOTONS, measure_errors=False, size=(960, 640)), Opening)
    frame, show = viewer.params.callbacks.show_gui, viewer.params.callbacks.after_swap
    versions: list[int] = []  # of the light after each frame of the drag
    kept: list[tuple] = []  # the profile of each frame of the drag that has new light

    def begin() -> None:
        profile.clear()
        profile.on = viewer._ready and viewer.session.motion.dragging
        frame()

    def end() -> None:
        show()
        if profile.on:
            profile.on = False
            versions.append(viewer.session.version)
            if len(versions) > 1 and versions[-1] != versions[-2]:
                kept.append((profile.frame, profile.path))

    viewer.params.callbacks.show_gui, viewer.params.callbacks.after_swap = begin, end
    failed = []

    def script(ctx) -> None:
        try:
            hand = Hand(viewer, ctx)
            hand.wait_for_light()
            x, y = hand.at(viewer.session.model.vertices_at(1, viewer.session.poses).mean(axis=0))
            hand.move((x, y))
            viewer.session.light.grace = PATIENCE
            ctx.mouse_down(0)
            hand.move((x + 10, y))
            assert viewer.viewport.mobile_drag.grab is not None, f"no mobile at {(x, y)}"
            steps = 0
            while len(kept) < FRAMES:
                steps += 1
                assert steps < 10 * FRAMES, f"no new light: versions {versions}"
                hand.move((x + 10 + 30 * (steps % 2), y))
            ctx.mouse_up(0)
            ctx.yield_(2)
        except BaseException as problem:
            failed.append(problem)

    support.drive(viewer, script, quits=True)
    sys.setprofile(None)
    threading.setprofile(None)
    if failed:
        raise failed[0]
    return kept[FRAMES - 1]


def hops(scene: str, verbose: bool = False) -> dict[str, set[str]]:
    """Return the files of the whole frame, and of its path, without the panel's."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CONFIG_HOME"] = os.environ["GI_VIEWER_REFERENCE_DIR"] = folder
        measured = dict(zip(("frame", "path"), dragged_frame(scene), strict=True))
    out = {}
    for name, threads in measured.items():
        ran = {code: names for codes in threads.values() for code, names in codes.items()}
        alone = modules(kernels(ran)) - modules(ran)
        out[name] = {f for f in modules(ran) | alone if not f.startswith(PANEL)}
        if verbose:
            for thread, codes in sorted(threads.items()):
                print(f"{name}, {thread}: {len(modules(codes))}\n  " + "\n  ".join(sorted(modules(codes))))
            print(f"{name}, kernels that no profile shows: {len(alone)}\n  " + "\n  ".join(sorted(alone)))
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="cornell")
    for name, files in hops(parser.parse_args().scene, verbose=True).items():
        lines = sum(len((ROOT / f).read_text(encoding="utf-8").splitlines()) for f in files)
        print(f"{name}: {len(files)} modules without the panel, of {lines} lines")
    return 0


if __name__ == "__main__":
    sys.exit(main())
