"""The first look at a scene while kernels compile, from a process of its own.

`python -m app.session.first_look` reads settings from standard input. It writes the scene without light, then in its
first light, as records to standard output. Then it helps to compile: it is the process that takes the steps of
`compile_ahead` in reverse order.
"""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from typing import IO, NamedTuple

import numpy as np

from app.draw.camera import Bounds, Turntable, from_camera, matrices, scene_bounds
from app.draw.draw_mesh import DrawMesh, draw_meshes
from app.draw.lit_scene import LitScene, metered
from app.draw.tonemap import NEUTRAL, Gains, gains_for
from app.settings import Settings, UsageError, open_scene
from gi_core.base.vectors import central_box
from gi_core.display import edges, vertex_light
from gi_core.display.dilation import Drawn
from gi_core.display.first_look import first_looks
from gi_core.instruments import child, compile_ahead
from gi_core.model import Model
from gi_core.scene import Scene
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import three


class FirstLook(NamedTuple):
    """A scene at its first poses, in its first light or without any."""

    meshes: tuple[DrawMesh, ...]
    models: tuple[np.ndarray, ...]  # (4, 4) object to world
    drawn: Drawn
    noise: float  # relative l1, of its light; inf without light
    camera: Turntable
    origin: np.ndarray  # (3,) [m] of the static part's coordinates
    exposure: float  # [EV]
    gains: Gains


def start(settings: Settings, surfaces: str, errors: IO) -> subprocess.Popen:
    """Start the process. It writes looks, or the error of a bad scene. Its input must stay open; errors: a file."""
    process = child.start("app.session.first_look", stdout=subprocess.PIPE, stderr=errors)
    pickle.dump((settings, surfaces, os.getcwd()), process.stdin)  # settings name files relative to this folder
    process.stdin.flush()
    return process


def looks(scene: Scene, settings: Settings) -> Iterator[FirstLook]:
    """Yield a scene without light, then in its first light. Raises SceneError."""
    for kernels in (edges, vertex_light):  # of the window's first picture, which would stand still meanwhile
        kernels.compile_kernels()
    model = Model(scene, rays=settings.rays)
    poses = model.start_poses()
    receivers = model.receivers_at(poses)
    bounds = lit = scene_bounds(model, poses)
    if len(receivers.areas):  # something far away has few; a pilot's kernels would be compiled first
        lit = Bounds(*map(three, central_box(receivers.positions)))
    size = scene.defaults.scene_size or float(np.subtract(lit.high, lit.low).max())
    camera = from_camera(scene.camera, scene.up, bounds, lit)
    dull = model.surfaces._replace(reflectance=model.world.bsdfs.albedo)  # gloss looks diffuse
    meshes = draw_meshes(dull, model.lamp_of_face)
    towards = camera.eye() - receivers.positions
    facing = np.abs((towards * receivers.normals).sum(axis=1)) / np.maximum(np.linalg.norm(towards, axis=1), 1e-30)
    unlit, models = Drawn(np.repeat(facing[:, None], 3, axis=1), None), tuple(matrices(model.transforms(poses)))
    look = FirstLook(meshes, models, unlit, math.inf, camera, model.origins[0], 1.0, NEUTRAL)
    yield look

    names = model.emitters.lamps.names
    levels = np.array(list(settings.levels(names).values()), np.float64).reshape(-1, 3)[: len(names)]
    exposure = scene.defaults.exposure if settings.exposure is None else settings.exposure
    gains = gains_for(model.emitters.total_flux)
    for drawn, noise in first_looks(scene, model, levels, size, settings.seed):
        if exposure is None:
            exposure = metered(LitScene(model, poses, levels, meshes, drawn), camera, size)
        yield look._replace(drawn=drawn, noise=noise, exposure=exposure, gains=gains)


def run() -> None:
    """Be that process."""
    settings, surfaces, folder = pickle.load(sys.stdin.buffer)
    os.chdir(folder)  # child.start() begins elsewhere
    child.prepare()
    try:
        for look in looks(open_scene(settings), settings):
            _send(look)
    except (SceneError, UsageError) as problem:  # nothing needs to be compiled for it
        _send(problem)
    compile_ahead.compile_backwards(settings.rays, surfaces)


def _send(record: FirstLook | Exception) -> None:
    pickle.dump(record, sys.stdout.buffer, pickle.HIGHEST_PROTOCOL)
    sys.stdout.flush()


if __name__ == "__main__":
    from app.session import first_look  # records are pickled under the module's own name

    first_look.run()
