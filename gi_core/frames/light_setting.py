"""Settings of the light of frames, besides those of the estimator; the size of a frame, and the size that fits a time.

A photon subset is a valid smaller solution with more noise. The noise differs between subsets, so switching between
them flickers. The size is therefore chosen when a motion begins. It becomes smaller only after several late frames in
a row, and larger with the next motion. Mobiles that gather their light come first: up to ENOUGH_PATHS in a share of
the budget. Photons follow, then more paths in the time that is left.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

import numpy as np

from gi_core.scene.rules import FLAG, one_of

LIGHTS = ("best", "photons")
QUADTREE, LIST, ALL_RAYS = WAYS = ("quadtree", "list", "all_rays")
OPENED = {QUADTREE: 0.0, LIST: -1.0, ALL_RAYS: 1 / 16}  # share of light above which rays are read, gloss-cells.md
# Per receiver of a mobile, on average: an eighth to a third apart, so that little of a frame's time stays unused.
PATHS = (4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256)
PATHS_AT_REST = 64  # the default, with some 4 % of noise


class FrameSize(NamedTuple):
    """Photons and paths of a frame."""

    photons: int
    paths: int  # per receiver of a mobile; 0: photons light mobiles


@dataclass(eq=False)
class LightSetting:
    """`light` is one of LIGHTS. "photons": the estimator lights everything. "best": gathered light has a part.

    levels (G, 3): of the lamps; never written to; `asked` (G, 3): the same, or more where lamps hold targets.
    subset_only: frames of a photon subset start from the static light of that subset, as in the report. gloss: how rays
    at glossy receivers are kept, one of WAYS.
    """

    levels: np.ndarray
    light: str = "photons"
    subset_only: bool = False
    gloss: str = QUADTREE

    def __post_init__(self) -> None:
        self.asked = self.levels

    def choose(self, light: str | None, subset_only: bool | None, gloss: str | None = None) -> None:
        """Change the settings; None keeps one. Raises SceneError for an unknown light or way of gloss."""
        self.gloss = self.gloss if gloss is None else one_of(WAYS).check("gloss", gloss)
        self.light = self.light if light is None else one_of(LIGHTS).check("light", light)
        self.subset_only = self.subset_only if subset_only is None else FLAG.check("subset_only", subset_only)

    @contextmanager
    def dimmed_to(self, levels: np.ndarray) -> Iterator[None]:
        """Set the levels (G, 3) of the lamps, from the next frame on; an exception takes them back."""
        before, self.asked, self.levels = (self.asked, self.levels), levels, levels
        try:
            yield
        except BaseException:
            self.asked, self.levels = before
            raise

    @property
    def takes_gathered(self) -> bool:
        """Whether frames may take gathered light of the static part, and at resting poses."""
        return self.light == "best" and not self.subset_only

    @property
    def takes_gathered_gloss(self) -> bool:
        """Whether frames may take gathered directions: single rays come from photons."""
        return self.takes_gathered and self.gloss == QUADTREE


TIMED = 3  # frames timed per size at rest: one of them may be disturbed by other load
ENOUGH_PATHS = 32  # ... so many paths, where photons are worth more: mobiles are then 3 to 5 % off
LEAST_PHOTONS = 1 << 14  # photons: of fewer, each cut photon leaves a dark blot
IN_A_ROW = 4  # late frames before fewer photons are used: one or two are disturbances


class FrameTimes:
    """Measured frame times by number of photons or paths, and predictions of others."""

    def __init__(self):
        self._seconds: dict[int, deque[float]] = {}

    def add(self, size: int, seconds: float) -> None:
        self._seconds.setdefault(size, deque(maxlen=9)).append(seconds)  # 9 frames per size, whose median counts

    def of(self, size: int) -> Sequence[float]:
        """Return the times of the last frames of a size [s]."""
        return self._seconds.get(size, ())

    def expected(self, size: int) -> float | None:
        """Return the predicted time of a size [s]; None without measurements.

        It is the median of the size's measurements, else on the line through the two nearest measured sizes, else
        proportional to the one measured.
        """
        times = {n: median(t) for n, t in self._seconds.items() if n}
        if not times or size in times:
            return times.get(size)
        near = sorted(times, key=lambda n: abs(n - size))[:2]
        if len(near) == 1 or times[max(near)] <= times[min(near)]:
            return times[near[0]] * size / near[0]
        a, b = sorted(near)
        slope = (times[b] - times[a]) / (b - a)
        return max(times[a] + slope * (size - a), 0.0)

    def largest_within(self, seconds: float, sizes: Sequence[int]) -> int:
        """Return the largest of ascending sizes predicted to fit; the smallest if none does or none is measured."""
        predicted = [(n, self.expected(n)) for n in sizes]
        return max((n for n, t in predicted if t is not None and t <= seconds), default=sizes[0])


class FrameBudget:
    """Sizes of frames: photons and paths per receiver of a mobile, as Solver.move_all() takes them. One per solver."""

    def __init__(self):
        self._photon_times, self._path_times = FrameTimes(), FrameTimes()
        self._size: tuple[int | None, int | None] = (None, None)  # of the motion
        self._chosen_for: float | None = None  # budget [s]; None: the next frame chooses
        self._late = 0  # frames in a row

    # -- costs ------------------------------------------------------------------------------------

    def record(self, size: FrameSize, timings: Mapping[str, float], rays_traced: bool) -> None:
        """Record the times of a frame's stages [s]; rays_traced: gathering traced rays, so its time counts."""
        gathering = timings.get("gather", 0.0)
        self._photon_times.add(size.photons, sum(timings.values()) - gathering)
        if size.paths and rays_traced:
            self._path_times.add(size.paths, gathering)

    def to_time(self, seconds: float, subsets: Sequence[int], gathers: bool) -> Iterator[tuple[int, int | None]]:
        """Yield the photons and paths of frames to record, smallest first, up to sizes that exceed a budget [s].

        subsets: photon subsets, ascending; gathers: whether mobiles gather their light. Every second number of paths
        is timed: times of the others lie between.
        """
        few = PATHS[0] if gathers else None
        paths = [(n, (subsets[0], n)) for n in PATHS[::2] if gathers]
        photons = [(n, (n, few)) for n in subsets[:-1]]
        for times, sizes in (self._path_times, paths), (self._photon_times, photons):
            for n, size in sizes:
                for _ in range(TIMED - len(times.of(n))):
                    yield size
                if (times.expected(n) or 0.0) > seconds:
                    break

    # -- choices ----------------------------------------------------------------------------------

    def within(self, seconds: float, subsets: Sequence[int], gathers: bool) -> tuple[int | None, int | None]:
        """Return the most photons and paths whose frame is predicted to fit; unknown costs count as too high.

        subsets: photon subsets, ascending; gathers: whether mobiles gather their light.
        """
        gathering = 0.7  # share of the budget for up to ...
        if not gathers:
            return (self._photon_times.largest_within(seconds, good_enough(subsets)) if subsets else None), None
        paths = self._path_times.largest_within(gathering * seconds, [n for n in PATHS if n <= ENOUGH_PATHS])
        if not subsets:
            return None, paths
        left = seconds - (self._path_times.expected(paths) or 0.0)
        photons = self._photon_times.largest_within(left, good_enough(subsets))
        if (spent := self._photon_times.expected(photons)) is not None:
            paths = self._path_times.largest_within(max(seconds - spent, (1.0 - gathering) * seconds), PATHS)
        return photons, paths

    def begin(self) -> None:
        """Begin a motion: the next frame chooses the size."""
        self._chosen_for = None

    def choose(self, seconds: float, subsets: Sequence[int], gathers: bool) -> tuple[int | None, int | None]:
        """Return the size of a motion's next frame: that of the first frame, or a smaller one after late frames.

        seconds: budget per frame; 0: always all photons and paths.
        """
        if seconds <= 0 or not subsets:
            self._size = None, None
        elif self._chosen_for != seconds or self._size[0] not in subsets:
            self._size, self._late = self.within(seconds, subsets, gathers), 0
        elif self._late >= IN_A_ROW and (smaller := [n for n in good_enough(subsets) if n < self._size[0]]):
            self._size, self._late = (smaller[-1], self._size[1]), 0
        self._chosen_for = seconds
        return self._size

    def moved(self, seconds: float) -> None:
        """Record the total time of a motion's frame [s]."""
        # frames longer than 1.5 times the budget are late
        late = self._size[0] is not None and seconds > 1.5 * self._chosen_for
        self._late = self._late + 1 if late else 0


def good_enough(subsets: Sequence[int]) -> list[int]:
    """Return the photon subsets with acceptable noise."""
    return [n for n in subsets if n >= min(LEAST_PHOTONS, subsets[-1])]
