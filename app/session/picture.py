"""Pictures of a solved scene as records: pixels or layers, with the parameters that belong to them.

The parameters serve redraws and the metadata of saved pictures.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.cli.version import commit, version
from app.draw.camera import Turntable
from app.draw.false_colour import Scale
from app.draw.picture_files import write_exr, write_png
from app.draw.shot import Layers, Shot, layers
from app.rest.scheduler import RestWork
from app.session.solver_jobs import Snapshot, snapshot_of
from app.settings import Settings
from gi_core.scene import Pose
from gi_core.scene.types import RADIOMETRIC, UNITS, Units


class Picture(NamedTuple):
    """Parameters of a picture besides its size. In one session, equal parameters mean equal pictures."""

    settings: Settings
    camera: Turntable
    light: int = 0  # version of the light, see Session.version
    scale: Scale | None = None  # of false colours
    units: Units = RADIOMETRIC

    def metadata(self, snapshot: Snapshot) -> dict[str, str]:
        """Return the parameters as text entries, for a picture of the light in a snapshot.

        Entries of different light differ at least in "irradiance".
        """
        s, view, setting, rest = self.settings, self.camera.as_camera(), snapshot.setting, snapshot.rest
        photons, paths = "photons", f"gathered, {snapshot.paths} paths per receiver"
        static = f"{snapshot.source.value}; error {100 * rest.gathered.error:.2g} %"
        settled = rest.at_poses is not None and rest.at_poses.used
        entries = {
            "software": f"gi-viewer {version()}",
            "commit": commit() or "-",
            "scene": s.scene,
            "mobiles": " ".join(s.mobiles) or "-",
            **setting._asdict(),
            "radius": f"{setting.radius:.6g} m",
            "photons": snapshot.photons,
            "seed": s.seed,
            "static_light": static if rest.gathered.used else photons,
            "mobile_light": paths if snapshot.paths else photons,
            "light_at_poses": f"gathered, noise {100 * rest.at_poses.error:.2g} %" if settled else "-",
            "irradiance": hashlib.sha256(snapshot.irradiance.tobytes()).hexdigest()[:16],
            "error": f"{100 * rest.report.total:.2g} %" if rest.report and rest.report.total >= 0 else "not measured",
            "exposure": f"{s.exposure:.4f} EV",
            "white_balance": s.white_balance,
            "tone_map": s.tone_map,
            "show": s.show,
            "false_colours": "-" if self.scale is None else self.scale.text(self.units),
            "cull": s.cull,
            "light_shown": "reference" if s.reference and rest.reference else "estimate",
            "camera": f"position {_numbers(view.position)} target {_numbers(view.target)} "
            f"vertical_fov_degrees {view.vertical_fov_degrees:.6g}",
        }
        lamps = {f"lamp {name}": _numbers(level) for name, level in s.levels(()).items()}
        if s.solo:
            lamps["solo"] = s.solo
        poses = {f"pose {name}": _numbers((*p.position, *p.quaternion)) for name, p in snapshot.poses.items()}
        return {key: str(value) for key, value in (entries | poses | lamps).items()}


def metadata_of(shot: Shot) -> dict[str, str]:
    """Return the parameters of a ray-cast picture as text entries."""
    settings, units = replace(shot.settings, exposure=shot.exposure), UNITS[shot.solver.scene.units]
    picture = Picture(settings, shot.camera, scale=shot.scale, units=units)
    return picture.metadata(snapshot_of(shot.solver, RestWork(shot.solver, time.perf_counter)))


def _numbers(values: Iterable[float]) -> str:
    return ",".join(f"{v:.12g}" for v in values)


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
