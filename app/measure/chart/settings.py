"""Settings that the chart measures: those varied, and those most like the report of 2003.

A new dimension is a field of Choice and a line in `choices`. The report's errors are mean differences of luminance from
a picture by tangent_plane at very many photons. The noise in table 2.8 is from photon_map's own picture of 5 million
photons. The report gives no k of its photon maps.
"""

from __future__ import annotations

from typing import NamedTuple

from app.settings import Settings
from gi_core.estimators import DEFAULT, ESTIMATORS
from gi_core.estimators.base import Setting
from gi_core.frames.light_setting import ENOUGH_PATHS, PATHS, PATHS_AT_REST
from gi_core.solver import Solver

RIVAL = "path gather"
DRAGGED, GATHERED, NO_CONTROL = ", while dragged", ", gathered light", ", no control"  # curves of an estimator
RESTED = ", at rest"


class Effort(NamedTuple):
    """Size of a chart."""

    photons: tuple[int, ...]  # subsets that frames can use
    radii: tuple[float, ...]  # of the default radius
    neighbours: tuple[int, ...]  # (): the default alone
    paths: tuple[int, ...]  # of the rival, per vertex
    frames: int  # timed per setting
    points: int  # receivers per pose at which errors are measured
    poses: int
    truth: float  # l1 noise of the truth at those receivers
    gathered_noise: float  # of gathered static light before smoothing
    gathered_seconds: float  # CPU time of light gathered at a pose
    limit_photons: int  # of an estimator's limit


FULL = Effort(
    (1 << 14, 1 << 16, 1 << 17, 1 << 18, 1 << 20),  # 16 ms per frame lie about 2^17
    (0.5, 1.0, 2.0),
    (20, 100),
    (1, 4, 16, 64),
    40,
    1500,
    3,
    0.01,
    0.01,
    60.0,
    1 << 22,
)
QUICK = Effort((1 << 14, 1 << 16), (1.0,), (), (1, 4), 8, 300, 1, 0.03, 0.05, 3.0, 1 << 18)


class Choice(NamedTuple):
    """Settings of one row. Fields are columns of results.csv."""

    estimator: str
    photons: int  # used by a frame
    traced: int  # more than `photons` while a mobile is dragged
    radius: float  # [m]
    neighbours: int
    control: bool
    light: str  # one of app.settings.LIGHTS
    border_correction: bool = True  # of photon_map
    textbook: bool = False  # photon_map counts the k-th hit, as in the report
    paths: int = 0  # per receiver of a mobile and frame; 0: mobiles are lit by photons
    rested: bool = False  # light is gathered at each pose; the frame time is that of the frame before

    @property
    def family(self) -> tuple:
        """Fields that decide the limit at very many photons."""
        return self[:1] + self[3:6] + self[7:9]

    @property
    def setting(self) -> dict:
        """Arguments of Solver.configure() other than photons."""
        of_frame = ("photons", "traced", "paths", "rested")
        return {name: value for name, value in self._asdict().items() if name not in of_frame}

    @property
    def frame(self) -> tuple[int | None, int | None]:
        """Photons and paths, as arguments of Solver.move_all()."""
        return None if self.traced == self.photons else self.photons, self.paths or None

    @property
    def curve(self) -> str:
        """Name of the curve through this point."""
        if self.rested:
            return f"{self.estimator}{RESTED}"
        if self.light == "best":
            return f"{self.estimator}{GATHERED}"
        if self.traced > self.photons:
            return f"{self.estimator}{DRAGGED}"
        if self.estimator in ESTIMATORS and ESTIMATORS[self.estimator].controlled and not self.control:
            return f"{self.estimator}{NO_CONTROL}"
        return self.estimator

    def summary(self) -> str:
        """Return the setting in words."""
        words = [f"{self.photons:,} photons"]
        if self.traced > self.photons:
            words[0] += f" of {self.traced:,}"
        if self.paths:
            words.append(f"{self.paths} paths per vertex of the mobiles")
        if self.rested:
            words.append("light gathered at each pose")
        setting = Setting(self.estimator, self.radius, self.neighbours, textbook=self.textbook)
        words.append(ESTIMATORS[self.estimator].summary(setting))
        return ", ".join(filter(None, words))


