"""Opening of a scene up to its first picture, in a thread: the window goes on drawing.

Missing kernels are compiled in processes of their own, because a compiler holds the interpreter lock for seconds. One
of them shows a first look at the scene meanwhile. All other work runs in one thread. Every kernel is loaded before the
solver's thread begins.
"""

from __future__ import annotations

import pickle
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from app.draw.draw_mesh import DrawMesh, meshes_of
from app.rest.reference_store import StaticStore
from app.session import first_look
from app.session.first_look import FirstLook
from app.settings import Settings, as_asked, make_solver, of_files, read_scene
from app.worker import daemon, without_frames
from gi_core.base.kernel_cache import problems
from gi_core.base.results import Results
from gi_core.files.edits import Versions
from gi_core.instruments import child, compile_ahead
from gi_core.model import Model
from gi_core.scene import Scene
from gi_core.scene.errors import utf8
from gi_core.solver import Solver

LOADING, LIGHTING = "loading scene", "computing the first light"
COMPILING = {  # by kind of surfaces, those of gi_core.instruments.compile_ahead
    "diffuse": "compiling kernels, once per machine",
    "gloss": "compiling kernels for gloss, once per machine",
    "tables": "compiling kernels for reflection models, once per machine",
    **dict.fromkeys(("diffuse-panes", "gloss-panes", "tables-panes"), "compiling kernels for panes, once per machine"),
}


class Opened(NamedTuple):
    """A scene that has its first picture."""

    settings: Settings  # with every None filled in
    solver: Solver
    versions: Versions  # of its scene
    meshes: tuple[DrawMesh, ...]  # one per object


class Before(NamedTuple):
    """A scene on show, as its next edit begins with it."""

    opened: Opened
    results: Callable[[], Results]  # waits for the solver's thread


