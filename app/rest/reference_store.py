"""Files of references and static light: an interrupted run continues from its file.

A file's name is a hash of all inputs of its result, so an edited scene or another pose never loads an outdated file.
Files are replaced atomically. `GI_VIEWER_REFERENCE_DIR` overrides the folder in the user's cache.
"""

from __future__ import annotations

import contextlib
import enum
import itertools
import math
import os
import stat
import struct
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from app.cli.writable import remove_parts, replacing
from gi_core.base.results import digest
from gi_core.files.formats.boundary import at_once
from gi_core.frames.static_light import StaticLight
from gi_core.gather.reference import PATHS_AT_ONCE, ReferenceRounds, ReferenceState
from gi_core.gather.reference_sample import Reached, gather_until
from gi_core.gather.static import StaticGather
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.scene import Pose

FORMAT = "gi-viewer reference 6"  # raise the number when paths change: old files are then ignored
KEY_NAME = "key"  # name of the array that holds a file's key
MOST_BYTES = 2 << 30  # of all files of static light; those of references stay
FOLDER_VARIABLE = "GI_VIEWER_REFERENCE_DIR"
SAVE_SECONDS = 20.0


def reference_folder() -> Path:
    """Return the folder of the files."""
    if folder := os.environ.get(FOLDER_VARIABLE):  # an empty path would be the current folder
        return Path(folder)
    return Path(platformdirs.user_cache_dir("gi-viewer", appauthor=False)) / "reference"


class RecordFile:
    """A NamedTuple of arrays, numbers and records, in a file: an .npz with one array per field."""

    def __init__(self, key: str) -> None:
        self.key_text = np.array(key)
        self.path = reference_folder() / f"{key}.npz"

    def read(self, like: Any) -> Any | None:
        """Return the stored record; None without a readable file of this key.

        like: a record with arrays of the same dtypes and columns, and of as many rows or more: no more is read.
        """
        try:
            with open(self.path, "rb", opener=at_once) as file:
                of = os.fstat(file.fileno())
                most = sum(a.nbytes for a in _arrays("", like).values()) + (1 << 16)  # headers
                if not stat.S_ISREG(of.st_mode) or of.st_size > most:
                    return None
                with zipfile.ZipFile(file) as parts:
                    if _read(parts, KEY_NAME, self.key_text) != self.key_text:
                        return None
                    return _read(parts, "", like)
        except (OSError, ValueError, KeyError, IndexError, EOFError, MemoryError, NotImplementedError, RuntimeError):
            return None
        except (zipfile.BadZipFile, zlib.error, SyntaxError, TypeError, struct.error):
            return None

    def save(self, record: Any) -> None:
        """Replace the file by a record. Raises OSError."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.path.exists() and not self.path.is_file():  # such as a link to a pipe, which waits for a reader
            self.path.unlink()
        remove_parts(self.path.parent)
        with replacing(self.path) as part, open(part, "wb") as file:
            np.savez(file, **{KEY_NAME: self.key_text}, **_arrays("", record))  # type: ignore[arg-type]

    def keep(self, record: Any) -> None:
        """Save a record if possible; without a file the next run starts again."""
        with contextlib.suppress(OSError):
            self.save(record)


def _arrays(name: str, value: Any) -> dict[str, np.ndarray]:
    """Return the arrays of a record by their names; None has none."""
    if value is None:
        return {}
    if isinstance(value, tuple):
        parts = zip(value._fields, value, strict=True)  # type: ignore[attr-defined]
        return {k: a for field, part in parts for k, a in _arrays(f"{name}.{field}" if name else field, part).items()}
    return {name: np.asarray(list(type(value)).index(value) if isinstance(value, enum.Enum) else value)}


def _read(parts: zipfile.ZipFile, name: str, like: Any) -> Any:
    """Return the value of a name; None where nothing is stored. Raises ValueError for another dtype or shape."""
    if isinstance(like, tuple):
        names = [f"{name}.{field}" if name else field for field in like._fields]  # type: ignore[attr-defined]
        if name and not any(n.startswith(f"{name}.") for n in parts.namelist()):
            return None
        return type(like)(*(_read(parts, n, part) for n, part in zip(names, like, strict=True)))
    asked = np.asarray(0 if isinstance(like, enum.Enum) else like)
    with parts.open(f"{name}.npy") as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError
        shape, by_columns, dtype = np.lib.format.read_array_header_1_0(file)
        if dtype != asked.dtype or by_columns or shape[1:] != asked.shape[1:] or len(shape) != asked.ndim:
            raise ValueError
        if shape and shape[0] > len(asked):
            raise ValueError
        size = math.prod(shape) * dtype.itemsize
        data = file.read(size + 1)
    if len(data) != size:
        raise ValueError
    array = np.frombuffer(bytearray(data), dtype).reshape(shape)
    if isinstance(like, enum.Enum):
        return list(type(like))[array.item()]
    return array.item() if isinstance(like, int | float) else array


class StaticStore(RecordFile):
    """The static part's light without mobiles, see `gi_core.gather.static`: one file for any mobiles."""

    def __init__(self, model: Model, seed: int) -> None:
        super().__init__("static-" + digest(FORMAT, model.static_key, int(seed)))
        self._model, self._seed = model, seed

    def load(self) -> StaticGather | None:
        """Return gathered light that goes on from the stored one; None without a sound file."""
        gathered = StaticGather(self._model, self._seed)
        kept = self.read(gathered.empty())
        return gathered if kept is not None and gathered.go_on_from(kept) else None

    def keep_light(self, static: StaticLight) -> None:
        """Save the light on show and the state of its gathering; the oldest files beyond MOST_BYTES go."""
        gathered = static.gathered or StaticGather(self._model, self._seed)
        self.keep(gathered.kept(static.best))
        with contextlib.suppress(OSError):
            files = sorted(self.path.parent.glob("static-*.npz"), key=lambda file: -file.stat().st_mtime)
            for file, bytes_so_far in zip(files, itertools.accumulate(f.stat().st_size for f in files), strict=True):
                if bytes_so_far > MOST_BYTES and file != self.path:
                    file.unlink()


