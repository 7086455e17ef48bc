"""Shared by the viewer tests: a small scene from arrays, GL without a screen, a viewer driven by a script."""

import functools
import math
import os
import signal
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.session.opening import Opening
from app.settings import Settings
from gi_core.base import vectors
from gi_core.base.pause import Progress, pause
from gi_core.display.dilation import Drawn
from gi_core.frames.light_setting import FrameSize
from gi_core.lights.lamps import Lamps
from gi_core.scene import Camera, KeyFrames, Material, Mobile, Pose, Probe, Scene
from tests.support.scene_builders import box, merge, quad

ROOT = Path(__file__).resolve().parents[2]


def room(n: int = 8) -> Scene:
    """A closed room 1 m wide, y up: red left wall, green right wall, a lamp, a box to drag along a path."""
    walls = box((0, 0, 0), (1, 1, 1), n, inward=True)
    walls.face_material[: 4 * n * n] = np.repeat([2, 1], 2 * n * n)
    lamp = quad((0.35, 0.995, 0.35), (0.3, 0, 0), (0, 0, 0.3), material=3)
    materials = (
        Material("white", (0.73, 0.73, 0.73)),
        Material("red", (0.6, 0.06, 0.05)),
        Material("green", (0.12, 0.45, 0.1)),
        Material("lamp", (0.0, 0.0, 0.0), (15.0, 14.0, 11.0)),
    )
    pose = Pose((0.5, 0.3, 0.5))
    path = KeyFrames(np.array([0.0, 2.0]), np.array([[0.3, 0.3, 0.5], [0.7, 0.3, 0.5]]), np.array([[1.0, 0, 0, 0]] * 2))
    block = Mobile("block", box((-0.12,) * 3, (0.12,) * 3, 4), pose, path)
    return Scene(
        merge(walls, lamp),
        materials,
        (block,),
        probes=(Probe("desk", (0.5, 0.01, 0.5), (0.0, 1.0, 0.0)),),
        camera=Camera((0.5, 0.55, 2.9), (0.5, 0.45, 0.5), 38.0),
        name="room",
        notes=("made for the tests",),
    )


# A small window, because llvmpipe draws on the processor; two photon subsets; work at rest only where it is tested.
SETTINGS = Settings(
    scene="room", photons=8_192, radius=0.06, neighbours=40, light="photons", size=(720, 540), measure_errors=False
)
PATIENCE = 600.0  # s after which a test that hangs fails; none needs a tenth on two cores


def opening(scene: Scene) -> Callable:
    """Return a function that opens a prepared scene instead of a file."""
    return functools.partial(Opening, load=lambda settings: scene)


def opened(settings: Settings = SETTINGS, scene: Scene | None = None):
    """Open a scene to its first picture and return it."""
    job = opening(scene or room())(settings)
    job._thread.join()
    assert job.done
    if job.problem is not None:
        raise job.problem
    return job.result


def need_gl(reason: str) -> None:
    """Skip for a reason, or fail where GL is required."""
    if os.environ.get("GI_REQUIRE_GL") == "1":
        pytest.fail(f"GI_REQUIRE_GL=1, but {reason}")
    pytest.skip(reason)


@functools.cache
def screenless() -> str | None:
    """Make glfw work without a screen (null platform, EGL), for the whole process; return the reason if it cannot."""
    try:
        import imgui_bundle  # noqa: F401, I001  before glfw: it brings the libglfw that both must use
        import glfw
    except (ImportError, OSError) as problem:
        return f"the GUI does not load: {problem}"
    glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL)
    from app.window.window import why_no_window

    return why_no_window()


def standalone_context():
    """Return a GL 3.3 context without a window, or skip."""
    import moderngl

    problems = []
    for options in ({"backend": "egl"}, {}):
        try:
            return moderngl.create_standalone_context(require=330, **options)
        except Exception as problem:  # moderngl raises plain Exception
            problems.append(str(problem))
    need_gl(f"no OpenGL 3.3: {'; '.join(problems)}")


