"""Light by paths with mobiles in place: of mobiles in frames, and at resting poses, where it replaces a frame's own.

In frames, paths end in the static part's light (`gi_core.gather.mobile`); at rest see `gi_core.gather.pose_gather`.
Paths end in irradiance interpolated between the corners of a face. A face larger than the disc of an estimator may be
lit quite otherwise than its corners, as the two triangles of a wall are. Many photons hit such a face, so its flux is
known. Its reflectance is scaled such that interpolated light reflects it.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.pause import Progress, pause
from gi_core.display.dilation import Unreached, dilated
from gi_core.frames.background import Background
from gi_core.frames.edited_light import EditedAtPoses, LightAtPoses
from gi_core.gather.mobile import MobileGather
from gi_core.gather.pose_gather import STAGE, PoseGather, PoseGathers, Static
from gi_core.lights.lamps import mix
from gi_core.lights.light_sampling import Lights
from gi_core.model import Model
from gi_core.photons.paths import PathVertices
from gi_core.rays.accelerator import Transforms


class CoarseFaces(NamedTuple):
    """Static faces larger than a disc, and the flux that photons bring to them."""

    faces: np.ndarray  # (k,) int64
    flux: np.ndarray  # (k, 3 G) float64 [W], per lamp
    sure: np.ndarray  # (k,) bool, enough photons arrive

    @classmethod
    def of(cls, model: Model, paths: PathVertices, disc_area: float) -> CoarseFaces:
        """Count the paths of the first photons; disc_area [m2]."""
        s, lamps = model.surfaces, model.emitters.lamps
        coarse = np.flatnonzero(s.areas[s.face_range(0)] > disc_area)
        if not len(coarse):
            return cls(coarse, np.zeros((0, lamps.channels)), np.zeros(0, bool))
        photons, place = len(paths.offsets) - 1, np.full(s.face_range(0).stop, -1)
        place[coarse] = np.arange(len(coarse))
        arrived = paths.side >= 0
        arrived[paths.offsets[:-1]] = False  # the first vertex of a path is on the light
        arrived[arrived] = place[paths.side[arrived] >> 1] >= 0
        rows = np.flatnonzero(arrived)
        face, back = paths.side[rows] >> 1, paths.side[rows] & 1 > 0
        black = back & ~s.two_sided[face]  # the back of a one-sided face
        rows, at = rows[~black], place[face[~black]]
        lamp = paths.lamp[np.searchsorted(paths.offsets, rows, side="right") - 1] if lamps.count > 1 else 0
        cell, cells = at * lamps.count + lamp, len(coarse) * lamps.count
        sums = np.stack([np.bincount(cell, paths.flux[rows - 1, c], cells) for c in range(3)], axis=1)
        flux = sums.reshape(len(coarse), lamps.channels) * (model.emitters.unit_flux / photons)
        flux *= np.repeat(model.emitters.scale, 3)
        return cls(coarse, flux, np.bincount(at, minlength=len(coarse)) >= 100)  # noise of a tenth

    def reflectance(self, model: Model, light: np.ndarray, levels: np.ndarray) -> np.ndarray:
        """Return reflectance (F, 3) float64 of all faces, scaled on these such that interpolated light conserves flux.

        light (n, 3) [W/m2]: irradiance of the static receivers without mobiles, at levels (G, 3) of the lamps.
        """
        s, coarse = model.surfaces, self.faces
        if not len(coarse):
            return model.world.bsdfs.albedo
        flux = mix(self.flux, levels)
        received = light[s.corner_front[coarse]].mean(axis=1)
        received += np.where(s.two_sided[coarse, None], light[s.corner_back[coarse]].mean(axis=1), 0.0)
        received *= s.areas[coarse, None]
        out, where = model.world.bsdfs.albedo.copy(), self.sure[:, None] & (received > 0)
        out[coarse] *= np.divide(flux, received, out=np.ones(received.shape), where=where)
        return out


class AtRest(NamedTuple):
    """The static part without mobiles, None: unknown."""

    irradiance: np.ndarray | None  # (n, 3) float64 [W/m2] of its receivers
    reflectance: np.ndarray | None  # (F, 3) float64 of all faces, see `CoarseFaces`


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
        """Return reflectance (F, 3) of all faces for replace_in(), see `CoarseFaces`.

        static (n, 3) [W/m2]: irradiance of the static part without mobiles; unreached: its unreached receivers.
        """
        photons = b.estimate.photons
        if self._coarse is None or self._coarse[:2] != (b, photons):
            paths, _ = b.store.subset(min(photons, 1 << 16))  # some 5 ms
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


class PoseLight:
    """Light of the last poses, each at some levels (G, 3) of the lamps."""

    def __init__(self, model: Model, seed: int):
        self._model = model
        self._gathers = PoseGathers(model, seed)
        self._edited: EditedAtPoses | None = None

    def find(self, at: Transforms, levels: np.ndarray) -> PoseGather | None:
        """Return the light gathered at poses, None if there is none."""
        return self._gathers.find(at, levels)

    def replaced(
        self, E: np.ndarray, static: Callable[[], np.ndarray], at: Transforms, levels: np.ndarray
    ) -> np.ndarray:
        """Return irradiance E (R, 3) at poses, with light gathered there in its place; the same array where none was.

        static: returns that of the static part without mobiles (n, 3) [W/m2], as the frame has it.
        """
        out = E
        if (edited := self._edited_at(at, levels)) is not None:
            out = E.copy()
            out[edited.rows] = edited.irradiance(E, static())
        if (light := self.find(at, levels)) is not None and (shown := self._shown(light, edited)).any():
            out = E.copy() if out is E else out
            out[light.rows[shown]] = light.mean[shown]
        return out

    def _shown(self, light: PoseGather, edited: EditedAtPoses | None) -> np.ndarray:
        """Return which receivers (n,) bool show gathered light: in the end all do in place of light before an edit."""
        ended = edited is not None and light.enough and len(light.mean) > 0
        return np.ones(len(light.rows), bool) if ended else light.used

    def _edited_at(self, at: Transforms, levels: np.ndarray) -> EditedAtPoses | None:
        edited = self._edited
        return edited if edited is not None and edited.is_at(at, levels) else None

    def before_edit(
        self, irradiance: np.ndarray, own: np.ndarray, static: np.ndarray, deviation: np.ndarray, at: Transforms,
        levels: np.ndarray,
    ) -> LightAtPoses | None:  # fmt: skip
        """Return the light of a frame for the scene after an edit; None where none was gathered at its poses.

        irradiance, own (R, 3) [W/m2]: with that light and without; static (n, 3), deviation (R,): as in LightAtPoses.
        The light before edits in a row is that before the first.
        """
        if own is irradiance:
            return None
        edited, light = self._edited_at(at, levels), self.find(at, levels)
        if edited is not None and (light is None or not self._shown(light, edited).any()):
            return edited.before
        return LightAtPoses(self._model, at, levels, irradiance, own, static, deviation)

    def begin_with(self, before: LightAtPoses | None) -> None:
        """Show light before an edit, changed as frames say, until there is better; the static part is the same."""
        self._edited = None if before is None else EditedAtPoses(before, self._model)

    def deviation(self, at: Transforms, levels: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
        """Return the standard error (R,) of the luminance [W/m2] of light gathered at poses, elsewhere `otherwise`."""
        out = otherwise.copy()
        if (edited := self._edited_at(at, levels)) is not None:
            out[edited.rows] = edited.before.deviation[edited.rows_before]
        if (light := self.find(at, levels)) is not None and (shown := self._shown(light, edited)).any():
            out[light.rows[shown]] = light.deviation[shown]
        return out

    def gather(
        self, at: Transforms, levels: np.ndarray, photons: int, irradiance: np.ndarray, static: np.ndarray,
        disc_area: float, gathered: Callable[[], Static | None], refresh: Callable[[], None],
    ) -> None:  # fmt: skip
        """Gather at poses, see `PoseGather.gather`; refresh: called where frames change.

        irradiance (R, 3), static (n, 3) [W/m2]: of the frame of all `photons` there, and without mobiles; disc_area
        [m2]; gathered: returns the static part's light and its standard error once it is better than that of photons.
        """
        begun = self._gathers.begin(at, levels, photons, irradiance, static, disc_area)
        pause(Progress(STAGE, begun.fraction, False))

        def take() -> None:
            ended = begun.enough and self._edited_at(at, levels) is not None
            if changed := ended or bool(begun.used.any()):
                refresh()
            pause(Progress(STAGE, begun.fraction, changed))

        begun.gather(gathered, take)
