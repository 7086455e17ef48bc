"""What has been gathered of the unbiased answer, kept on disk: a run that is interrupted goes on where it was.

A file a question: it is named by a hash of everything that the answer depends on, so a scene that was edited, or
another pose, finds nothing old. Files are written aside and put in place, so they are whole at any time.
`GI_VIEWER_REFERENCE_DIR` names another folder than the user's cache.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import platformdirs

from gi_core.gather.reference import Gathered, gather_rounds, nothing_gathered
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Pose

FORMAT = "gi-viewer reference 2"  # to be raised when paths change: old answers are then gathered anew
FOLDER = "GI_VIEWER_REFERENCE_DIR"
SEED = 0


def reference_folder() -> Path:
    """Return the folder that holds what has been gathered."""
    if FOLDER in os.environ:
        return Path(os.environ[FOLDER])
    return Path(platformdirs.user_cache_dir("gi-viewer", appauthor=False)) / "reference"


class StateFile:
    """What has been gathered at some points, on disk."""

    def __init__(self, key: str, points: int, folder: Path | None) -> None:
        self.path = (reference_folder() if folder is None else folder) / f"{key}.npz"
        self._points = points

    def load(self) -> Gathered | None:
        """Return what has been gathered so far; None: nothing, or nothing that can be read."""
        try:
            with np.load(self.path) as file:
                state = Gathered(*(file[name] for name in Gathered._fields))
        except (OSError, ValueError, KeyError, EOFError, MemoryError, NotImplementedError, RuntimeError):
            return None
        except (zipfile.BadZipFile, zlib.error):
            return None
        empty = nothing_gathered(self._points)
        fits = all((a.shape, a.dtype) == (b.shape, b.dtype) for a, b in zip(state, empty, strict=True))
        return state if fits else None

    def save(self, state: Gathered) -> None:
        """Put what has been gathered in place of what was there. Raises OSError."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        aside = self.path.with_name(f"{self.path.stem}.{os.getpid()}.part")
        try:
            with open(aside, "wb") as file:
                np.savez(file, **state._asdict())
            os.replace(aside, self.path)
        except BaseException:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            raise

    def keep(self, state: Gathered) -> None:
        """Save where the disk allows it: a folder that cannot be written only means to gather again next time."""
        with contextlib.suppress(OSError):
            self.save(state)


class StaticStore(StateFile):
    """The static part's light without mobiles, see `gi_core.gather.static`: the same file whatever moves in it."""

    def __init__(self, model: Model, seed: int, folder: Path | None = None) -> None:
        s, rows, faces = model.surfaces, model.surfaces.receiver_range(0), model.surfaces.face_range(0)
        r = model.object_receivers
        arrays = s.vertices[0], s.faces[0], s.reflectance[faces], s.emission[faces], s.two_sided[faces]
        key = _digest(model, seed, "static", *arrays, r.positions[rows], r.normals[rows], r.areas[rows])
        super().__init__(key, rows.stop, folder)


class ReferenceStore(StateFile):
    """The unbiased irradiance of some receivers of a model at one set of poses, on disk and on the way there."""

    def __init__(
        self,
        model: Model,
        poses: Mapping[str, Pose] | None = None,
        rows: np.ndarray | None = None,
        seed: int = SEED,
        folder: Path | None = None,
        weights: np.ndarray | None = None,
    ) -> None:
        """`poses`: those that differ from the scene's own; `rows` (n,): of these receivers only, in this order.

        `weights` (n,): what each stands for, if not its own area; paths go where weight is.
        """
        self.model, self.seed = model, int(seed)
        self.poses = model.start_poses() | dict(poses or {})
        receivers = model.receivers_at(self.poses)
        positions, normals = evaluation_points(model.surfaces, receivers)
        self.rows = np.arange(len(positions)) if rows is None else np.asarray(rows)
        self.positions, self.normals = positions[self.rows], normals[self.rows]
        self.weights = receivers.areas[self.rows] if weights is None else np.asarray(weights, np.float64)
        super().__init__(self.key(), len(self.rows), folder)

    def key(self) -> str:
        """Return the hash of all that the answer depends on."""
        s = self.model.surfaces
        poses = np.array([[*self.poses[name].position, *self.poses[name].quaternion] for name in self.model.names])
        arrays = (*s.vertices, *s.faces, s.reflectance, s.emission, s.two_sided, self.positions, self.normals)
        return _digest(self.model, self.seed, "at poses", poses, *arrays, self.weights)

    def steps(self, **more) -> Iterator[Gathered]:
        """Go on from what is there, without end; nothing is saved. `more` is for gather_rounds()."""
        return gather_rounds(
            self.model.scene, self.positions, self.normals, self.seed, self.weights, self.poses,
            model=self.model, state=self.load(), **more,
        )  # fmt: skip


def _digest(model: Model, seed: int, kind: str, *arrays: np.ndarray) -> str:
    """Return a name for a scene's lights, a seed and some arrays."""
    digest = hashlib.sha256(FORMAT.encode())
    for light in model.scene.lights:
        digest.update(repr((type(light).__name__, [np.asarray(v).tolist() for v in light[1:]])).encode())
    digest.update(repr([np.asarray(model.scene.up, float).tolist(), int(seed), kind]).encode())
    for array in arrays:
        digest.update(repr((array.dtype.str, array.shape)).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:24]