def choices(settings: Settings, solver: Solver, effort: Effort) -> list[Choice]:
    """Return the settings to measure, family by family; a value given by `settings` is not varied.

    solver: source of default radius and neighbours.
    """
    counts = (settings.photons,) if settings.photons else effort.photons
    radii = (1.0,) if settings.radius else effort.radii
    ks = (
        (settings.neighbours or solver.setting.neighbours,)
        if settings.neighbours
        else effort.neighbours or (solver.setting.neighbours,)
    )
    most, r, k = counts[-1], solver.setting.radius, solver.setting.neighbours
    out = []

    def add(estimator: str, radius: float = r, neighbours: int = k, control: bool = False) -> None:
        for n in counts:
            out.append(Choice(estimator, n, n, radius, neighbours, control, "photons"))

    for name in (settings.estimator,) if settings.estimator else ESTIMATORS:
        kind = ESTIMATORS[name]
        control = kind.controlled and settings.control
        values: dict[str | None, list] = {
            "radius": [_round(share * r) for share in radii],
            "neighbours": list(ks),
            None: [None],
        }
        if control or not kind.controlled:
            for value in values[kind.smoothing]:
                add(name, control=control, **({kind.smoothing: value} if kind.smoothing else {}))
        if control and name == DEFAULT:  # a drag: frames of a photon subset, static light of all photons
            out += [Choice(name, n, most, r, k, True, "photons") for n in counts[:-1]]
            out += [Choice(name, n, most, r, k, True, "best", paths=p) for n, p in _gathered(counts)]
            out.append(Choice(name, most, most, r, k, True, "best", paths=64, rested=True))
        if kind.controlled:
            add(name)
    return out


def _gathered(counts: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return photons and paths of frames with gathered light, in the order in which a budget takes them."""
    # 8 paths at least of a frame with gathered light
    few = [(counts[0], paths) for paths in PATHS if 8 <= paths < ENOUGH_PATHS]
    more = [(n, 4 * ENOUGH_PATHS) for n in counts[1:-2]]
    return [*few, *((n, ENOUGH_PATHS) for n in counts[:-1]), *more, (counts[-1], PATHS_AT_REST)]


def _round(x: float) -> float:
    return float(f"{x:.3g}")


SCENES = ("tree", "tree_worst")  # like the report's


class ReportRow(NamedTuple):
    """A row of the report: seconds per frame for tracing and estimating, relative errors, None if not given."""

    table: str
    estimator: str
    photons: int
    seconds: float
    noise: float | None
    bias: float | None
    total: float | None


REPORT = (
    ReportRow("2.1", "tangent_plane", 50_000, 0.85, 0.1610, None, None),
    ReportRow("2.1", "impact_count", 1_000_000, 1.11, None, None, 1.3954),
    ReportRow("2.6", "tangent_plane", 1_000, 0.11, 0.2464, 0.14403, 0.286912),
    ReportRow("2.7", "tangent_plane", 10_000, 0.485, 0.0857, 0.1440, 0.1682),
    ReportRow("2.8", "photon_map", 10_000, 0.20, 1.725, 0.6280, 0.5439),
    ReportRow("2.8", "photon_map", 50_000, 0.47, 0.932, 0.6280, 0.6246),
    ReportRow("2.8", "photon_map", 200_000, 2.29, 0.622, 0.6280, 0.6572),
)


def choice_like(row: ReportRow, scene_size: float, neighbours: int) -> Choice:
    """Return the setting like a row of the report: discs of 1 % of the scene, no corrections."""
    radius = float(f"{0.01 * scene_size:.3g}")  # 0.01 of the scene size
    like = Choice(row.estimator, row.photons, row.photons, radius, neighbours, False, "photons")
    return like._replace(border_correction=False, textbook=True) if row.estimator == "photon_map" else like


def choices_like_the_report(scene: str, solver: Solver) -> list[Choice]:
    """Return the settings like the report's rows, none for scenes other than its tree."""
    if scene not in SCENES:
        return []
    return [choice_like(row, solver.scene_size, solver.setting.neighbours) for row in REPORT]


def beside(rows: list[dict], scene_size: float) -> list[tuple[ReportRow, dict | None]]:
    """Return each row of the report with the measured row of the same setting, None if there is none."""

    def same(r: dict, like: Choice) -> bool:
        names = [name for name in Choice._fields if name not in ("radius", "neighbours")]
        return abs(r["radius"] - like.radius) <= 1e-3 * like.radius and all(r[n] == getattr(like, n) for n in names)

    likes = [(row, choice_like(row, scene_size, 0)) for row in REPORT]
    return [(row, next((r for r in rows if same(r, like)), None)) for row, like in likes]
