"""Pictures of a solved scene as records: pixels or layers, with the parameters that belong to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.draw.exr import write_exr
from app.draw.layers import Layers, layers
from app.draw.png import write_png
from app.draw.shot import Shot
from app.session.picture import metadata_of
from gi_core.scene import Pose


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
    s = shot.settings
    shot.expose()  # a parameter
    return Still(layers(shot.solver, shot.meshes, shot.camera, s.size, s.cull, progress), metadata_of(shot))


def along(shot: Shot, poses: Sequence[Mapping[str, Pose]], linear: bool = False) -> Iterator[Still]:
    """Yield the picture at each set of poses, all at the exposure and scale of the first."""
    for at in poses:
        if at:
            shot.solver.move_all(at)
        yield still(shot, linear)
