"""The hand of the window tests, functions for actions of a user; tests that run within the window."""

import inspect
import time
from dataclasses import replace
from functools import partial

import numpy as np

from app.session.opening import Opening
from tests.support import viewer_support as support
from tests.support.projection import projected
from tests.support.viewer_support import PATIENCE

PAUSE = 0.01  # s between frames that wait: drawing them would take the processor from the light
BLOCK_FRONT = (0.5, 0.3, 0.62)  # a point on the mobile that the camera sees


class Hand:
    """The test engine's context with functions for actions of a user."""

    def __init__(self, viewer, ctx) -> None:
        self.viewer, self.ctx = viewer, ctx
        self._jobs = []
        viewer.params.callbacks.pre_new_frame = self._run_jobs

    def _run_jobs(self) -> None:
        while self._jobs:
            self._jobs.pop()()

    def wait(self, what) -> None:
        """Let frames pass until something holds."""
        limit = time.monotonic() + PATIENCE
        while not what():
            assert time.monotonic() < limit, "waited too long"
            assert not self.ctx.is_error(), "the engine draws no more frames"
            time.sleep(PAUSE)
            self.ctx.yield_()

    def wait_for_light(self) -> None:
        """Wait until all photons are drawn."""
        v = self.viewer
        self.wait(lambda: v._ready and not v.session.refining and v.painter.uploaded == v.session.version)
        self.ctx.yield_(2)

    def panel(self, *closed: str, opened: str = "") -> None:
        """Refer to the panel's items from now on; close sections, so that others are in sight, and open one."""
        self.ctx.set_ref("Panel")
        for section in closed:
            self.ctx.item_close(section)
        if opened:
            self.ctx.item_open(opened)

    def open_research(self) -> None:
        """Show the sections about the method; refer to the panel's items from now on."""
        self.ctx.set_ref("Panel")
        self.ctx.item_check("Research")

    def at(self, point) -> tuple[float, float]:
        """Return where a point of the scene is in the window."""
        v = self.viewer.viewport.view
        x, y = projected(v.camera, point, v.aspect)
        return v.origin[0] + x * v.size[0], v.origin[1] + y * v.size[1]

    def click(self, point) -> None:
        """Click on a point of the scene."""
        self.move(self.at(point))
        self.ctx.mouse_click(0)
        self.ctx.yield_(3)

    def move(self, to) -> None:
        self.ctx.mouse_move_to_pos(to)
        self.ctx.yield_(2)

    def drag(self, start, end, button: int = 0, modifier=None, steps: int = 3) -> None:
        self.move(start)
        if modifier is not None:
            self.ctx.key_down(modifier)
            self.ctx.yield_()
        self.ctx.mouse_down(button)
        for k in range(1, steps + 1):
            self.move([a + (b - a) * k / steps for a, b in zip(start, end, strict=True)])
        self.ctx.mouse_up(button)
        if modifier is not None:
            self.ctx.key_up(modifier)
        self.ctx.yield_(2)

    def press(self, key) -> None:
        self.ctx.key_press(key)
        self.ctx.yield_(3)

    def light_is_that_from_scratch(self) -> bool:
        """Return whether light equals a solution from scratch, made in the solver's thread: it may be measuring or
        gathering, and only one thread may use the solver."""
        self.wait_for_light()
        session = self.viewer.session
        while True:
            light, job = session.irradiance, session._worker.submit(session.light._solver.from_scratch)
            self.wait(lambda job=job: job.wait(0.0))
            self.ctx.yield_(2)
            if session.irradiance is light:  # else gathered light has replaced it meanwhile
                return np.array_equal(light, job.result())

    def pixels(self) -> np.ndarray:
        """Read the picture back, on the window's thread: this one, the engine's, has no GL context."""
        self.ctx.yield_(2)
        read = []
        self._jobs.append(lambda: read.append(self.viewer.painter.renderer.pixels().copy()))
        self.wait(lambda: read)
        return read[0]


def keys():
    from imgui_bundle import imgui

    return imgui.Key


def errors(viewer) -> list[str]:
    return [e.text for e in viewer.log.entries if e.level == "error"]


def in_window(scene=support.room, open_with=None, settings=support.SETTINGS, problems=(), lit=True, **changes):
    """Run a test(hand, viewer, fixtures) in a viewer, once its light is drawn if `lit`.

    `scene`: a function without arguments; `problems`: errors of the log, None: not compared; `changes`: of settings.
    """

    def decorated(test):
        def run(play, **given):
            def script(hand, viewer):
                if lit:
                    hand.wait_for_light()
                test(hand, viewer, **given)

            viewer = play(script, replace(settings, **changes), open_with or partial(Opening, load=lambda _: scene()))
            assert problems is None or errors(viewer) == list(problems)

        run.__name__, run.__doc__, run.__module__ = test.__name__, test.__doc__, test.__module__
        parameters = {**inspect.signature(test).parameters, **inspect.signature(run).parameters}
        run.__signature__ = inspect.Signature(
            [parameters[n] for n in parameters if n not in ("hand", "viewer", "given")]
        )
        return run

    return decorated
