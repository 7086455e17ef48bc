"""Lamps that hold targets: light per lamp at points of calculation surfaces in each frame, and the levels it asks for.

Without mobiles it is that of whole paths, with their standard errors. Mobiles change it as they change a frame: photons
measure bounced light across a disc at each point, rays to points on lamps direct light. Flux sums are integers, so
levels equal those from scratch bit for bit.

Levels are those of a linear programme with cuts for its convex parts. A requirement on factors c (G,) of the lamps is
concave, as light is linear and glare is a square:

    f(c) = linear . c + offset - CERTAIN |noise c| - squares . c^2 >= 0

|noise c| is the standard error of the linear part, so a requirement that holds does so by two standard errors. HiGHS
solves the programme of tangents of all f; tangents at its answer are added until f is met (Kelley 1960). A target may
be missed by a share v of itself at a price no power outweighs: where targets contradict, v is the shortfall.

A disc that a mobile enters loses the flux of the part inside: light nearer than a radius to a mobile is too low. Glare
is that without mobiles, which hide luminaires and never add any; the background behind it follows the frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import highspy
import numpy as np

from gi_core.base.threads import CHEAP, run_ranges
from gi_core.discs.region import REGION_LIFT, regions_at
from gi_core.discs.search import DEFAULT, SEARCHES
from gi_core.discs.search.predicate import Discs, lines
from gi_core.frames.background import Background
from gi_core.gather.direct_light import DirectLight, Places
from gi_core.gather.glare import Glare
from gi_core.geometry.error import REC709
from gi_core.geometry.receivers import NONE
from gi_core.lights.power import is_electric
from gi_core.model import Model
from gi_core.photons.flux_sums import CutFlux, Sums
from gi_core.photons.paths import Segments, bounced, segments_of
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange, split_at_cuts
from gi_core.scene.types import UGR, CalculationSurface

CERTAIN = 2.05  # standard errors: two, and room for TOLERANCE
TOLERANCE = 0.01  # of the standard error, or 1e-6 of the row, by which the last tangents may miss a requirement
MOST_CUTS = 20  # times that tangents are added
PENALTY = 1e3  # price of a whole target that is missed, over the power of all lamps
SHORT = 1e-4  # of a target: more is missing


class Quiet(highspy.Highs):
    """HiGHS without callbacks: their set-up prints a banner and makes a reference cycle."""

    def __init__(self) -> None:
        super(highspy.Highs, self).__init__()


class Requirements(NamedTuple):
    """m requirements of T targets on the factors of G lamps."""

    linear: np.ndarray  # (m, G) float64
    offset: np.ndarray  # (m,)
    noise: np.ndarray  # (m, G), standard errors of `linear`, independent between lamps
    squares: np.ndarray  # (m, G) >= 0
    target: np.ndarray  # (m,) int64, the target of each
    asked: np.ndarray  # (m, G + 1): asked . (c, 1) is the derivative by a relative change of the target

    def values(self, c: np.ndarray) -> np.ndarray:
        """Return f (m,) at factors c (G,)."""
        return self.linear @ c + self.offset - CERTAIN * self.deviation(c) - self.squares @ c**2

    def deviation(self, c: np.ndarray) -> np.ndarray:
        """Return the standard errors (m,) at factors c (G,)."""
        return np.sqrt(self.noise**2 @ c**2)

    def tangents(self, rows: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gradients (k, G) and offsets (k,) of requirements `rows` (k,) at factors c (G,)."""
        r = Requirements(*(a[rows] for a in self))
        deviation = np.maximum(r.deviation(c), 1e-300)[:, None]
        gradient = r.linear - CERTAIN * r.noise**2 * c / deviation - 2 * r.squares * c
        return gradient, r.offset + r.squares @ c**2


class Levels(NamedTuple):
    """The answer."""

    factors: np.ndarray  # (G,), 0 .. 1
    power: float  # of all lamps at these
    missing: np.ndarray  # (T,) share of each target that is missed, 0: it is met
    prices: np.ndarray  # (T,) power that one percent more of each target takes; nan where any is missed


