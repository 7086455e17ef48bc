"""Light of frames besides photons: gathered light of the static part, of mobiles, and at resting poses."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from gi_core.display.dilation import NONE_UNREACHED, Dilation, Drawn, dilated
from gi_core.frames.background import Background
from gi_core.frames.control_variate import AROUND
from gi_core.frames.earlier_light import EarlierLight, EditedLight, earlier_light
from gi_core.frames.gathered_gloss import GatheredGloss
from gi_core.frames.progress import Progress
from gi_core.gather import coarse_faces
from gi_core.gather.coarse_faces import CoarseFaces
from gi_core.gather.mobile import MobileGather
from gi_core.gather.pose_gather import PoseGather, PoseGathers, Static
from gi_core.gather.reference import ReferenceState
from gi_core.gather.static import StaticGather
from gi_core.geometry.error import luminance, noise_from_prefix, prefix_to_compare
from gi_core.geometry.mesh_neighbours import Neighbours, neighbours, scattered_neighbours
from gi_core.gloss import source
from gi_core.gloss.light import GlossLight
from gi_core.gloss.source import GlossSource
from gi_core.lights.light_sampling import Lights
from gi_core.lights.mix import mix, sum_of_lamps
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange
from gi_core.scene.rules import FLAG, one_of

LIGHTS = ("best", "photons")
PATHS = (4, 8, 16, 32, 64, 128, 256)  # per receiver and frame
REST = 64  # the default, with some 4 % of noise


def _photon_noise(shown: Background) -> float:
    """Return the relative l1 noise of a background's photons; inf where they are too few to measure it."""
    photons, fewer = shown.estimate.photons, prefix_to_compare(shown.estimate.prefixes)
    if fewer is None:
        return math.inf
    return noise_from_prefix(shown.resting(photons), shown.resting(fewer), photons, fewer, shown.weights)


class FrameSize(NamedTuple):
    """Photons and paths of a frame."""

    photons: int
    paths: int  # per receiver of a mobile; 0: photons light mobiles


