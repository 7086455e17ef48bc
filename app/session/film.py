"""Pictures of a solved scene as records: pixels or layers, with the parameters that belong to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.cli.cluster import Machines
from app.draw.false_colour import Scale
from app.draw.picture_files import write_exr, write_png
from app.draw.shot import Layers, Shot, layers
from app.session.picture import metadata_of
from app.settings import Settings, make_solver
from gi_core.gather.estimate import Estimate
from gi_core.gather.static import StaticGather
from gi_core.scene import Pose, Scene
from gi_core.solver import Solver


class Still(NamedTuple):
    """A picture and its parameters."""

    picture: np.ndarray | Layers  # (h, w, 3) uint8
    parameters: dict[str, str]

    def write(self, path: Path) -> Path:
        """Write it to a PNG or an EXR file; return the full path. Raises OSError."""
        if isinstance(self.picture, Layers):
            return write_exr(path, self.picture, self.parameters)
        return write_png(path, self.picture, self.parameters)


def still(shot: Shot, linear: bool = False, progress: Callable[[float], None] = lambda fraction: None) -> Still:
    """Return the picture of a shot; linear: its layers."""
    if not linear:
        return Still(shot.take(progress), metadata_of(shot))
    shot.expose()  # a parameter
    return Still(layers(shot, progress), metadata_of(shot))


def along(shot: Shot, poses: Sequence[Mapping[str, Pose]], linear: bool = False) -> Iterator[Still]:
    """Yield the picture at each set of poses, all at the exposure and scale of the first."""
    for at in poses:
        if at:
            shot.solver.move_all(at)
        yield still(shot, linear)


class Film(NamedTuple):
    """Data that the pictures of a film share, for other processes."""

    scene: Scene
    settings: Settings  # all that were open have values
    scale: Scale | None  # of false colours
    light: Estimate | None  # gathered static light
    linear: bool
    paths: int | None  # of Shot


def elsewhere(
    machines: Machines, shot: Shot, scene: Scene, poses: Sequence[Mapping[str, Pose]], linear: bool = False
) -> Iterator[Still]:
    """Yield the pictures of along(), drawn by other processes; scene: that of the shot, as it was loaded."""
    solver = shot.solver
    if poses[0]:
        solver.move_all(poses[0])
    shot.expose()
    shot.scale = None if linear else shot.fitted_scale()
    asked = shot.settings.with_method_of(solver)
    settings = replace(asked, photons=solver.frame.photons_at_rest, exposure=shot.exposure)
    gathered = solver.frame_light.static.gathered
    film = Film(scene, settings, shot.scale, None if gathered is None else gathered.estimate, linear, shot.paths)
    yield from machines.crew(_ready, film).map(_drawn, [(at,) for at in poses])


def _ready(film: Film, threads: int | None) -> tuple[Shot, bool]:
    """Return the shot of a film, in a process of the cluster."""
    solver = make_solver(film.scene, film.settings, threads=threads)
    solver.solve()
    if film.light is not None:
        restore(solver, film.light)
    shot = Shot(solver, film.settings, film.paths)
    shot.scale = film.scale
    return shot, film.linear


def _drawn(ready: tuple[Shot, bool], at: Mapping[str, Pose]) -> Still:
    shot, linear = ready
    return next(along(shot, [at], linear))


def restore(solver: Solver, light: Estimate) -> None:
    """Show static light gathered by another solver of the same scene and settings."""
    static = solver.frame_light.static
    static.gathered = StaticGather(solver.model, solver.seed)
    static.gathered.estimate = light
    for progress in solver.gather_steps():
        if progress.stage == "gathering":
            return  # shown, and not a path traced
