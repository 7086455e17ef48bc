"""Light of mobiles in frames, gathered by paths that end in the static part's light (`gi_core.gather.mobile`)."""

from __future__ import annotations

import copy
import math
import operator
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.frames.background import Background
from gi_core.frames.frame_size import PATHS, PATHS_AT_REST, FrameSize
from gi_core.frames.static_light import StaticLight
from gi_core.frames.unreached import UnreachedReceivers
from gi_core.gather import coarse_faces
from gi_core.gather.coarse_faces import CoarseFaces
from gi_core.gather.mobile import MobileGather
from gi_core.lights.light_sampling import Lights
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.scene.rules import one_of


class AtRest(NamedTuple):
    """The static part without mobiles, None: unknown."""

    irradiance: np.ndarray | None  # (n, 3) float64 [W/m2] of its receivers
    reflectance: np.ndarray | None  # (F, 3) float64 of all faces, see `coarse_faces`


NOTHING_KNOWN = AtRest(None, None)


class MobileLight:
    """`rays_traced` tells whether the last frame traced rays: mobiles had moved."""

    def __init__(self, model: Model, seed: int, static: StaticLight, unreached: UnreachedReceivers):
        self.rays_traced = False
        self._model, self._seed, self._static, self._unreached = model, seed, static, unreached
        self._gather: MobileGather | None = None
        self._poses: dict[int, bytes] = {}  # by number of paths, of its last frame
        self._lights: tuple[np.ndarray, Lights] | None = None  # levels, and lights of one lamp at these
        self._coarse: tuple[Background, int, CoarseFaces] | None = None  # of the photons of a background
        self._reflectance: tuple[tuple, np.ndarray] | None = None  # static light, unreached, levels; theirs

    def twin(self, static: StaticLight, unreached: UnreachedReceivers) -> MobileLight:
        """Return the light of mobiles for other static light, with the same hits of rays."""
        other = copy.copy(self)
        other._static, other._unreached = static, unreached
        return other

    def paths(self, wanted: int | None) -> int:
        """Return the paths per receiver of a mobile and frame, 0 where none are gathered; None: PATHS_AT_REST.

        Raises SceneError for a number that is not one of PATHS.
        """
        if wanted is not None:
            one_of(PATHS).check("the paths per receiver and frame", wanted)
        if self._static.setting.light == "photons" or not self._model.names:
            return 0
        return PATHS_AT_REST if wanted is None else wanted

    def size(self, photons: int, paths: int | None = None) -> FrameSize:
        """Return the size of a frame; paths as for `paths()`. Without photons there are none."""
        return FrameSize(photons, self.paths(paths) if photons else 0)

    def at_rest(self, b: Background) -> AtRest:
        """Return the static part without mobiles for replace_in(), where a background is on show."""
        photons, levels = b.estimate.photons, self._static.setting.levels
        light = self._static.irradiance(b, photons)
        if self._coarse is None or self._coarse[:2] != (b, photons):
            some, _ = b.store.subset(min(photons, coarse_faces.MOST_PHOTONS))
            self._coarse = b, photons, CoarseFaces.of(b.model, some, math.pi * b.setting.radius**2)
        given = light, self._unreached.static, levels
        if self._reflectance is None or not all(map(operator.is_, self._reflectance[0], given)):
            filled = self._unreached.filled(light)
            self._reflectance = given, self._coarse[2].reflectance(self._model, filled, levels)
        return AtRest(light, self._reflectance[1])

    def rays_ahead(self, at: Transforms, paths: int) -> list[Callable[[], None]]:
        """Return calls that trace rays of the next replace_in() at these poses, before its light is known."""
        return self._gather.rays_ahead(at, paths) if self._gather is not None and paths else []

    def replace_in(
        self, irradiance: np.ndarray, at: Transforms, static: np.ndarray, paths: int,
        resting: AtRest = NOTHING_KNOWN, fresh=False,
    ) -> None:  # fmt: skip
        """Replace the irradiance (R, 3) of receivers on mobiles by light gathered from the static part.

        static (>= n, 3) [W/m2]: irradiance of static receivers at these poses, without bias. paths: one of PATHS;
        resting: as at_rest() returns it; fresh: without caches of earlier frames.
        """
        levels = self._static.setting.levels
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