class LightSource:
    """`light` is one of LIGHTS. "photons": the estimator lights everything.

    "best": mobiles gather their light in each frame (`mobile.py`), and the static part shows gathered light
    (`static.py`) once that has less noise than its photons. Either way, mobiles change the static part's light
    according to the frame's photons (`control_variate.py`). At poses that have rested, light gathered with mobiles in
    place replaces both (`pose_gather.py`). prefix_only: frames of a photon subset start from the static light of that
    subset, as in the report.
    """

    def __init__(self, model: Model, seed: int):
        self.light, self.prefix_only, self.levels = "photons", False, model.emitters.lamps.full()
        self.gathered: StaticGather | None = None
        self._edited: EditedLight | None = None  # until `gathered` has light of its own
        self.unreached = NONE_UNREACHED  # unreached static receivers, by the light of the last search
        self.dilation: Dilation | None = None
        self._model, self._seed = model, seed
        self._less_noise = False  # gathered light has less noise than all photons
        self._lights: Lights | None = None  # of one lamp, at these levels
        self._mobile: MobileGather | None = None
        self._mixed: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # light per lamp, levels, and their light
        self._around: tuple[float, Neighbours] | None = None  # distance, and static receivers within it
        self._at_poses = PoseGathers(model, seed)
        self._coarse: tuple[Background, int, CoarseFaces] | None = None  # of the photons of a background
        self._reflectance: tuple[np.ndarray, np.ndarray] | None = None  # for static light, see `coarse_faces`
        self._poses: dict[int, bytes] = {}  # by number of paths, of its last frame
        self.gloss_way, self.gloss_source = source.QUADTREE, GlossSource(model)
        self._gathered_gloss = GatheredGloss(model, seed, self.gloss_source)
        self.rays_traced = False  # in the last frame: mobiles had moved

    def twin(self, fresh: bool) -> LightSource:
        """Return a light source with separate settings and the same gathered light, or none if `fresh`."""
        other = copy.copy(self)
        if fresh:
            other.gathered, other._edited, other._less_noise = None, None, False
            other._at_poses = PoseGathers(self._model, self._seed)
            other._gathered_gloss = GatheredGloss(self._model, self._seed, self.gloss_source)
        return other

    def choose(self, light: str | None, prefix_only: bool | None, gloss: str | None = None) -> None:
        """Change the settings; None keeps one. Raises SceneError for an unknown light or way of gloss."""
        self.gloss_way = self.gloss_way if gloss is None else one_of(source.WAYS).check("gloss", gloss)
        self.light = self.light if light is None else one_of(LIGHTS).check("light", light)
        self.prefix_only = self.prefix_only if prefix_only is None else FLAG.check("prefix_only", prefix_only)

    # -- static part ------------------------------------------------------------------------------

    @property
    def is_without_stored_light(self) -> bool:
        """Whether frames may take gathered light, and there is none yet."""
        return self.light == "best" and self.gathered is None

    @property
    def is_gathered(self) -> bool:
        """Whether frames start from gathered static light: `light` is "best", and it has less noise than photons."""
        return self.light == "best" and not self.prefix_only and self._less_noise

    def begin_with(self, earlier: EarlierLight) -> None:
        """Show static light gathered before an edit, changed as photons say, until there is better."""
        self.gathered, self._edited = StaticGather(self._model, self._seed), EditedLight(earlier, self._model)

    @property
    def shows_earlier(self) -> bool:
        """Whether gathered light is that before an edit."""
        g = self.gathered
        return self._edited is not None and g is not None and (g.is_earlier or math.isinf(g.noise))

    def before_edit(self, shown: Background | None) -> EarlierLight | None:
        """Return the static light on show for the scene after an edit; None where photons alone light frames."""
        if shown is None or not shown.estimate.photons or self.light == "photons":
            return None
        if self.is_gathered and self.shows_earlier:
            return self._edited.earlier
        if self.is_gathered:
            return earlier_light(shown, self.gathered.per_lamp, self.gathered.deviation, self.gathered.error)
        light, noise = shown.resting_per_lamp(shown.estimate.photons), _photon_noise(shown)
        deviation = noise * luminance(sum_of_lamps(light))
        return earlier_light(shown, light, deviation, noise) if math.isfinite(noise) else None

    def gather_steps(
        self,
        state: ReferenceState | None,
        shown: Callable[[], Background | None],
        refresh: Callable[[], Iterator[Progress]],
    ) -> Iterator[Progress]:
        """Gather static light in steps, from `state` or continued; arguments as for StaticGather.

        shown: returns the background on show; refresh: computes its frame again, after each result that has less noise
        than photons. Raises ValueError for the state of another scene.
        """
        if self.gathered is None or state is not None:
            self.gathered = StaticGather(self._model, self._seed, state)
        g = self.gathered

        def photons() -> np.ndarray | None:
            b = shown()
            return b.resting_per_lamp(b.estimate.photons) if b is not None and b.estimate.photons else None

        for new in itertools.chain((True,), g.steps(photons)):
            if used := bool(new) and self.compare(shown()):
                yield from (p._replace(fraction=g.fraction) for p in refresh())
            yield Progress("gathering", g.fraction, used)
            if used and self._gathers_gloss:
                light, levels = self._gathered_at(self.levels), self.levels
                given = shown(), self._model.static, levels, light, np.arange(len(light))
                for p in self._gathered_gloss.steps(*given):
                    if p.picture:
                        yield from refresh()
                    yield p

    def lacks_gloss(self, shown: Background | None) -> bool:
        """Whether gather_steps() has directions of gathered light to gather, besides the light itself."""
        ready = shown is not None and shown.estimate.photons and self.is_gathered and self._gathers_gloss
        return bool(ready) and not self._gathered_gloss.is_enough(shown, self.levels)

    def compare(self, shown: Background | None) -> bool:
        """Compare the noise of gathered light and of all photons; return whether frames start from gathered light.

        Photons too few to measure their noise count as noisier.
        """
        g, photons = self.gathered, 0 if shown is None else shown.estimate.photons
        if photons and self.shows_earlier:
            self._edited.show(shown, self.around(AROUND * shown.setting.radius), g)
        if photons and g is not None and math.isfinite(g.noise):
            self._less_noise = g.left < _photon_noise(shown)
        return self.is_gathered

    def static_irradiance(self, shown: Background, photons: int) -> np.ndarray:
        """Return irradiance (n, 3) [W/m2] of static receivers without mobiles, for a frame of `photons` photons."""
        if self.is_gathered:
            return self._gathered_at(self.levels)
        return shown.resting(photons if self.prefix_only else shown.estimate.photons, self.levels)

    def resting_irradiance(self, shown: Background | None) -> np.ndarray:
        """Return static_irradiance() for all photons of the background on show; zeros without photons."""
        if shown is None or not (photons := shown.estimate.photons):
            return np.zeros((self._model.surfaces.receiver_range(0).stop, 3))
        return self.static_irradiance(shown, photons)

    def _gathered_at(self, levels: np.ndarray) -> np.ndarray:
        """Return gathered irradiance (n, 3) [W/m2] at levels (G, 3) of the lamps; the same array for the same light."""
        light = self.gathered.per_lamp
        if self._mixed is None or self._mixed[0] is not light or not np.array_equal(self._mixed[1], levels):
            self._mixed = light, levels, mix(light, levels, self._model.threads)
        return self._mixed[2]

    def around(self, distance: float) -> Neighbours:
        """Return some of the static receivers within a distance [m] of each; the last answer is kept."""
        if self._around is None or self._around[0] != distance:
            model = self._model
            static = model.surfaces.receiver_range(0)
            near = neighbours(model.corners(0), static.stop)
            points, normals = (a[static] for a in model.object_receivers[:2])
            self._around = distance, scattered_neighbours(near, points, normals, distance, model.threads)
        return self._around[1]

    @contextmanager
    def dimmed_to(self, levels: np.ndarray) -> Iterator[None]:
        """Set the levels (G, 3) of the lamps, from the next frame on; an exception takes them back."""
        before = self.levels, self._reflectance, self._lights
        self.levels, self._reflectance, self._lights = levels, None, None
        try:
            yield
        except BaseException:
            self.levels, self._reflectance, self._lights = before
            raise

    def find_unreached(self, size: float, shown: Background) -> Generator[None]:
        """Find unreached static receivers by this light, in steps; `size` [m] as in `dilation.py`."""
        if self.dilation is None:
            self.dilation = Dilation(self._model, size)
            yield
        # By the light of all lamps: without one of them, its places are dark, not unreached.
        light = self.gathered.mean if self.is_gathered else shown.resting_per_lamp(shown.estimate.photons)
        self.unreached = yield from self.dilation.find_static(sum_of_lamps(light))
        self._reflectance = None

    def dilated(self, irradiance: np.ndarray, at: Transforms) -> Drawn:
        """Return irradiance (R, 3) at poses for pictures, unreached receivers filled; as it is before the search."""
        if self.dilation is None:
            return Drawn(irradiance, None)
        return dilated(irradiance, self.unreached, self.dilation.find_moved(irradiance, at))

    # -- mobiles ----------------------------------------------------------------------------------

    def paths(self, wanted: int | None) -> int:
        """Return the paths per receiver of a mobile and frame, 0 where none are gathered; None: REST.

        Raises SceneError for a number that is not one of PATHS.
        """
        if wanted is not None:
            one_of(PATHS).check("the paths per receiver and frame", wanted)
        if self.light == "photons" or not self._model.names:
            return 0
        return REST if wanted is None else wanted

    def size(self, photons: int, paths: int | None = None) -> FrameSize:
        """Return the size of a frame; paths as for `paths()`. Without photons there are none."""
        return FrameSize(photons, self.paths(paths) if photons else 0)

    def bounce_reflectance(self, b: Background) -> np.ndarray:
        """Return reflectance (F, 3) for light_mobiles(), where a background is on show."""
        light, photons = self.static_irradiance(b, b.estimate.photons), b.estimate.photons
        if self._coarse is None or self._coarse[:2] != (b, photons):
            some, _ = b.store.prefix(min(photons, coarse_faces.PHOTONS))
            self._coarse = b, photons, CoarseFaces.of(b.model, some, math.pi * b.setting.radius**2)
        if self._reflectance is None or self._reflectance[0] is not light:
            filled = dilated(light, self.unreached).irradiance
            self._reflectance = light, self._coarse[2].reflectance(self._model, filled, self.levels)
        return self._reflectance[1]

    def light_mobiles(
        self, irradiance: np.ndarray, at: Transforms, paths: int, reflectance: np.ndarray | None = None, fresh=False
    ) -> None:
        """Replace the irradiance (R, 3) of receivers on mobiles by gathered light from the static part's.

        paths: one of PATHS; reflectance (F, 3): see `coarse_faces`; fresh: without caches of earlier frames.
        """
        gather, self._lights = self._mobile, self._lights or self._model.lights_at(self.levels)
        if fresh or gather is None:
            gather = MobileGather(self._model, self._seed)
        if not fresh:
            self._mobile = gather
            poses = at.rotation.tobytes() + at.position.tobytes()
            self.rays_traced, self._poses[paths] = self._poses.get(paths) != poses, poses
        static = irradiance[: gather.first]
        irradiance[gather.first :] = gather.irradiance(at, static, paths.bit_length() - 1, reflectance, self._lights)

    # -- gloss ------------------------------------------------------------------------------------

    def gloss_reach(self, radius: float, paths: int) -> float:
        """Return the distance [m] within which photons near mobiles matter for gloss; arguments as for gloss()."""
        return 0.0 if self._gloss_by_paths(paths) else self.gloss_source.reach(radius, self.gloss_way)

    def _gloss_by_paths(self, paths: int) -> bool:
        """Whether paths give the directions of light on mobiles: single rays come from photons."""
        return paths > 0 and self.gloss_way == source.QUADTREE

    def gloss(
        self, b: Background, change: PoseChange, clock: Callable[[str], None], paths: int = 0
    ) -> GlossLight | None:
        """Return the directional light of a frame; None without glossy faces. clock: called after each step.

        paths: of light_mobiles(), which has lit this frame; 0: photons light mobiles.
        """
        photons = b.store, b.store.prefix(b.estimate.photons)[0], b.store.weights(self.levels)
        rest = self._gathered_gloss.at_rest(b, self.levels) if self.is_gathered and self._gathers_gloss else None
        on_mobiles = self._cells_on_mobiles if self._gloss_by_paths(paths) else None
        light = self.gloss_source.light(self.gloss_way, b.setting.radius, photons, change, clock, rest, on_mobiles)
        if light is None or not self._gathers_gloss:
            return light
        return self._gathered_gloss.settle(light, b, change.at, self.levels)

    def _cells_on_mobiles(self, rows: np.ndarray, place: np.ndarray, resting: np.ndarray, out: np.ndarray) -> None:
        """Write cells from the paths of the last frame, see `CellWriter`."""
        if len(rows) and self._mobile is not None and (light := self._mobile.path_light) is not None:
            light.write_cells(rows - self._mobile.first, place, resting, out, self._model.threads)

    @property
    def _gathers_gloss(self) -> bool:
        """Whether frames take gathered directions: single rays come from photons."""
        return self.light == "best" and not self.prefix_only and self.gloss_way == source.QUADTREE

    def is_of_gloss(self, light: GlossLight | None) -> bool:
        """Return whether a frame's directional light is kept in the way that is chosen."""
        return light is None or light.opened == source.OPENED[self.gloss_way]

    # -- resting poses ----------------------------------------------------------------------------

    def pose_gather(self, at: Transforms) -> PoseGather | None:
        """Return the light gathered at poses, None if there is none or frames take none."""
        return self._at_poses.find(at, self.levels) if self.light == "best" and not self.prefix_only else None

    def pose_steps(
        self, shown: Background | None, photons: int, irradiance: np.ndarray, gloss: GlossLight | None, at: Transforms,
        refresh: Callable[[], None],
    ) -> Iterator[Progress]:  # fmt: skip
        """Gather light at poses, see `PoseGather.steps`; irradiance (R, 3) [W/m2] of the frame of `photons` there.

        gloss: of that frame; its directions come first, as they take few paths.
        refresh: computes the frame again. Nothing for a frame of few photons, and where frames take no gathered light.
        """
        if shown is None or not 0 < photons == shown.estimate.photons or not self._model.names:
            return
        if self.light == "photons" or self.prefix_only:
            return
        levels = self.levels
        if gloss is not None and self._gathers_gloss:
            changed = gloss.owners[gloss.changed]
            for p in self._gathered_gloss.steps(shown, at, levels, irradiance, changed):
                if p.picture:
                    refresh()
                yield p
        light = irradiance, self.static_irradiance(shown, photons)
        begun = self._at_poses.begin(at, self.levels, photons, *light, math.pi * shown.setting.radius**2)

        known: Static | None = None

        def static() -> Static | None:
            nonlocal known
            if not self.is_gathered:
                return None
            E = self._gathered_at(levels)
            if known is None or known[0] is not E:  # a fifth of a step's time
                known = E, self.gathered.deviation_at(levels)
            return known

        for changed in begun.steps(static):
            if changed:
                refresh()
            yield Progress("gathering at these poses", begun.fraction, bool(changed))

    def deviation(self, at: Transforms) -> np.ndarray:
        """Return the standard error (R,) of the luminance of gathered light at poses [W/m2]; 0: not gathered."""
        out = np.zeros(len(self._model.object_receivers.areas))
        if self.is_gathered:
            out[: len(self.gathered.deviation)] = self.gathered.deviation_at(self.levels)
        if (found := self.pose_gather(at)) is not None and found.used.any():
            out[found.rows[found.used]] = found.deviation[found.used]
        return out

    def settle(self, irradiance: np.ndarray, at: Transforms) -> None:
        """Replace irradiance (R, 3) where light was gathered at these poses."""
        if (found := self.pose_gather(at)) is not None and found.used.any():
            irradiance[found.rows[found.used]] = found.mean[found.used]