class Opening:
    """Runs in a thread: `phase`, `detail` and `fraction` until it is done, then `result` or `problem`."""

    def __init__(
        self, settings: Settings, load: Callable[[Settings], Scene] = read_scene, before: Before | None = None
    ) -> None:
        """load: returns the scene without edits; before: the scene on show, of which this is an edit."""
        self.settings = settings
        self._load, self._before = load, before
        self.phase, self.detail = LOADING, self._name
        self.fraction: float | None = None  # None: unknown
        self.result: Opened | None = None
        self.problem: BaseException | None = None
        self.warnings: list[str] = []
        self._cancelled = False
        self.look: FirstLook | None = None  # while kernels compile
        self._refused: Exception | None = None  # the scene, by the process of the first look
        self._thread = daemon("opening", self._run)
        self._thread.start()  # it, and threads that it starts, read this attribute

    @property
    def progress(self) -> tuple[str, float | None]:
        """The phase in words, with the fraction done or the time left; and the fraction, None: unknown."""
        share = "" if self.fraction is None else f"{100 * self.fraction:.0f} %"
        detail = self.detail or share
        return utf8(self.phase + (f": {detail}" if detail else "")), self.fraction

    @property
    def _name(self) -> str:
        """Name of the scene's file, without folders: a path may have thousands of characters."""
        return Path(self.settings.document or self.settings.scene).name

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def cancel(self, patience: float = 1.0) -> None:
        """Stop; wait for its end for at most `patience` seconds."""
        self._cancelled = True
        self._thread.join(timeout=patience)

    def _run(self) -> None:
        try:
            self._compile(compile_ahead.DIFFUSE)
            self.phase, self.detail, self.fraction = LOADING, self._name, None
            versions = self._versions()
            scene = as_asked(versions.last, self.settings)
            self._stop_if_cancelled()
            if (surfaces := compile_ahead.surfaces_of(scene)) != compile_ahead.DIFFUSE:
                self._compile(surfaces)
            self.result = self._open(scene, versions)
        except BaseException as problem:  # shown in the window, or raised by the caller
            self.problem = without_frames(problem)

    def _versions(self) -> Versions:
        """Return the versions of the scene; files are read again only where it is no edit of the scene on show."""
        shown = self._before.opened if self._before is not None else None
        same = shown is not None and of_files(shown.settings) == of_files(self.settings)
        versions = shown.versions if shown is not None and same else Versions({0: self._load(self.settings)})
        return versions.after(self.settings.edits, self.settings.allow_outside)

    def _compile(self, surfaces: str) -> None:
        """Compile the kernels for a kind of surfaces that the disk cache lacks; show a first look meanwhile."""
        if compile_ahead.is_warm(self.settings.rays, surfaces):
            return
        self.phase, self.fraction = COMPILING[surfaces], 0.0
        meter, started = compile_ahead.Meter(surfaces), time.perf_counter()
        options = [compile_ahead.BESIDE_LOOK, compile_ahead.OF, surfaces]
        options += [compile_ahead.RAYS, self.settings.rays] if self.settings.rays else []
        with ExitStack() as ends:
            errors, look_errors = (ends.enter_context(tempfile.TemporaryFile("w+")) for _ in range(2))
            looking = ends.enter_context(child.killed_at_end(first_look.start(self.settings, surfaces, look_errors)))
            compiler = child.start(compile_ahead.__name__, *options, stderr=errors)
            ends.enter_context(child.killed_at_end(compiler))
            threading.Thread(target=self._receive, args=(looking.stdout,), name="first look", daemon=True).start()
            while compiler.poll() is None:
                self._stop_if_cancelled()
                if self._refused is not None:
                    raise self._refused
                self.fraction = meter.fraction
                self.detail = _time_left(time.perf_counter() - started, self.fraction or 0.0)
                time.sleep(0.1)
            if looking.poll() and self._load is read_scene:  # other scenes have no file to look at
                self.warnings.append(f"the first look failed: {_last_line(look_errors, looking.returncode)}")
            if compiler.returncode:
                # Not fatal: the kernels are then compiled at their first use, with a pause.
                self.warnings.append(f"compiling ahead failed: {_last_line(errors, compiler.returncode)}")
        self.detail = ""

    def _receive(self, stream: IO[bytes]) -> None:
        """Take over looks from a process until it ends."""
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while not self.done:
                received = pickle.load(stream)
                if not isinstance(received, Exception):
                    self.look = received
                elif self._load is read_scene:
                    self._refused = received

    def _open(self, scene: Scene, versions: Versions) -> Opened:
        self.phase, self.detail, self.fraction = LOADING, self._name, None
        before = self._before
        solver = make_solver(scene, self.settings, None if before is None else before.results())
        meshes = self._drawn(solver.model)
        static = solver.frame_light.static
        if solver.light == "best" and static.gathered is None:
            static.gathered = StaticStore(solver.model, solver.seed).load()  # shown if it has less error than photons
        self.phase, self.detail = LIGHTING, ""
        for progress in solver.solve_steps():
            self._stop_if_cancelled()
            self.fraction = progress.fraction
            if progress.picture:
                break
        if solver.poses and not (before is not None and before.opened.solver.poses):
            solver.move_all(solver.poses)  # loads the kernels of a drag's frames
        self.warnings += problems
        return Opened(self.settings.with_method_of(solver), solver, versions, meshes)

    def _drawn(self, model: Model) -> tuple[DrawMesh, ...]:
        """Return the draw meshes of a model: those of the scene on show where they are the same."""
        if self._before is None:
            return meshes_of(model)
        meshes, earlier = self._before.opened.meshes, self._before.opened.solver.model
        if model.surfaces is earlier.surfaces and np.array_equal(model.lamp_of_face, earlier.lamp_of_face):
            return meshes
        return meshes_of(model, (earlier, meshes))

    def _stop_if_cancelled(self) -> None:
        if self._cancelled:
            raise RuntimeError("cancelled")


def _last_line(errors: IO[str], code: int) -> str:
    """Return the last line of a process's errors, else its exit code."""
    errors.seek(0)
    return (errors.read().strip().splitlines() or [f"exit code {code}"])[-1]


def _time_left(seconds: float, fraction: float) -> str:
    """Return the time left in words after some seconds; "" while it is unknown."""
    if fraction < 0.05:  # the time left is not known yet
        return ""
    return f"about {max(seconds * (1 - fraction) / fraction, 1):.0f} s left"
