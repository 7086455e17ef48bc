"""Files of references and static light: an interrupted run continues from its file.

A file's name is a hash of all inputs of its result, so an edited scene or another pose never loads an outdated file.
Files are replaced atomically. `GI_VIEWER_REFERENCE_DIR` overrides the folder in the user's cache.
"""

from __future__ import annotations

import contextlib
import os
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import platformdirs

from app.cli.writable import replacing
from gi_core.base.results import digest
from gi_core.gather.reference import PATHS_AT_ONCE, ReferenceRounds, ReferenceState
from gi_core.gather.reference_sample import Reached, gather_until
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Pose

FORMAT = "gi-viewer reference 4"  # raise the number when paths change: old files are then ignored
STATIC = "static 2"  # the same of the static part's light, when its paths are distributed otherwise
FOLDER_VARIABLE = "GI_VIEWER_REFERENCE_DIR"
REFERENCE_SEED = 0
SAVE_SECONDS = 20.0


def reference_folder() -> Path:
    """Return the folder of the files."""
    if folder := os.environ.get(FOLDER_VARIABLE):  # an empty path would be the current folder
        return Path(folder)
    return Path(platformdirs.user_cache_dir("gi-viewer", appauthor=False)) / "reference"


class StateFile:
    """The state of a run at some points, in a file."""

    def __init__(self, key: str, points: int, folder: Path | None, channels: int = 3) -> None:
        self.path = (reference_folder() if folder is None else folder) / f"{key}.npz"
        self._shape = points, channels

    def load(self) -> ReferenceState | None:
        """Return the stored state; None without a readable file."""
        try:
            with np.load(self.path) as file:
                state = ReferenceState(*(file[name] for name in ReferenceState._fields))
        except (OSError, ValueError, KeyError, EOFError, MemoryError, NotImplementedError, RuntimeError):
            return None
        except (zipfile.BadZipFile, zlib.error):
            return None
        empty = ReferenceState.empty(*self._shape)
        fits = all((a.shape, a.dtype) == (b.shape, b.dtype) for a, b in zip(state, empty, strict=True))
        return state if fits else None

    def save(self, state: ReferenceState) -> None:
        """Replace the file by a state. Raises OSError."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(self.path) as part, open(part, "wb") as file:
            np.savez(file, **state._asdict())

    def keep(self, state: ReferenceState) -> None:
        """Save a state if possible; without a file the next run starts again."""
        with contextlib.suppress(OSError):
            self.save(state)


class StaticStore(StateFile):
    """The static part's light without mobiles, see `gi_core.gather.static`: one file for any mobiles."""

    def __init__(self, model: Model, seed: int) -> None:
        s, rows, faces = model.surfaces, model.surfaces.receiver_range(0), model.surfaces.face_range(0)
        r = model.object_receivers
        arrays: tuple[np.ndarray, ...]
        arrays = s.vertices[0], s.faces[0], s.reflectance[faces], s.emission[faces], s.two_sided[faces]
        if not np.isnan(s.lobe[faces]).all():
            arrays = *arrays, s.lobe[faces]
        if len(s.tables.head):
            arrays = *arrays, *s.tables, s.tangent[faces]
        lamps = model.emitters.lamps
        if lamps.count > 1:  # light per lamp follows the sum
            arrays = *arrays, np.array([lamps.sources.get(light.name, 0) for light in model.scene.lights])
            arrays = *arrays, model.lamp_of_face[faces]
        key = _digest(model, seed, STATIC, *arrays, r.positions[rows], r.normals[rows], r.areas[rows])
        super().__init__(key, rows.stop, None, 3 + lamps.channels * (lamps.count > 1))


class ReferenceStore(StateFile):
    """The reference of some receivers of a model at one set of poses: its file and its steps."""

    def __init__(
        self,
        model: Model,
        poses: Mapping[str, Pose] | None = None,
        rows: np.ndarray | None = None,
        seed: int = REFERENCE_SEED,
        folder: Path | None = None,
        weights: np.ndarray | None = None,
        levels: np.ndarray | None = None,
    ) -> None:
        """`poses`: poses that differ from the scene's; `rows` (n,): receivers, default all.

        `weights` (n,): weight of each receiver, default its area; the number of paths follows the weight. `levels`
        (G, 3): of the lamps, default those of the scene file.
        """
        self.levels = model.emitters.lamps.full() if levels is None else levels
        self.model, self.seed = model, int(seed)
        self.poses = model.start_poses() | dict(poses or {})
        receivers = model.receivers_at(self.poses)
        positions, normals = evaluation_points(model.surfaces, receivers)
        self.rows = np.arange(len(positions)) if rows is None else np.asarray(rows)
        self.positions, self.normals = positions[self.rows], normals[self.rows]
        self.weights = receivers.areas[self.rows] if weights is None else np.asarray(weights, np.float64)
        super().__init__(self.key(), len(self.rows), folder)

    def key(self) -> str:
        """Return the hash of all inputs."""
        s = self.model.surfaces
        poses = np.array([[*self.poses[name].position, *self.poses[name].quaternion] for name in self.model.names])
        arrays: tuple[np.ndarray, ...] = (
            *s.vertices,
            *s.faces,
            s.reflectance,
            s.emission,
            s.two_sided,
            self.positions,
            self.normals,
        )
        if not np.isnan(s.lobe).all():
            arrays = *arrays, s.lobe
        if len(s.tables.head):
            arrays = *arrays, *s.tables, s.tangent
        if (self.levels != 1).any():
            arrays = *arrays, self.levels, self.model.lights_at(self.levels).area.radiance
        return _digest(self.model, self.seed, "at poses", poses, *arrays, self.weights)

    def rounds(self, even: bool = False, load: bool = True) -> ReferenceRounds:
        """Return rounds from the stored state on (`load`); `even`: without a state, uniform paths for a picture."""
        state = self.load() if load else None
        weights = None if even and state is None else self.weights
        m, receivers = self.model, (self.positions, self.normals)
        return ReferenceRounds(
            m.scene, *receivers, self.seed, weights, self.poses, model=m, state=state, levels=self.levels
        )

    def gather(
        self, error: float, paths: Callable[..., np.ndarray] | None = None, step: int = PATHS_AT_ONCE
    ) -> Iterator[Reached]:
        """Gather until the noise is at most `error` (0.01: 1 %), as gather_until() does, in steps of so many paths.

        paths: in place of `Gatherer.paths`, with its results. The result does not depend on the steps.
        The state is saved every SAVE_SECONDS and at the end, also after Ctrl+C or a closed iterator, if possible.
        """
        rounds, saved = self.rounds(), time.monotonic()
        rounds.paths = paths or rounds.paths
        before = rounds.state.sets.sum(), np.isnan(rounds.state.pilot).sum()
        try:
            for reached in gather_until(rounds, self.weights, error, step=step):
                if time.monotonic() - saved > SAVE_SECONDS:
                    self.keep(reached.state)
                    saved = time.monotonic()
                yield reached
        finally:
            if before != (rounds.state.sets.sum(), np.isnan(rounds.state.pilot).sum()):
                self.keep(rounds.state)


def _digest(model: Model, seed: int, kind: str, *arrays: np.ndarray) -> str:
    """Return a hash of a scene's lights, a seed and arrays."""
    lights = [(type(light).__name__, [np.asarray(v).tolist() for v in light[1:]]) for light in model.scene.lights]
    return digest(FORMAT, lights, np.asarray(model.scene.up, float), int(seed), kind, *arrays)
