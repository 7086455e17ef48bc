"""The contract of an estimator, irradiance at receivers from the paths of photons, and its settings.

Order of use: `build()` once; `add_background()` with the next photons and `prepare()`, again and again;
`wanted()` and `evaluate()` per frame. `build()`, `prepare()` and `evaluate()` pause every few ms
(`gi_core.base.pause`). Sums are fixed-point flux units, per lamp: 3 G columns for G lamps
(`gi_core.lights.lamps`), and a segment adds to those of its own. Irradiance [W/m2] is sums x flux unit /
(photons x area). R: all receivers, n: those of the static part, which come first.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import NamedTuple, Self

import numpy as np

from gi_core.base.fixed_point import MAX_PHOTONS
from gi_core.discs.search import DEFAULT, Search
from gi_core.discs.stale_receivers import ControlFacts
from gi_core.estimators.counting import Counts, Find, Place
from gi_core.model import Model
from gi_core.photons.flux_sums import BackgroundSums, Evaluated, FrameSums, SubsetStore
from gi_core.photons.paths import Segments
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange, Wanted
from gi_core.scene.errors import SceneError
from gi_core.scene.rules import FLAG, LENGTH, one_of, whole


class Setting(NamedTuple):
    """Settings of an estimator; `search` changes its time, not its bits."""

    estimator: str  # a key of ESTIMATORS
    radius: float  # of the disc, or the largest of a search [m]
    neighbours: int  # k of photon_map
    control: bool = True  # artifact control of tangent_plane, see `gi_core.discs.region`
    search: str = DEFAULT  # a key of `gi_core.discs.search.SEARCHES`: how tangent_plane finds disc intersections
    border_correction: bool = True  # photon_map at borders: alpha / 2 pi of a disc, `receiver_classes`
    textbook: bool = False  # photon_map counts the k-th hit too, as in the report: k / (k - 1) too much

    def changed(self, choices: Mapping[str, Mapping], **values) -> Setting:
        """Return the setting with the given values replaced; None keeps a value.

        choices: the registries of fields that name something. Raises SceneError for a bad value.
        """
        for name in values:
            if name not in self._fields:
                raise SceneError(f"there is no setting {name!r}; there are {', '.join(self._fields)}")
        rules = RULES | {name: one_of(names) for name, names in choices.items()}
        return self._replace(**{n: rules[n].check(n, value) for n, value in values.items() if value is not None})


RULES = {
    "photons": whole(0, MAX_PHOTONS), "neighbours": whole(1, 100_000), "threads": whole(1, 1024),
    "seed": whole(0, 2**63 - 1), "radius": LENGTH,
    "control": FLAG, "border_correction": FLAG, "textbook": FLAG,
}  # fmt: skip


def checked(name: str, value, kept=None, where: str = ""):
    """Return the value of a setting, or `kept` for None. Raises SceneError beyond the range of its name."""
    return kept if value is None else RULES[name].check(where + name, value)


class Estimator(ABC):
    """An estimate of the light of the photons added so far, under one setting."""

    # Facts that are read from the class, before one is made.
    about: str  # one sentence: the tooltip of the panel's combo
    additive: bool  # sums of parts add up to sums of the whole: prepare() costs hardly anything, direct light is apart
    controlled = False  # the setting `control` (artifact control) has an effect
    on_faces = False  # light is counted by faces: a probe takes that of the face beneath it
    smoothing: str | None = None  # the field of Setting that trades noise for bias, "radius" or "neighbours"

    def __init__(self, model: Model, setting: Setting) -> None:
        """Hold a scene and a setting; work that takes long belongs into build()."""
        self.model = model
        self.photons = 0  # that the last prepare() covered
        self.subsets = SubsetStore()  # photon subsets that evaluate() and background() accept
        self.control_facts = ControlFacts(0.0, 0, 0)  # receivers under correction in the last frame
        self.searches: list[Search] = []  # over the discs of each object, static part first; none before build()

    @property
    def bytes_per_hit(self) -> int:
        """Bytes stored per path vertex besides the path itself. The solver bounds photons by free memory with it."""
        return 0

    @abstractmethod
    def copied(self, model: Model, setting: Setting) -> Self:
        """Return a copy of all that was added, for a model of the same static part and for the same setting.

        Its build() has to run again, as mobiles may be others. Neither changes the other later.
        """

    @staticmethod
    def summary(setting: Setting) -> str:
        """Return the settings that change its light, in words; "" for none. Shown by chart."""
        return ""

    def build(self) -> None:  # noqa: B027
        """Build the structures that do not depend on photons."""

    @abstractmethod
    def add_background(self, segments: Segments, thread: int) -> None:
        """Add segments (k) of the next photons, traced through the static part alone.

        Several threads call it at the same time, each with its own number; in any order of the photons.
        """

    @abstractmethod
    def prepare(self, photons: int) -> None:
        """Estimate static receivers from all that was added, the first `photons`, and keep it in `subsets`.

        A call that is broken off at a pause may be begun again.
        """

    @abstractmethod
    def background(self, photons: int, direct: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Return sums (n, 3 G) int64 and area (n,) float64 [m2] of static receivers, of a photon subset.

        direct: with segments that leave lamps, always so where sums are not `additive`.
        They are those without mobiles. Neither is changed later. An area of 0 means that the receiver can see no light.
        """

    def wanted(self, at: Transforms, mobiles: bool) -> Wanted:
        """Return the current segments that evaluate() needs at these poses, besides path changes.

        mobiles: whether receivers on mobiles are estimated; False where they are path traced.
        """
        return Wanted.changes(self.model, mobiles)

    @abstractmethod
    def evaluate(self, frame: PoseChange) -> Evaluated:
        """Return sums (R, 3 G), areas (R,) and changes at the frame's poses, from the photon subset `frame.photons`.

        Segments that leave lamps count if `frame.direct`. Valid until the next call. A call that raises has no effect
        on the next one.
        """

    @abstractmethod
    def counted(self, place: Place, find: Find) -> Counts:
        """Return the segments that count at a receiver in the last frame, by a rule that `find` applies to all.

        The window draws it. Flux and area of these segments are those of the estimate there.
        """

    @abstractmethod
    def from_scratch(self, parts: Iterable[Segments], at: Transforms, direct: bool = True) -> Evaluated:
        """Return the sums from all current segments, whole photons per part; evaluate() must equal them bit for bit.

        direct: as for background().
        Tests and `bench` compare the two. It uses nothing that was added.
        """


class AdditiveEstimator(Estimator):
    """An estimator whose sums are those of the background plus changes, over areas that photons do not change."""

    additive = True

    def __init__(self, model: Model, setting: Setting, area: np.ndarray) -> None:
        """area (R,) float64 [m2]: of the receivers."""
        super().__init__(model, setting)
        self.area, self._static = area, model.surfaces.receiver_range(0).stop
        channels, threads = model.emitters.lamps.channels, model.threads
        self._background = BackgroundSums(self._static, channels, threads)
        self.subsets = self._background.subsets
        self._frame = FrameSums(len(area), channels, self._static, threads)

    def copied(self, model: Model, setting: Setting) -> Self:
        other = type(self)(model, setting)  # type: ignore[call-arg]  # subclasses know the area
        other._background, other.photons = self._background.copied(model.threads), self.photons
        other.subsets = other._background.subsets
        return other

    def prepare(self, photons: int) -> None:
        self._background.store(photons)
        self.photons = photons

    def background(self, photons: int, direct: bool = True) -> tuple[np.ndarray, np.ndarray]:
        return self._background.of(photons, direct), self.area[: self._static]