def drive(viewer, script: Callable, quits: bool = False, keep_ini: bool = False) -> None:
    """Run a viewer without a screen; `script(ctx)` clicks and types in it with ImGui's test engine.

    `quits`: the script ends by closing the window, which the engine would count as a failure; `keep_ini`: settings
    of the window are written to the test's folder. An exception of a frame ends the script and is raised here: from
    a callback, it would leave the script to wait for frames that never come, and then abort the process.
    """
    from imgui_bundle import hello_imgui, imgui
    from imgui_bundle.imgui import test_engine
    from imgui_bundle.immapp import testing

    from app.window import window

    def without_watchdog() -> None:
        """The engine would end a test after 60 s of a busy machine, see PATIENCE."""
        io = test_engine.get_io(hello_imgui.get_imgui_test_engine())
        io.config_watchdog_warning = io.config_watchdog_kill_test = np.finfo(np.float32).max.item()

    failed: list[Exception] = []

    def guarded(callback: Callable[[], None]) -> Callable[[], None]:
        def call() -> None:
            draws = imgui.get_current_context().within_frame_scope
            state = imgui.internal.ErrorRecoveryState()
            if draws:
                imgui.internal.error_recovery_store_state(state)
            try:
                callback()
            except Exception as problem:
                failed.append(problem)
                test_engine.abort_current_test(hello_imgui.get_imgui_test_engine())  # what waits for frames fails
                if draws:  # end the windows that were begun
                    imgui.get_io().config_error_recovery_enable_assert = False
                    imgui.internal.error_recovery_try_to_recover_state(state)

        return call

    for holder, names in (
        (viewer.params.callbacks, ("show_gui", "show_menus", "show_status", "after_swap")),
        *((shown, ("gui_function",)) for shown in viewer.params.docking_params.dockable_windows),
    ):
        for name in names:
            setattr(holder, name, guarded(getattr(holder, name)))
    # Tests read the scene's picture, which is drawn before, never the window: without it, 29 CPU s are 17.
    viewer.params.callbacks.before_imgui_render = lambda: _switch_rasterisation(viewer, off=True)
    viewer.params.callbacks.before_swap = lambda: _switch_rasterisation(viewer, off=False)
    viewer._draw_part = lambda stage, work: work()  # its exceptions fail the test, too
    viewer.params.callbacks.register_tests = without_watchdog
    viewer.may_sleep = False  # the engine needs frames
    viewer.params.ini_disable = not keep_ini
    viewer.params.app_window_params.restore_previous_geometry = False
    window.prepare()
    try:
        testing.run(test_function=script, runner_params=viewer.params, raise_on_error=not quits)
    finally:
        if hasattr(signal, "SIGPIPE"):  # the engine's handler ends the process when a later test's socket closes
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        if failed:
            raise failed[0]


def _switch_rasterisation(viewer, off: bool) -> None:
    if (ctx := viewer.painter.ctx) is not None:
        (ctx.enable_direct if off else ctx.disable_direct)(RASTERIZER_DISCARD)