def least_power(of: Requirements, power: np.ndarray, free: np.ndarray, targets: int) -> Levels:
    """Return factors of the least power. power (G,) >= 0: of each lamp at 1; free (G,) bool: others stay at 1."""
    G = len(power)
    highs, answer = Quiet(), np.ones(G)
    options: dict[str, bool | int | str] = {"output_flag": False, "threads": 1, "presolve": "off", "solver": "simplex"}
    for name, value in options.items():
        highs.setOptionValue(name, value)
    cost = np.append(power, np.full(targets, PENALTY * max(power.sum(), 1e-300)))
    cost /= max(power.max(initial=0.0), 1e-300)
    low = np.append(np.where(free, 0.0, 1.0), np.zeros(targets))
    high = np.append(np.ones(G), np.full(targets, highspy.kHighsInf))
    none = np.zeros(0)
    highs.addCols(G + targets, cost, low, high, 0, none.astype(np.int32), none.astype(np.int32), none)
    whole = of.asked.sum(axis=1)
    size = np.maximum(np.abs(whole), 1e-300)
    rows, of_cuts = np.arange(len(whole)), np.zeros(0, np.int64)
    for _ in range(MOST_CUTS):
        if not len(rows):
            break
        gradient, offset = of.tangents(rows, answer)
        values = np.zeros((len(rows), G + targets))
        values[:, :G] = gradient / size[rows, None]
        values[np.arange(len(rows)), G + of.target[rows]] = whole[rows] / size[rows]
        starts, index = np.arange(len(rows)) * (G + targets), np.tile(np.arange(G + targets), len(rows))
        highs.addRows(len(rows), -offset / size[rows], np.full(len(rows), highspy.kHighsInf), values.size,
                      starts.astype(np.int32), index.astype(np.int32), values.reshape(-1))  # fmt: skip
        of_cuts = np.append(of_cuts, rows)
        highs.run()
        solution = highs.getSolution()
        optimum = np.array(solution.col_value)
        answer, missing = np.clip(optimum[:G], low[:G], 1.0), np.maximum(optimum[G:], 0.0)
        slack = TOLERANCE * of.deviation(answer) + 1e-6 * size
        rows = np.flatnonzero(of.values(answer) + whole * missing[of.target] < -slack)
    prices = np.zeros(targets)
    if len(of_cuts):
        duals = np.array(solution.row_dual) / size[of_cuts] * power.max(initial=0.0)
        np.add.at(prices, of.target[of_cuts], 0.01 * duals * (of.asked @ np.append(answer, 1.0))[of_cuts])
    else:
        answer, missing = low[:G], np.zeros(targets)
    missing = np.where(missing > SHORT, missing, 0.0)
    return Levels(answer, float(power @ np.where(free, answer, 0.0)), missing, np.where(missing.any(), np.nan, prices))


class HeldSurface(NamedTuple):
    """A surface with targets: its n points and the light there by whole paths, at the levels of the scene file."""

    surface: CalculationSurface
    positions: np.ndarray  # (n, 3) float64 [m]
    normals: np.ndarray  # (n, 3) float64 unit, of UGR the line of sight
    light: np.ndarray  # (n, 3 G) [W/m2] per lamp
    errors: np.ndarray  # (n, 3 G) [W/m2], standard errors
    sources: np.ndarray  # (n, G), of UGR as in `Glare`, of each lamp; else 0
    direct: np.ndarray  # (n, G), the same

    @property
    def targets(self) -> list[tuple[str, float]]:
        """Targets that lamps can hold, by name."""
        names = ("maximum",) if self.surface.quantity == UGR else ("mean", "minimum", "maximum", "U0")
        return [target for target in self.surface.targets if target[0] in names]


class HeldLevels(NamedTuple):
    """Levels of a frame, and the light that they bring."""

    levels: np.ndarray  # (G, 3)
    of: Levels  # factors of the levels asked for; targets of all surfaces in turn
    values: np.ndarray  # (n,) at all points, surface by surface, nan where a mobile covers them
    errors: np.ndarray  # (n,) standard errors


