"""Opening of a scene up to its first picture, in a thread: the window goes on drawing.

Missing kernels are compiled in a process of their own, because a compiler holds the interpreter lock for seconds. All
other work runs in one thread. Every kernel is loaded before the solver's thread begins.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from app.rest.static_job import load
from app.settings import Settings, make_solver, open_scene
from app.worker import without_frames

if TYPE_CHECKING:
    from app.draw.picking import Picker
    from gi_core.frames.background import Photons
    from gi_core.scene import Scene
    from gi_core.solver import Solver

IMPORTING, COMPILING, LOADING, TRACING = "importing", "compiling kernels", "loading scene", "tracing"


class Opened(NamedTuple):
    """A scene that has its first picture."""

    settings: Settings  # with every None filled in
    solver: Solver
    meshes: tuple  # one DrawMesh per object
    picker: Picker


class Opening:
    """Runs in a thread: `phase`, `detail` and `fraction` until it is done, then `result` or `problem`."""

    def __init__(
        self, settings: Settings, load: Callable[[Settings], Scene] = open_scene,
        earlier: Callable[[], Photons] | None = None,
    ) -> None:  # fmt: skip
        """earlier: returns the photons of the scene before its last edit; called in this thread."""
        self.settings = settings
        self._load, self._earlier = load, earlier
        self.phase, self.detail = IMPORTING, ""
        self.fraction: float | None = None  # None: unknown
        self.result: Opened | None = None
        self.problem: BaseException | None = None
        self.warnings: list[str] = []
        self._cancelled = False
        self._compiler: subprocess.Popen | None = None
        self._thread = threading.Thread(target=self._run, name="opening", daemon=True)
        self._thread.start()

    @property
    def progress(self) -> tuple[str, float | None]:
        """The phase in words, and the fraction done; None: unknown."""
        return self.phase + (f": {self.detail}" if self.detail else ""), self.fraction

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def cancel(self, patience: float = 1.0) -> None:
        """Stop; wait for its end for at most `patience` seconds."""
        self._cancelled = True
        if self._compiler is not None:
            self._compiler.kill()
        self._thread.join(timeout=patience)

    def _run(self) -> None:
        try:
            from gi_core.instruments import compile_ahead

            self._compile(compile_ahead.DIFFUSE)
            self.phase, self.detail, self.fraction = LOADING, self.settings.scene, None
            scene = self._load(self.settings)
            self._stop_if_cancelled()
            if (surfaces := compile_ahead.surfaces_of(scene)) != compile_ahead.DIFFUSE:
                self._compile(surfaces)
            self.result = self._open(scene)
        except BaseException as problem:  # shown in the window, or raised by the caller
            self.problem = without_frames(problem)

    def _compile(self, surfaces: str) -> None:
        """Compile the kernels for a kind of surfaces, unless they are in the disk cache."""
        import gi_core
        from gi_core.instruments import compile_ahead

        if compile_ahead.is_warm(self.settings.rays, surfaces):
            return
        self.phase, self.fraction = COMPILING, 0.0
        options = [compile_ahead.OF, surfaces]
        options += [compile_ahead.RAYS, self.settings.rays] if self.settings.rays else []
        with tempfile.TemporaryFile("w+") as errors:
            self._compiler = subprocess.Popen(
                [sys.executable, "-m", "gi_core.instruments.compile_ahead", *options],
                cwd=Path(gi_core.__file__).parent.parent,  # for `-m` to find gi_core, installed or not
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
            for line in self._compiler.stdout:
                count, _, self.detail = line.strip().partition(" ")
                done, _, total = count.partition("/")
                if done.isdigit() and total.isdigit() and int(total):
                    self.fraction = int(done) / int(total)
            if self._compiler.wait() and not self._cancelled:
                # Not fatal: the kernels are then compiled at their first use, with a pause.
                errors.seek(0)
                last = (errors.read().strip().splitlines() or [f"exit code {self._compiler.returncode}"])[-1]
                self.warnings.append(f"compiling ahead failed: {last}")
        self._compiler = None

    def _open(self, scene: Scene) -> Opened:
        from app.draw.picking import Picker
        from app.draw.vertex_colours import draw_meshes
        from gi_core.base.kernel_cache import problems

        self.phase, self.detail, self.fraction = LOADING, self.settings.scene, None
        solver = make_solver(scene, self.settings, self._earlier and self._earlier())
        meshes = draw_meshes(solver.surfaces, solver.model.lamp_of_face, solver.model.object_receivers.normals)
        picker = Picker(solver.surfaces, solver.model.origins)
        for _ in load(solver) if solver.light == "best" else ():
            self._stop_if_cancelled()
        self.phase, self.detail = TRACING, ""
        for progress in solver.solve_steps():
            self._stop_if_cancelled()
            self.detail = "" if progress.stage == TRACING else progress.stage
            self.fraction = progress.fraction
            if progress.picture:
                break
        if solver.poses:
            solver.move_all(solver.poses)  # loads the kernels of a drag's frames
        settings = replace(
            self.settings,
            estimator=solver.setting.estimator,
            photons=solver.photons,
            radius=solver.setting.radius,
            neighbours=solver.setting.neighbours,
            light=solver.light,
        )
        self.warnings += problems
        return Opened(settings, solver, meshes, picker)

    def _stop_if_cancelled(self) -> None:
        if self._cancelled:
            raise RuntimeError("cancelled")
