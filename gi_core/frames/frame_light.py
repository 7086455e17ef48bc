"""Light of frames besides the estimate of their photons, in parts that do not know each other.

Paths light the mobiles in frames, where they end in the static part's light (`gi_core.gather.mobile`). At resting
poses, paths with mobiles in place replace a frame's own light (`gi_core.gather.pose_gather`). Paths end in irradiance
interpolated between the corners of a face. A face larger than the disc of an estimator may be lit quite otherwise than
its corners, as the two triangles of a wall are. Many photons hit such a face, so its flux is known. Its reflectance is
scaled such that interpolated light reflects it.
"""

from __future__ import annotations

import copy
import math
import operator
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gi_core.base.pause import Progress, pause
from gi_core.display.dilation import Unreached, UnreachedReceivers, dilated
from gi_core.frames.background import Background
from gi_core.frames.control_variate import Direct
from gi_core.frames.edited_light import EditedAtPoses, LightAtPoses
from gi_core.frames.frame_gloss import FrameGloss
from gi_core.frames.held_light import Held, HeldLevels
from gi_core.frames.light_setting import PATHS, PATHS_AT_REST, FrameSize, LightSetting
from gi_core.frames.static_light import StaticLight
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.estimate import Source
from gi_core.gather.mobile import MobileGather
from gi_core.gather.pose_gather import STAGE, PoseGather, PoseGathers, Static
from gi_core.geometry.error import luminance
from gi_core.gloss.light import GlossLight
from gi_core.lights.lamps import Lights, mix
from gi_core.model import Model
from gi_core.photons.paths import PathVertices
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange
from gi_core.scene.rules import one_of


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


# The light (R, 3) [W/m2] of a frame without light gathered at its poses, and the standard error (n,) that the change by
# mobiles brings to its luminance; None: unknown.
Lit = tuple[np.ndarray, np.ndarray | None]


class MobileLight:
    """Light on mobiles by paths of each frame. `rays_traced`: the last frame traced rays, as mobiles had moved."""

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
    """Light gathered at the last poses, each at some levels (G, 3) of the lamps."""

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


