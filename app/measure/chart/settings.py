"""Which settings the chart measures. A new dimension is a field of Choice and a line where choices are made."""

from __future__ import annotations

from typing import NamedTuple

from app.settings import Settings

PHOTONS = (1 << 14, 1 << 16, 1 << 18, 1 << 20)  # all of them prefixes that frames can use
QUICK_PHOTONS = (1 << 14, 1 << 16)
RADII = (0.5, 1.0, 2.0)  # of the radius that the program chooses
NEIGHBOURS = (20, 100)
GATHERED_NOISE, QUICK_GATHERED_NOISE = 0.01, 0.05  # of gathered static light before smoothing: a minute or so at rest
TUNED = "tune's choice"
LIMIT_PHOTONS = 1 << 22  # of an estimator's limit: four times the most
QUICK_LIMIT_PHOTONS = 1 << 18


class Choice(NamedTuple):
    """One setting: what a frame is computed from and how. Fields are columns of results.csv."""

    estimator: str
    photons: int  # that a frame uses
    traced: int  # that there are: more than `photons` while something is dragged
    radius: float  # [m]
    neighbours: int
    control: bool
    light: str  # one of app.settings.LIGHTS
    border_correction: bool = True  # of photon_map
    textbook: bool = False  # photon_map's k as in the report
    paths: int = 0  # that receivers of mobiles gather in a frame; 0: their light is the photons'
    tuned: bool = False  # by `tune`: a point of its own

    @property
    def family(self) -> tuple:
        """What decides the limit at very many photons."""
        return self[:1] + self[3:6] + self[7:9]

    @property
    def setting(self) -> dict:
        """What Solver.configure() is to be told, but the numbers of photons."""
        others = ("photons", "traced", "paths", "tuned")
        return {name: value for name, value in self._asdict().items() if name not in others}

    @property
    def frame(self) -> tuple[int | None, int | None]:
        """What Solver.move_all() is to be told."""
        return None if self.traced == self.photons else self.photons, self.paths or None

    @property
    def curve(self) -> str:
        """The name of the curve that it is a point of."""
        if self.tuned:
            return TUNED
        if self.light == "best":
            return f"{self.estimator}, gathered light"
        if self.traced > self.photons:
            return f"{self.estimator}, while dragged"
        if self.estimator == "tangent_plane" and not self.control:
            return "tangent_plane, no control"
        return self.estimator

    def told(self) -> str:
        """Return the setting in words."""
        words = [f"{self.photons:,} photons"]
        if self.traced > self.photons:
            words[0] += f" of {self.traced:,}"
        if self.paths:
            words.append(f"{self.paths} paths a vertex of the mobiles")
        if self.estimator == "tangent_plane":
            words.append(f"radius {self.radius:.3g} m")
        if self.estimator == "photon_map":
            words.append(f"k {self.neighbours}" + (", as in textbooks" if self.textbook else ""))
        return ", ".join(words)


def choices(settings: Settings, solver, quick: bool) -> list[Choice]:
    """Return what to measure, family by family; what `settings` gives is not varied.

    `solver` knows what the program chooses where nothing is given.
    """
    counts = (settings.photons,) if settings.photons else QUICK_PHOTONS if quick else PHOTONS
    radii = (1.0,) if settings.radius or quick else RADII
    ks = (settings.neighbours or solver.neighbours,) if settings.neighbours or quick else NEIGHBOURS
    wanted = (settings.estimator,) if settings.estimator else ("tangent_plane", "impact_count", "photon_map")
    most, r, k = counts[-1], solver.radius, solver.neighbours
    out = []

    def add(estimator, radius=r, neighbours=k, control=True) -> None:
        for n in counts:
            out.append(Choice(estimator, n, n, radius, neighbours, control, "photons"))

    if "tangent_plane" in wanted:
        for share in radii if settings.control else ():
            add("tangent_plane", radius=_round(share * r))
            if share == 1.0:  # what a drag shows: a frame of a few photons, the walls lit by all of them
                out += [Choice("tangent_plane", n, most, r, k, True, "photons") for n in counts[:-1]]
                out += [Choice("tangent_plane", n, most, r, k, True, "best", paths=p) for n, p in _gathered(counts)]
        add("tangent_plane", control=False)
    if "impact_count" in wanted:
        add("impact_count", control=False)
    if "photon_map" in wanted:
        for neighbours in ks:
            add("photon_map", neighbours=neighbours, control=False)
    return out


def _gathered(counts: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return photons and paths of frames whose light is gathered: paths grow with the root of the photons or so."""
    return [(n, p) for k, n in enumerate(counts) for p in ((8, 16) if k == 0 else (min(8 << k, 64),))]


def _round(x: float) -> float:
    return float(f"{x:.3g}")