class Held:
    """Surfaces with targets. `answer` finds levels for light that is measured, in_frame() measures that of a frame."""

    def __init__(
        self, model: Model, surfaces: Sequence[HeldSurface], power: np.ndarray, factor: float,
        counts: Callable[[Transforms], np.ndarray],
    ):  # fmt: skip
        """power (G,): of lamps at the levels of the scene file, 0: daylight, which stays; factor: of maintenance;
        counts(at): which points (n,) bool are free of mobiles."""
        self.model, self.surfaces, self.power, self.factor, self.counts = model, surfaces, power, factor, counts
        places, self._normals, self._light, self._errors, self._sources, self._glare = (
            np.concatenate(parts) for parts in zip(*(s[1:] for s in surfaces), strict=True)
        )
        self._places = places - model.origins[0]
        ends = np.cumsum([len(s.positions) for s in surfaces])
        self.rows = [slice(end - len(s.positions), end) for s, end in zip(surfaces, ends, strict=True)]
        self._is_ugr = np.repeat([s.surface.quantity == UGR for s in surfaces], [len(s.positions) for s in surfaces])
        self._targets = sum(len(s.targets) for s in surfaces)
        self._direct: DirectLight | None = None
        self._discs: Discs | None = None  # of the last radius

    # -- levels -----------------------------------------------------------------------------------

    def _per_lamp(self, light: np.ndarray, asked: np.ndarray) -> np.ndarray:
        """Return the luminance (n, G) per lamp of light (n, 3 G) at the levels asked for (G, 3)."""
        factor = np.where(is_electric(self.model.emitters)[:, None], self.factor, 1.0)
        return np.einsum("ngc,gc->ng", light.reshape(len(light), -1, 3), REC709 * factor * asked)

    def answer(
        self, asked: np.ndarray, counts: np.ndarray, light: np.ndarray | None = None, more: np.ndarray | float = 0.0
    ) -> HeldLevels:
        """Return the levels of least power, at most those asked for (G, 3).

        counts (n,) bool: points that count; light (n, 3 G): per lamp, None: of whole paths; more: variance (n, G) of
        its luminance besides that of whole paths.
        """
        flux, free = self.model.emitters.flux_of_lamps, self.power > 0
        dimmed = (flux * asked) @ REC709 / np.maximum(flux @ REC709, 1e-300)
        lit = np.where(is_electric(self.model.emitters), self.factor, 1.0) * dimmed
        E = self._per_lamp(self._light if light is None else light, asked)
        E, sources = np.maximum(E - self._glare * lit, 0.0), self._sources * lit**2
        variance = self._per_lamp(self._errors, asked) ** 2 + more
        of = least_power(self._requirements(E, variance, sources, counts), self.power * dimmed, free, self._targets)
        c = np.where(free, of.factors, 1.0)
        values, errors = E @ c, np.sqrt(variance @ c**2)
        glare = Glare(sources @ c**2, np.zeros(len(values)))
        rating, deviation = glare.rating(values), glare.deviation(values, errors)
        values, errors = np.where(self._is_ugr, rating, values), np.where(self._is_ugr, deviation, errors)
        return HeldLevels(asked * c[:, None], of, *np.where(counts, (values, errors), np.nan))

    def _requirements(self, E: np.ndarray, variance: np.ndarray, glare: np.ndarray, counts: np.ndarray) -> Requirements:
        """Return the requirements of the targets on light E (n, G) per lamp."""
        parts: list[Requirements] = []
        for s, rows in zip(self.surfaces, self.rows, strict=True):
            e, v, q = (a[rows][counts[rows]] for a in (E, variance, glare))
            n = len(e)
            mean, of_mean = (a.sum(axis=0, keepdims=True) / max(n, 1) for a in (e, v / max(n, 1)))
            for name, value in s.targets:
                asked, offset, linear, noise, squares = 0.0 * e, -value, e, v, 0.0 * e
                if s.surface.quantity == UGR:
                    share = 4.0 / math.pi * 10 ** (value / 8)
                    asked, offset, linear = value * math.log(10) / 8 * share * e, 0, share * e
                    noise, squares = share**2 * v, q
                elif name == "mean":
                    asked, linear, noise, squares = asked[:1], mean[:n], of_mean[:n], squares[:1]
                elif name == "maximum":
                    offset, linear = value, -e
                elif name == "U0":
                    asked, offset, linear = value * mean + 0.0 * e, 0, e - value * mean
                    noise = v + value**2 * of_mean
                by, alone = np.full(len(linear), offset, float), np.full((len(linear), 1), abs(offset))
                rest = squares, np.full(len(linear), len(parts)), np.hstack([asked, alone])
                parts.append(Requirements(linear, by, np.sqrt(noise), *rest))
        return Requirements(*map(np.concatenate, zip(*parts, strict=True)))

    # -- frames -----------------------------------------------------------------------------------

    def in_frame(
        self, b: Background, change: PoseChange, cut: CutFlux, direct: DirectLight | None, asked: np.ndarray
    ) -> HeldLevels:
        """Return the levels of a frame; direct: None where photons bring direct light too."""
        removed = change.removed_suffixes.segments(b.model.threads)
        taken, added = (self._crossed(s, b.setting.radius) for s in (removed, change.new_suffixes))
        return self._changed(b, change.at, taken, added, change.photons, cut, direct, asked)

    def from_scratch(
        self, b: Background, at: Transforms, parts: Iterable[Segments], photons: int, cut: CutFlux,
        direct: DirectLight | None, asked: np.ndarray,
    ) -> HeldLevels:  # fmt: skip
        """Return the levels that in_frame() must equal, from all current segments at the poses `at`, traced again."""
        background, current = segments_of(b.store.subset(photons)[0], 0, photons), list(parts)
        before, now, added = (
            np.sum([self._crossed(s if direct is None else bounced(s), b.setting.radius) for s in of], axis=0)
            for of in ([background], current, [split_at_cuts(segments)[1] for segments in current])
        )
        return self._changed(b, at, before + added - now, added, photons, cut, direct, asked)

    def _changed(
        self, b: Background, at: Transforms, taken: np.ndarray, added: np.ndarray, photons: int, cut: CutFlux,
        direct: DirectLight | None, asked: np.ndarray,
    ) -> HeldLevels:  # fmt: skip
        """Return the levels where photons take and add flux (n, 3 G) at the discs."""
        emitters, area = b.store.model.emitters, self._discs.regions.area
        unit = emitters.unit_flux / photons * emitters.scale  # (G,) [W]
        per_area = np.divide(1.0, area, out=np.zeros_like(area), where=area > 0)[:, None]
        factor = np.repeat(unit, 3) * per_area
        light, moved = self._light + factor * (added - taken), self._per_lamp(factor * (added + taken), asked)
        of_cut = unit * cut.flux / np.maximum(cut.photons, 1) / 3.0
        one = self._per_lamp(np.repeat(of_cut, 3) * per_area, asked)  # by a cut photon
        for rows in self.rows:  # where chance cut none, there is noise as around
            moved[rows] = np.maximum(moved[rows], moved[rows].mean(axis=0))
        variance = one * moved
        if direct is not None:
            if self._direct is None:
                lifts = b.model.lifts_at(b.model.static, self._places, self._normals)
                self._direct = direct.measured_at(Places(self._places, self._normals, lifts))
            each = np.eye(len(asked))[:, :, None] * np.ones(3)
            blocked = np.hstack([self._direct.blocked(at, levels) for levels in each])
            blocked[self._is_ugr] = 0.0
            light -= blocked
            whole, gone = (self._per_lamp(a, asked) for a in (self._direct.per_lamp, blocked))
            # At most that of points drawn at random: theirs are stratified.
            variance += gone * np.maximum(whole - gone, 0.0) / np.maximum(direct.points_of_lamps, 1)
        return self.answer(asked, self.counts(at), light, variance)

    def _crossed(self, segments: Segments, radius: float) -> np.ndarray:
        """Return the flux sums (n, 3 G) int64 of segments across the discs."""
        m, (n, channels) = self.model, self._light.shape
        if self._discs is None or self._discs.radius != np.float32(radius):
            raised, none = self._places + REGION_LIFT * radius * self._normals, np.full(n, NONE, np.int32)
            region = regions_at(m, 0, raised, self._normals, none, radius)
            at = self._places.astype(np.float32), self._normals.astype(np.float32)
            self._discs = Discs(*at, none, none, np.float32(radius), region)
            self._search = SEARCHES[DEFAULT](self._discs)

        def work(_, first, last):
            sums, mine = Sums.zeros(n, channels), Segments(*(a[first:last] for a in segments))
            self._search.accumulate(lines(mine, m.static.rotation[0], m.static.position[0], m, radius), 1, sums)
            return sums.flux

        return np.sum(run_ranges(work, segments.size, m.threads, CHEAP), axis=0)
