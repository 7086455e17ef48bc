"""Pictures in Python and in notebooks: `app.render`, `app.show`."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from app.settings import Settings, UsageError, make_solver, read_scene
from gi_core.scene import Camera, Scene
from gi_core.solver import Solver

if TYPE_CHECKING:
    from app.draw.shot import Shot


def render(
    scene: Scene | Solver, camera: Camera | None = None, size: tuple[int, int] = (640, 400), seconds: float = 0.0,
    **settings,
) -> np.ndarray:  # fmt: skip
    """Return the picture (h, w, 3) float32 of linear radiance [W/m2/sr], 0 where nothing is seen.

    scene: solved here, or a solver in its present light; camera: None for the scene's; size: (width, height) pixels;
    seconds: for gathering light before, which stays in the solver; settings: fields of `app.settings.Settings`, those
    of light and `cull`. Raises SceneError, UsageError. `app.draw.tonemap.to_display` makes display values of it.
    """
    from app.draw.shot import layers

    return layers(_shot(scene, Settings(size=size, **settings), seconds, camera)).colour


def show(scene: Scene, **settings) -> int:
    """Open a window with a scene; return its exit code once it is closed.

    settings: fields of `app.settings.Settings`. The window cannot save a scene from arrays. Raises SceneError;
    UsageError where no window can be opened.
    """
    from app.session.opening import Opening
    from app.window.window import why_no_window

    if reason := why_no_window():
        raise UsageError(f"no window: {reason}; app.render draws without one")
    from app.window.viewer import run

    def load(asked: Settings) -> Scene:
        return scene if asked.scene == scene.name else read_scene(asked)

    return run(Settings(scene=scene.name, **settings), open_with=partial(Opening, load=load))


def _shot(scene: Scene | Solver, settings: Settings, seconds: float = 0.0, camera: Camera | None = None) -> Shot:
    from app.draw.camera import from_camera
    from app.draw.shot import Shot
    from app.rest.scheduler import gather

    if isinstance(scene, Solver):
        solver = scene
    else:
        solver = make_solver(scene, settings)
        solver.solve()
    gather(solver, seconds, lambda stage, fraction: None)
    shot = Shot(solver, settings)
    if camera is not None:
        shot.camera = from_camera(camera, solver.scene.up, shot.camera.bounds, shot.camera.lit)
    return shot