class ReferenceStore(RecordFile):
    """The reference of some receivers of a model at one set of poses: its file and its steps."""

    def __init__(
        self,
        model: Model,
        poses: Mapping[str, Pose] | None = None,
        rows: np.ndarray | None = None,
        seed: int = 0,
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
        super().__init__(self.key())

    def load(self) -> ReferenceState | None:
        """Return the stored state; None without a readable file."""
        state = self.read(ReferenceState.empty(len(self.rows)))
        return state if state is not None and state.is_sound(len(self.rows)) else None

    def key(self) -> str:
        """Return the hash of all inputs."""
        s = self.model.surfaces
        poses = np.array([[*self.poses[name].position, *self.poses[name].quaternion] for name in self.model.names])
        of_points = self.positions, self.normals
        arrays: tuple[np.ndarray, ...] = *s.vertices, *s.faces, s.reflectance, s.emission, s.two_sided, *of_points
        if not np.isnan(s.lobe).all():
            arrays = *arrays, s.lobe
        if len(s.tables.head):
            arrays = *arrays, *s.tables, s.tangent
        if (self.levels != 1).any():
            arrays = *arrays, self.levels, self.model.lights_at(self.levels).area.radiance
        scene = self.model.scene
        lights = [(type(light).__name__, [np.asarray(v).tolist() for v in light[1:]]) for light in scene.lights]
        up = np.asarray(scene.up, float)
        return digest(FORMAT, lights, up, self.seed, "at poses", poses, *arrays, self.weights)

    def rounds(self, even: bool = False, load: bool = True) -> ReferenceRounds:
        """Return rounds from the stored state on (`load`); `even`: without a state, uniform paths for a picture."""
        state = self.load() if load else None
        weights = None if even and state is None else self.weights
        m, receivers = self.model, (self.positions, self.normals)
        return ReferenceRounds(
            m.scene, *receivers, self.seed, weights, self.poses, model=m, state=state, levels=self.levels
        )

    def gather(self, error: float) -> Iterator[Reached]:
        """Gather until the noise is at most `error` (0.01: 1 %), as gather_until() does.

        The state is saved every SAVE_SECONDS and at the end, also after Ctrl+C or a closed iterator, if possible.
        """
        rounds, saved = self.rounds(), time.monotonic()
        before = rounds.state.sets.sum(), np.isnan(rounds.state.pilot).sum()
        try:
            for reached in gather_until(rounds, self.weights, error, step=PATHS_AT_ONCE):
                if time.monotonic() - saved > SAVE_SECONDS:
                    self.keep(reached.state)
                    saved = time.monotonic()
                yield reached
        finally:
            if before != (rounds.state.sets.sum(), np.isnan(rounds.state.pilot).sum()):
                self.keep(rounds.state)
