"""The first frame: photons traced and estimated in steps, with pictures in between."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gi_core.base.fixed_point import MAX_PHOTONS
from gi_core.base.pause import Progress, pause
from gi_core.estimators import ESTIMATORS
from gi_core.estimators.base import Setting
from gi_core.frames.background import Background, Photons
from gi_core.frames.frame import Frame
from gi_core.frames.frame_light import FrameLight
from gi_core.frames.light_setting import OPENED
from gi_core.gather.static import ALL_PATHS
from gi_core.lights.emission import FEW
from gi_core.model import Model
from gi_core.photons.flux_sums import is_level, next_level

FIRST_STEP_SECONDS = 0.08  # the same before the first picture: nothing can be dragged yet
FIRST_PICTURE = 16_384  # photons: a tenth of a second; fewer are too noisy
MANY_RECEIVERS = 30_000  # measuring their regions takes half a second and more
EARLY_PATHS = 112  # per receiver, before photons beyond the first picture: their light has less noise for its time
DRAGGED = 1 << 17  # photons, as many as frames of a drag take: the rest of radiosity comes before more
RECENT = 3  # backgrounds kept: one per shipped estimator


def _after(b: Background) -> int:
    """Return the photons of the picture after that of all photons in a background."""
    # Where sums are additive, a picture costs one frame, little compared with 262,144 photons; else it estimates again.
    more = 1.19 if b.added >= 1 << 18 else 1.41
    return int((more if b.estimate.additive else 2.0) * b.added)


class FirstFrame:
    """Builder of the backgrounds of settings. Finished parts stay if work is broken off at a pause.

    The last RECENT backgrounds stay too: a return to their setting shows its light at once. They go if memory is short.
    """

    def __init__(self, photons: Photons, light: FrameLight):
        self._photons, self._light = photons, light
        self.by_flux = photons  # the first ones
        self._recent: list[Background] = []  # newest last

    def begin_with(self, b: Background) -> Background:
        """Go on from a background of a scene with the same static part; return it, with photons here."""
        own = b.copied(self.by_flux)
        self._recent = [own]
        return own

    @property
    def is_begun(self) -> bool:
        """Whether some photons have been estimated."""
        return any(b.added for b in self._recent)

    def share(self, model: Model) -> None:
        """Take the photons that the levels of lamps ask for: shared by flux, or new ones where few of those count.

        model: whose lamps share photons by flux.
        """
        levels = self._light.setting.asked
        if model.emitters.effective(levels) >= FEW:
            self._photons = self.by_flux  # still traced, and perhaps estimated
            return
        model = model.with_shares(model.emitters.shares_at(levels))
        if not np.array_equal(model.emitters.scale, self._photons.model.emitters.scale):
            self._photons = Photons(model, self._photons.seed)
            self._recent = [b for b in self._recent if b.store is self.by_flux]

    def twin(self, light: FrameLight, shown: Photons) -> FirstFrame:
        """Return a builder with the same photons and no background; shown: photons of the frame on show."""
        other = FirstFrame(self.by_flux, light)
        other._photons = shown
        return other

    def _worth(self, shown: Background) -> int:
        """Return the number of new photons that bring as little noise as those of a background."""
        levels = self._light.setting.asked
        new, old = (store.model.emitters.effective(levels) for store in (self._photons, shown.store))
        return round(shown.estimate.photons * (old / new))

    def background(self, setting: Setting, shown: Background | None, wanted: int) -> Background:
        """Return the background to continue: the one on show, or a recent one, if it fits the setting."""
        candidates = [b for b in (shown, *self._recent) if b is not None]
        fitting = [b for b in candidates if b.store is self._photons and b.setting == setting and b.added <= wanted]
        chosen = max(fitting, key=lambda b: b.added, default=None) or Background(self._photons, setting)
        newest = [b for b in (shown, chosen) if b is not None]
        self._recent = [*(b for b in self._recent if b not in newest), *dict.fromkeys(newest)][-RECENT:]
        return chosen

    def extend(
        self, setting: Setting, frame: Callable[[], Frame], wanted: Callable[[], int], pictures: bool,
        show: Callable[[Background], None],
    ) -> None:  # fmt: skip
        """Extend the background of a setting to all photons wanted, or as many as memory holds.

        frame: returns the frame on show; wanted: returns the photons, called before each step; show: computes a frame.
        """
        long_step_seconds = 1.0  # the same without pictures: the paths of a step take memory twice
        step_seconds = 0.02  # aim per step; of 6 ms, a third would be overhead
        shown, first = frame().background, 0  # photons of an uncontrolled picture, which stay traced
        seconds = (step_seconds if shown is not None else FIRST_STEP_SECONDS) if pictures else long_step_seconds
        if pictures and wanted() and shown is None and not self.is_begun and self._is_slow(setting):
            shown = self._uncontrolled(setting, wanted(), show)
            seconds, first = step_seconds, shown.added
        b = self.background(setting, shown, wanted())
        _build(b, first / max(wanted(), 1))
        returns = shown not in (None, b)
        # Gathered light of less error need not wait for as many photons.
        replaced = self._worth(shown) if returns and not self._compare(b) else 0
        if pictures and returns and max(FIRST_PICTURE, replaced) <= b.added < wanted():
            self.show(b, wanted(), show)
        due = max(FIRST_PICTURE, replaced, _after(b)) if pictures else MAX_PHOTONS  # photons of the next picture
        while b.added < (goal := self._affordable(wanted(), b)):
            if b.added not in b.estimate.subsets and _is_subset(b, goal, pictures):
                _prepare(b, max(b.added, first) / goal)
            had = b.added
            until = min(goal, max(due, had + 1), next_level(had))  # the next picture or level
            work = self._photons.bring_in(b, until, goal, seconds)
            pause(Progress(work.value, max(b.added, first) / goal, False))
            if b.added == had:
                continue
            if due <= b.added < goal:
                self._show_early(b, goal, show)
                due = _after(b)
                seconds = step_seconds if pictures else long_step_seconds
        f, as_asked = frame(), (self._light.size(goal), self._light.is_gathered, True)
        as_shown = f.size, f.gathered, f.gloss is None or f.gloss.opened == OPENED[self._light.setting.gloss]
        if b is not f.background or f.photons_at_rest != goal or as_shown != as_asked:
            self.show(b, goal, show)

    def _affordable(self, wanted: int, b: Background) -> int:
        """Return the wanted photons that fit into memory; recent backgrounds give way."""
        photons, each = self._photons, b.estimate.bytes_per_hit
        fit = photons.affordable(wanted, each)
        if photons.memory_full and len(self._recent) > 1:
            self._recent = [b]
            fit = photons.affordable(wanted, each)
        return fit

    def show(self, b: Background, wanted: int, show: Callable[[Background], None], direct: bool = True) -> None:
        """Prepare the photons added, and compute the frame from them; direct: measure direct light first."""
        fraction = b.added / max(wanted, 1)
        _prepare(b, fraction)
        if direct:
            pause(Progress("measuring direct light", fraction, False))
            self._light.measure_direct()
        if self._compare(b) or b.added == wanted > 0:  # few photons leave gaps in their own light
            pause(Progress("looking for unreached receivers", fraction, False))
            self.find_unreached(b)
        show(b)
        pause(Progress("estimating", fraction, True))

    def _show_early(self, b: Background, wanted: int, show: Callable[[Background], None]) -> None:
        """Show a picture of fewer photons than wanted; gather EARLY_PATHS first, and all radiosity from DRAGGED on."""
        static, is_shown = self._light.static, False

        def take() -> None:
            nonlocal is_shown
            if static.compare(b):
                is_shown = True
                if self._light.direct.rays > 1 << 22:  # half a second on two cores
                    self.show(b, wanted, show, direct=False)
                self.show(b, wanted, show)

        if static.shows_earlier:
            pause(Progress("measuring direct light", b.added / wanted, False))
            self._light.measure_direct()  # bounces before an edit are lit by it
            static.compare(b)
        paths = EARLY_PATHS if b.added < DRAGGED else ALL_PATHS
        if self._light.setting.takes_gathered and static.is_early(paths):
            pause(Progress("gathering", b.added / wanted, False))
            static.gather(take, paths)
        if not is_shown:
            self.show(b, wanted, show)

    def _compare(self, b: Background) -> bool:
        """Compare the errors of all static light; return whether frames start from better light than photons'."""
        self._light.static.compare(b)
        return self._light.is_gathered

    def find_unreached(self, b: Background) -> None:
        """Find unreached receivers by the static part's light."""
        light = self._light.static.of_all_lamps(b, self._light.setting.takes_gathered)
        self._light.unreached.find(light)

    def _uncontrolled(self, setting: Setting, wanted: int, show: Callable[[Background], None]) -> Background:
        """Show the first photons without artifact control, as regions may take seconds; return the background."""
        b = Background(self._photons, setting._replace(control=False))
        _build(b, 0.0)
        first = min(FIRST_PICTURE, wanted)
        while b.added < first:
            if b.added not in b.estimate.subsets and _is_subset(b, first, pictures=True):
                _prepare(b, b.added / wanted)
            work = self._photons.bring_in(b, min(first, next_level(b.added)), first, FIRST_STEP_SECONDS)
            pause(Progress(work.value, b.added / wanted, False))
        self._show_early(b, wanted, show)
        return b

    def _is_slow(self, setting: Setting) -> bool:
        controlled = (
            setting.control and ESTIMATORS[setting.estimator].controlled and not self._light.static.shows_earlier
        )
        return controlled and len(self._photons.model.object_receivers.areas) > MANY_RECEIVERS


def _is_subset(b: Background, goal: int, pictures: bool) -> bool:
    """Return whether the photons added are a subset to keep: a level, or that which measures the noise of all.

    That is the last level up to half of them; further ones would cost an estimate of everything each.
    """
    return is_level(b.added) and (b.estimate.additive or (pictures and 2 * b.added <= goal < 4 * b.added))


def _build(b: Background, fraction: float) -> None:
    pause(Progress("indexing", fraction, False))
    b.build()


def _prepare(b: Background, fraction: float) -> None:
    pause(Progress("estimating", fraction, False))
    b.estimate.prepare(b.added)