class Clock:
    """A clock that only the test advances."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


RASTERIZER_DISCARD = 0x8C89  # of OpenGL
STAGES = 8  # of a frame of CountingSolver that may be broken off


class CountingSolver:
    """The solver's interface around counters; a move costs 4 ms of a test's clock, a step the time set in `Behind`.

    `photon_seconds`: additional time of a move per photon; `wrong`: factor on the times that the budget records.
    """

    def __init__(
        self, scene: Scene, clock: Clock, steps: int = 40, photon_seconds: float = 0.0, wrong: float = 1.0
    ) -> None:
        from gi_core.discs.stale_receivers import ControlFacts
        from gi_core.frames.frame import Changes
        from gi_core.frames.light_setting import FrameBudget
        from gi_core.gather.estimate import Source
        from gi_core.geometry.surfaces import flatten

        self.scene, self.clock, self.steps = scene, clock, steps
        self.surfaces, self.receivers = flatten(scene)
        self.irradiance = np.ones((len(self.receivers.areas), 3))
        self.poses = {m.name: m.pose for m in scene.mobiles}
        self.seed = 0
        self.model = SimpleNamespace(
            scene=scene,
            surfaces=self.surfaces,
            emitters=SimpleNamespace(total_flux=np.ones(3), lamps=Lamps(("lamp",), {"lamp": 0})),
            object_receivers=self.receivers,
            receivers_at=lambda poses: self.receivers,
            transforms=lambda poses: None,
        )
        corners = dict(zip(("low", "high"), vectors.box(self.receivers.positions), strict=True))
        self.chosen = SimpleNamespace(**corners, scene_size=1.0, escaped_first=0.0, behind_first=0.0)
        self.estimator, self.photons, self.radius, self.neighbours = "tangent_plane", 1000, 0.05, 50
        self.photon_seconds, self.wrong = photon_seconds, wrong
        self.frame = SimpleNamespace(
            photons=0, paths=0, segments=0, subsets=(), timings={}, probe_irradiance={}, search_summary="",
            changes=Changes(0, 0, 0), control_facts=ControlFacts(0.0, 0, 0), store=SimpleNamespace(memory_full=False),
            fates={"emitted": np.zeros(3), "truncated": np.zeros(3)}, levels=np.ones((1, 3)), effective_photons=0,
            gloss=None, gathered=False, background=None, held=None,
        )  # fmt: skip
        self.levels = self.frame.levels
        self.light = "photons"
        static = SimpleNamespace(gathered=None, error=lambda levels: math.inf)
        setting = SimpleNamespace(takes_gathered=False)
        self.frame_light = SimpleNamespace(
            setting=setting,
            static=static,
            is_gathered=False,
            gathered_at=lambda at: None,
            source=Source.PHOTONS,
            held=None,
        )
        self.deviation, self.error = np.zeros(len(self.irradiance)), math.nan
        self.paths_at_rest, self.scene_size = 0, 1.0
        self.at_rest = 0  # photons of the last picture
        self.budget = FrameBudget()
        self.moved_with: list[int] = []  # photons of each move
        self.log: list[tuple] = []  # ("step", k), ("move", poses), ("configure", changes)

    @property
    def setting(self):
        from gi_core.estimators.base import Setting

        return Setting(self.estimator, self.radius, self.neighbours)

    @property
    def subsets(self) -> tuple[int, ...]:
        return tuple(n for n in (125, 250, 500) if n < self.at_rest) + (self.at_rest,) * (self.at_rest > 0)

    def drawn(self, irradiance, poses=None) -> Drawn:
        return Drawn(irradiance, None)

    def size_within(self, seconds: float) -> tuple[int | None, int | None]:
        return self.budget.within(seconds, self.subsets, False)

    def move_seconds(self, photons: int) -> float:
        return 0.004 + self.photon_seconds * photons

    def _learn(self, photons: int) -> None:
        self.budget.record(FrameSize(photons, 0), {"estimate": self.wrong * self.move_seconds(photons)}, False)

    def solve_steps(self):
        for k in range(1, self.steps + 1):
            self.log.append(("step", k))
            picture = k % 10 == 0
            if picture:
                self.frame.photons = self.at_rest = self.photons * k // self.steps
                self.frame.subsets = self.subsets
                self.irradiance = np.full_like(self.irradiance, len(self.log))
                self._learn(self.at_rest)
            yield Progress("tracing", k / self.steps, picture)

    def move_all(self, poses, photons: int | None = None, paths: int | None = None) -> None:
        assert photons is None or photons in self.subsets
        photons = self.at_rest if photons is None else photons
        started = self.clock.now
        for k in range(STAGES):
            self.clock.now = started + self.move_seconds(photons) * ((k + 1) / STAGES)
            pause()
        self._learn(photons)
        self.frame.photons = photons
        self.moved_with.append(photons)
        self.log.append(("move", dict(poses)))
        self.poses.update(poses)
        self.irradiance = np.full_like(self.irradiance, len(self.log))

    def twin(self) -> SimpleNamespace:
        twin = SimpleNamespace(poses=dict(self.poses), paths_at_rest=0, budget=type(self.budget)())
        twin.frame, twin.move_all = SimpleNamespace(subsets=self.subsets), functools.partial(self._time, twin)
        return twin

    def _time(self, twin, poses, photons: int, paths: int | None) -> None:
        """A frame of the twin: the picture stays. Its first takes longer."""
        assert poses and photons in self.subsets and all(poses[name] != self.poses[name] for name in poses)
        first = twin.poses == self.poses
        self.clock.now += 5 * self.move_seconds(photons) if first else self.move_seconds(photons)
        seconds = self.wrong * self.move_seconds(photons) * (5 if first else 1)
        twin.budget.record(FrameSize(photons, 0), {"estimate": seconds}, False)
        twin.poses.update(poses)
        self.log.append(("timed", photons))

    def configure(self, **changes) -> None:
        self.log.append(("configure", changes))
        self.budget = type(self.budget)()
        for name, value in changes.items():
            if value == "unknown":
                raise ValueError("no such estimator")
            setattr(self, name, value)

    def count(self, what: str) -> int:
        return sum(entry[0] == what for entry in self.log)


class Behind:
    """A background thread on a test's clock: every call has a fixed duration, and continues while no one waits."""

    def __init__(self, clock: Clock, seconds: float) -> None:
        self.clock, self.seconds = clock, seconds
        self.jobs = 0  # under way, one at most

    def submit(self, call: Callable) -> "Behind.Pending":
        assert self.jobs == 0, "only one thread at a time uses the solver"
        self.jobs = 1
        return self.Pending(self, call)

    def close(self) -> None:
        pass

    class Pending:
        def __init__(self, thread: "Behind", call: Callable) -> None:
            self.thread, self.call = thread, call
            self.end = thread.clock.now + thread.seconds
            self.done = False

        def wait(self, seconds: float) -> bool:
            clock = self.thread.clock
            clock.now = max(min(self.end, clock.now + max(seconds, 0)), clock.now)
            if clock.now >= self.end - 1e-12 and not self.done:
                self.done = True
                self.thread.jobs = 0
                try:
                    self.value, self.problem = self.call(), None
                except Exception as problem:
                    self.problem = problem
            return self.done

        def result(self):
            if not self.done:  # the window waits for it: short, its time does not count
                self.end = self.thread.clock.now
                self.wait(0.0)
            if self.problem is not None:
                raise self.problem
            return self.value


def counting_session(solver: CountingSolver, step_seconds: float, budget: float = 0.0):
    """Return an open session of a counting solver; budget [ms]: per frame, 0: all photons always."""
    from app.session.log import Log
    from app.session.opening import Opened
    from app.session.session import Session

    settings = Settings(
        estimator="tangent_plane", photons=1000, radius=0.05, neighbours=50, exposure=0.0, budget=budget,
        measure_errors=False,
    )  # fmt: skip
    clock = solver.clock
    s = Session(settings, Log(), open_with=lambda settings: None, clock=clock, worker=Behind(clock, step_seconds))
    s.adopt(Opened(settings, solver, None, ()))
    return s
