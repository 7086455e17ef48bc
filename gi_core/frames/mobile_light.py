"""Light of mobiles in frames, gathered by paths that end in the static part's light (`gi_core.gather.mobile`)."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.display.dilation import Unreached, dilated
from gi_core.frames.background import Background
from gi_core.gather import coarse_faces
from gi_core.gather.coarse_faces import CoarseFaces
from gi_core.gather.mobile import MobileGather
from gi_core.lights.light_sampling import Lights
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms


class AtRest(NamedTuple):
    """The static part without mobiles, None: unknown."""

    irradiance: np.ndarray | None  # (n, 3) float64 [W/m2] of its receivers
    reflectance: np.ndarray | None  # (F, 3) float64 of all faces, see `coarse_faces`


NOTHING_KNOWN = AtRest(None, None)


class MobileLight:
    """`rays_traced` tells whether the last frame traced rays: mobiles had moved."""

    def __init__(self, model: Model, seed: int):
        self.rays_traced = False
        self._model, self._seed = model, seed
        self._gather: MobileGather | None = None
        self._poses: dict[int, bytes] = {}  # by number of paths, of its last frame
        self._lights: tuple[np.ndarray, Lights] | None = None  # levels, and lights of one lamp at these
        self._coarse: tuple[Background, int, CoarseFaces] | None = None  # of the photons of a background
        self._reflectance: tuple[tuple, np.ndarray] | None = None  # static light, unreached, levels; theirs

    def reflectance(self, b: Background, static: np.ndarray, unreached: Unreached, levels: np.ndarray) -> np.ndarray:
        """Return reflectance (F, 3) of all faces for replace_in(), see `coarse_faces`.

        static (n, 3) [W/m2]: irradiance of the static part without mobiles; unreached: its unreached receivers.
        """
        photons = b.estimate.photons
        if self._coarse is None or self._coarse[:2] != (b, photons):
            paths, _ = b.store.subset(min(photons, coarse_faces.MOST_COUNTED))
            self._coarse = b, photons, CoarseFaces.of(b.model, paths, math.pi * b.setting.radius**2)
        inputs = static, unreached, levels
        if self._reflectance is None or not all(map(operator.is_, self._reflectance[0], inputs)):
            filled = dilated(static, unreached).irradiance
            self._reflectance = inputs, self._coarse[2].reflectance(self._model, filled, levels)
        return self._reflectance[1]

    def rays_ahead(self, at: Transforms, paths: int) -> list[Callable[[], None]]:
        """Return calls that trace rays of the next replace_in() at these poses, before its light is known."""
        return self._gather.rays_ahead(at, paths) if self._gather is not None and paths else []

    def replace_in(
        self, irradiance: np.ndarray, at: Transforms, static: np.ndarray, paths: int, levels: np.ndarray,
        resting: AtRest = NOTHING_KNOWN, fresh: bool = False,
    ) -> None:  # fmt: skip
        """Replace the irradiance (R, 3) of receivers on mobiles by light gathered from the static part.

        static (>= n, 3) [W/m2]: irradiance of static receivers at these poses, without bias. paths: one of PATHS;
        levels (G, 3): of the lamps; resting: the static part without mobiles; fresh: without caches of earlier frames.
        """
        if self._lights is None or self._lights[0] is not levels:
            self._lights = levels, self._model.lights_at(levels)
        gather = self._gather
        if fresh or gather is None:
            gather = MobileGather(self._model, self._seed)
        if not fresh:
            self._gather = gather
            poses = at.rotation.tobytes() + at.position.tobytes()
            self.rays_traced, self._poses[paths] = self._poses.get(paths) != poses, poses
        lit = gather.irradiance(at, static, paths, resting.reflectance, self._lights[1], resting.irradiance)
        np.maximum(lit, 0.0, out=irradiance[gather.first :])

    def write_cells(self, rows: np.ndarray, place: np.ndarray, resting: np.ndarray, out: np.ndarray) -> None:
        """Write cells of gloss from the paths of the last frame, see `CellWriter`."""
        if len(rows) and self._gather is not None and (light := self._gather.path_light) is not None:
            light.write_cells(rows - self._gather.first, place, resting, out, self._model.threads)