class FrameLight:
    """Light of frames besides the estimate. `setting` chooses among the parts.

    A frame begins with the light of the static part (`static`), changed by mobiles according to its photons
    (`control_variate.py`) and by the direct light that they block (`direct`). Paths of the frame light mobiles
    (`mobiles`). At poses that have rested, light gathered with mobiles in place replaces both (`at_poses`). `gloss` has
    the directions of all that light. `unreached` are the receivers that pictures fill. `held` are targets for which
    each frame finds the levels of the lamps, at most those asked for.
    """

    def __init__(self, model: Model, seed: int):
        self._model, self._seed = model, seed
        self.setting = LightSetting(model.emitters.lamps.full())
        self.static = StaticLight(model, seed, DirectLight(model, seed))
        self.unreached = UnreachedReceivers(model)
        self.mobiles = MobileLight(model, seed)
        self.gloss = FrameGloss(model, seed)
        self.at_poses = PoseLight(model, seed)
        self.held: Held | None = None

    def twin(self, fresh: bool) -> FrameLight:
        """Return light with a separate setting and the same gathered light, or none if `fresh`."""
        other = copy.copy(self)
        for name in ("setting", "static", "unreached", "mobiles", "gloss", "at_poses"):
            setattr(other, name, copy.copy(getattr(self, name)))
        if fresh:
            other.static = StaticLight(self._model, self._seed, self.direct)
            other.at_poses = PoseLight(self._model, self._seed)
            other.gloss.forget_gathered()
        return other

    # -- the static part --------------------------------------------------------------------------

    @property
    def is_gathered(self) -> bool:
        """Whether frames start from better light than that of photons: the setting allows it, and there is some."""
        return self.setting.takes_gathered and self.static.best is not None

    @property
    def source(self) -> Source:
        """The source of the static part's light without mobiles."""
        return self.static.best.source if self.is_gathered else Source.PHOTONS

    def static_irradiance(self, b: Background, photons: int) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] of the static part without mobiles, for a frame of `photons` photons."""
        setting = self.setting
        if setting.takes_gathered:
            return self.static.irradiance(b, setting.levels)
        return b.irradiance(photons if setting.subset_only else b.estimate.photons, setting.levels)

    def is_own(self, b: Background, photons: int) -> bool:
        """Whether static_irradiance() is that of the frame's own photons: nothing is a better source."""
        return not self.setting.takes_gathered and (self.setting.subset_only or photons == b.estimate.photons)

    def gather(self, shown: Callable[[], Background | None], refresh: Callable[[], None]) -> None:
        """Gather static light, and the directions of each result.

        shown: returns the background on show; refresh: computes its frame again, after each result that frames take.
        """

        def take() -> None:
            before = self.is_gathered
            self.static.compare(shown())
            if used := before or self.is_gathered:  # photons may have less error than was known
                refresh()
            pause(self.static.gathered.progress(picture=used))
            if self.is_gathered:
                b, static = shown(), self._model.static
                E = self.static.irradiance(b, self.setting.levels)
                self.gloss.gather(b, static, E, np.arange(len(E)), self.setting, refresh)

        self.static.gather(take)

    # -- direct light -----------------------------------------------------------------------------

    @property
    def direct(self) -> DirectLight:
        """Direct light of static receivers, known or not."""
        return self.static.direct

    def measure_direct(self) -> None:
        """Measure the static part's direct light, where frames take it."""
        if self.setting.takes_gathered:
            self.direct.measure()
            self.static.relight()

    def knows_direct(self, b: Background) -> bool:
        """Whether frames take direct light as it is, and bounced light alone from the photons of a background."""
        return self.setting.takes_gathered and self.static.direct_for(b) is not None

    def direct_at(self, at: Transforms, b: Background) -> Direct:
        """Return direct light at poses; zeros where photons bring it."""
        if not self.knows_direct(b):
            return Direct.unknown(self._model.surfaces.receiver_range(0).stop)
        levels = self.setting.levels
        return Direct(self.static.mixed("direct", self.direct.per_lamp, levels), self.direct.blocked(at, levels))

    def hold(self, held: HeldLevels | None) -> HeldLevels | None:
        """Take the levels that hold targets; None: those asked for."""
        levels = self.setting.asked if held is None else held.levels
        if not np.array_equal(levels, self.setting.levels):
            self.setting.levels = levels  # else the same array: light at it is kept
        return held

    # -- mobiles ----------------------------------------------------------------------------------

    def size(self, photons: int, paths: int | None = None) -> FrameSize:
        """Return the size of a frame. Without photons there are no paths.

        paths: per receiver of a mobile, None: PATHS_AT_REST. Raises SceneError for a number that is not one of PATHS.
        """
        if paths is not None:
            one_of(PATHS).check("the paths per receiver and frame", paths)
        gathers = photons and self.setting.light == "best" and self._model.names
        return FrameSize(photons, (PATHS_AT_REST if paths is None else paths) if gathers else 0)

    def light_mobiles(
        self, E: np.ndarray, at: Transforms, unbiased: np.ndarray, paths: int, b: Background, fresh: bool = False
    ) -> None:
        """Replace irradiance E (R, 3) [W/m2] of receivers on mobiles by light gathered from the static part.

        unbiased (>= n, 3) [W/m2]: of the static part at these poses; fresh: without caches of earlier frames.
        """
        self.mobiles.replace_in(E, at, unbiased, paths, self.setting.levels, self.at_rest(b), fresh)

    def at_rest(self, b: Background) -> AtRest:
        """Return the static part without mobiles, as paths from mobiles see it."""
        static = self.static_irradiance(b, b.estimate.photons)
        return AtRest(static, self.mobiles.reflectance(b, static, self.unreached.static, self.setting.levels))

    # -- resting poses ----------------------------------------------------------------------------

    def gathered_at(self, at: Transforms) -> PoseGather | None:
        """Return the light gathered at poses, None if there is none or frames take none."""
        return self.at_poses.find(at, self.setting.levels) if self.setting.takes_gathered else None

    def rested(self, E: np.ndarray, at: Transforms, b: Background, photons: int) -> np.ndarray:
        """Return irradiance (R, 3) of a frame with light gathered at its poses in its place; E where there is none."""
        if not self.setting.takes_gathered:
            return E
        return self.at_poses.replaced(E, lambda: self.static_irradiance(b, photons), at, self.setting.levels)

    def deviation(self, at: Transforms, b: Background | None, of_frame: Lit | None = None) -> np.ndarray:
        """Return the standard error (R,) of the luminance [W/m2] at poses, without that of the change of photons.

        of_frame: a frame there, None: any. With it the change by mobiles counts, and bias, as the static part's light
        has it on average; nan where one of these is not known, and where paths of the frame light mobiles.
        """
        out = np.full(len(self._model.object_receivers.areas), 0.0 if of_frame is None else np.nan)
        if not self.setting.takes_gathered:
            return out
        if of_frame is None:
            static = self.static.deviation(self.setting.levels)
            out[: len(static)] = static
        else:
            out = self.own_deviation(b, of_frame)
        return self.at_poses.deviation(at, self.setting.levels, out)

    def own_deviation(self, b: Background | None, now: Lit, since: tuple[FrameLight, Lit] | None = None) -> np.ndarray:
        """Return the standard error (R,) [W/m2] of the luminance of a frame, or of its change since another one.

        Errors of the same static light cancel where mobiles keep the same share of it and lamps have the same levels.
        Photons of the two changes by mobiles count as independent. They are partly the same, and most of these change
        both frames in the same direction. What is unknown is so as for deviation().
        """
        out, n = np.full(len(now[0]), np.nan), self._model.surfaces.receiver_range(0).stop
        levels, kept = self.setting.levels, self._kept(b, now[0])
        if since is None:
            static, changes = kept * self.static.deviation(levels), [now[1]]
        else:
            earlier, before = since
            dimmed, kept_before = np.abs(levels - earlier.setting.levels), earlier._kept(b, before[0])
            static = kept * self.static.deviation(dimmed)
            static += np.abs(kept - kept_before) * self.static.deviation(earlier.setting.levels)
            changes = [now[1], before[1]]
        if all(change is not None for change in changes):
            out[:n] = np.sqrt(static**2 + np.square(changes).sum(axis=0))
        return out

    def _kept(self, b: Background | None, irradiance: np.ndarray) -> np.ndarray:
        """Return the error (n,) of the static part's light that a frame (R, 3) [W/m2] keeps, over its noise."""
        n = self._model.surfaces.receiver_range(0).stop
        now, light = luminance(irradiance[:n]), luminance(self.static_irradiance(b, 0))
        kept = np.minimum(np.divide(now, light, out=np.ones(n), where=light > 0), 1.0)  # in shadow, of its error
        return kept * (self.static.best.understated if self.static.best is not None else np.nan)

    def before_edit(
        self, b: Background, photons: int, irradiance: np.ndarray, own: np.ndarray, at: Transforms
    ) -> LightAtPoses | None:
        """Return the light of a frame for the scene after an edit; None where none was gathered at its poses."""
        light = irradiance, own, self.static_irradiance(b, photons), self.deviation(at, b)
        return self.at_poses.before_edit(*light, at, self.setting.levels)

    def gather_at_poses(
        self, shown: Background | None, photons: int, irradiance: np.ndarray, gloss: GlossLight | None, at: Transforms,
        refresh: Callable[[], None],
    ) -> None:  # fmt: skip
        """Gather light at the poses `at`. Nothing is gathered unless the frame has all photons.

        irradiance (R, 3) [W/m2] and gloss are those of the frame of `photons` at these poses. Directions of
        gloss come first, because they take few paths. `refresh` computes the frame again. Settings without gathered
        light gather nothing.
        """
        if shown is None or not 0 < photons == shown.estimate.photons:
            return
        setting = self.setting
        if not self._model.names or not setting.takes_gathered:
            return

        latest: Static | None = None

        def static() -> Static | None:
            nonlocal latest
            if not self.is_gathered:
                return None
            E = self.static.irradiance(shown, setting.levels)
            if latest is None or latest[0] is not E:  # a fifth of a step's time
                best = self.static.best
                latest = E, best.understated * best.deviation_at(setting.levels)
            return latest

        light = self.static_irradiance(shown, photons)
        area = math.pi * shown.setting.radius**2
        if gloss is not None:
            self.gloss.gather(shown, at, irradiance, gloss.owners[gloss.changed], setting, refresh)
        self.at_poses.gather(at, setting.levels, photons, irradiance, light, area, static, refresh)

    # -- gloss ------------------------------------------------------------------------------------

    def gloss_at(
        self, b: Background, change: PoseChange, clock: Callable[[str], None], paths: int
    ) -> GlossLight | None:
        """Return the directional light of a frame; None without glossy faces. clock: called after each step.

        paths: to each receiver of a mobile, which have lit this frame; 0: photons light mobiles.
        """
        return self.gloss.light(b, change, clock, self.setting, self.is_gathered, self.mobiles.write_cells, paths)

    def lacks_gloss(self, shown: Background | None) -> bool:
        """Whether gather() has directions of gathered light to gather."""
        ready = shown is not None and shown.estimate.photons and self.is_gathered
        return bool(ready) and self.gloss.lacks_static(shown, self.setting)
