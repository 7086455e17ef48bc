"""Light on calculation surfaces, and the numbers that lighting norms ask for.

EN 12665 defines illuminance uniformity as U0 = E_min / E_mean. E_min / E_max is called diversity Ud here; EN 12665 lets
it be stated beside U0. The text of the norm was not at hand; these formulas are those that manuals of lighting software
give.

The points lie in space, on no surface, so photons on surfaces do not measure them. Unbiased paths do, with a standard
error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from app.rest.surface_grid import Grid, Level, grid_of, reached_steps, stands
from app.settings import Settings
from gi_core.gather.glare import Glare, glare
from gi_core.gather.reference import ReferenceRounds
from gi_core.geometry.error import luminance, small_sample_bias
from gi_core.lights.lamps import Lights
from gi_core.lights.power import is_electric
from gi_core.lights.sky import overcast
from gi_core.model import Model
from gi_core.scene import Pose, Scene
from gi_core.scene.types import CYLINDRICAL, DAYLIGHT_FACTOR, UGR, CalculationSurface

PASS, FAIL, UNCERTAIN = "pass", "fail", "not certain"
AT_MOST = ("maximum",)  # numbers whose target is an upper bound
NOISE = 0.01  # relative, of the mean of a surface at the end
OF_POINT = 3.0  # times that: standard error of each point, relative to its value
FIRST_ROUNDS, LAST_ROUNDS = 3, 8  # rounds before values are shown, and before the end: a deviation of fewer says little
WORKING_PLANE = CalculationSurface("working plane")


def maintained_levels(model: Model, levels: np.ndarray, settings: Settings) -> np.ndarray:
    """Return levels (G, 3) of the lamps on surfaces: those of electric ones times the maintenance factor."""
    factor = settings.maintenance_factor or model.scene.maintenance_factor
    return np.where(is_electric(model.emitters)[:, None], factor * levels, levels)


def surfaces_of(settings: Settings, scene: Scene) -> tuple[CalculationSurface, ...]:
    """Return the surfaces to measure: those of the settings, else those of the scene file."""
    return scene.surfaces if settings.surfaces is None else settings.surfaces


class SurfaceLight(NamedTuple):
    """Irradiance at the points of a surface, as luminance of RGB [W/m2], or [lx] in a photometric scene; or factors.

    Cylindrical illuminance is the mean over all vertical planes. A daylight factor [%] is the share of the light that
    the CIE's overcast sky brings to open ground. UGR is that of eyes that look along the first side.
    """

    surface: CalculationSurface
    grid: Grid
    values: np.ndarray  # (n,) float64, nan where points do not count
    errors: np.ndarray  # (n,) float64, standard errors
    fraction: float  # of the paths needed, 0 .. 1
    is_current: bool = True  # False: the light has changed since

    @property
    def numbers(self) -> Uniformity:
        return uniformity(self.values, self.errors)

    def rows(self) -> tuple[tuple[str, float, float, bool], ...]:
        """Return those of the numbers that have a meaning: UGR has no uniformity."""
        return self.numbers.rows()[: 3 if self.surface.quantity == UGR else None]

    @property
    def verdicts(self) -> dict[str, str]:
        """PASS, FAIL or UNCERTAIN by the number that has a target."""
        of = {name: (value, error) for name, value, error, _ in self.rows()}
        return {
            name: verdict(*of[name], target, name in AT_MOST) for name, target in self.surface.targets if name in of
        }


class Uniformity(NamedTuple):
    """Mean, least and largest value of a grid, each with its standard error; nan without values."""

    mean: tuple[float, float]
    least: tuple[float, float]
    most: tuple[float, float]
    points: int  # that count
    left_out: int  # that lie inside objects or outside the room

    def rows(self) -> tuple[tuple[str, float, float, bool], ...]:
        """Return name (as in targets), value, standard error, and whether it has the unit of the points, per number."""
        return (
            ("mean", *self.mean, True),
            ("minimum", *self.least, True),
            ("maximum", *self.most, True),
            ("U0", *_ratio(self.least, self.mean), False),
            ("Ud", *_ratio(self.least, self.most), False),
        )


def _ratio(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Return a / b with its standard error, for independent values >= 0 with theirs; nan in the dark."""
    if not b[0] > 0:
        return math.nan, math.nan
    ratio = a[0] / b[0]
    return ratio, ratio * math.hypot(a[1] / a[0] if a[0] > 0 else 0.0, b[1] / b[0])


def verdict(value: float, error: float, target: float, at_most: bool = False) -> str:
    """Return PASS or FAIL where a value is certain by two standard errors, else UNCERTAIN; a target itself passes."""
    over = (target - value) if at_most else (value - target)
    slack = 2 * error + 1e-9 * abs(target)  # rounding of a value without noise
    if math.isnan(over):
        return UNCERTAIN
    if error == 0:
        return PASS if over >= -slack else FAIL
    return PASS if over >= slack else FAIL if over <= -slack else UNCERTAIN


def uniformity(values: np.ndarray, errors: np.ndarray) -> Uniformity:
    """Return the numbers of a grid from values (n,) and their standard errors (n,); nan values are left out."""
    rows = np.flatnonzero(np.isfinite(values))
    if not len(rows):
        nan = math.nan, math.nan
        return Uniformity(nan, nan, nan, 0, len(values))
    E, error = values[rows], errors[rows]
    of_mean = math.sqrt(float((error * error).sum())) / len(E)
    least, most = ((float(E[k]), float(error[k])) for k in (E.argmin(), E.argmax()))
    return Uniformity((float(E.mean()), of_mean), least, most, len(E), len(values) - len(E))


def surface_steps(
    model: Model, surface: CalculationSurface, level: Level, poses: Mapping[str, Pose], levels: np.ndarray, seed: int,
    noise: float = NOISE,
) -> Iterator[SurfaceLight]:  # fmt: skip
    """Trace paths from the points of a surface until their noise is small, in steps of some 10 ms; yield the light.

    levels (G, 3): of the lamps; noise: relative l1 noise at the end, that of each point is OF_POINT times it at most.
    Values are nan at first. Raises SceneError for bad poses, and for an object that is not there.
    """
    grid = grid_of(surface, model, level, poses)
    normals = np.broadcast_to(grid.sides[2], grid.positions.shape)
    values, errors = np.full(len(grid.positions), np.nan), np.full(len(grid.positions), np.nan)
    free, views = np.arange(len(grid.positions)), views_of(surface, grid, level.axes.up)
    standing = stands(model, model.transforms(poses), grid.positions, normals, level.axes.up)
    free = free[standing] if standing.any() else free
    lit = free
    for reached in reached_steps(model, grid.positions[free], np.tile(views[0], (len(free), 1)), poses):
        lit = free[reached]
        yield SurfaceLight(surface, grid, values, errors, 0.0)
    free = lit if len(lit) else free
    lights, factor, eyes = None, 1.0, grid.positions[free]
    if surface.quantity == DAYLIGHT_FACTOR:  # alone, a sky that brings 1 to a horizontal plane in the open
        lights = model.lights_at(np.zeros_like(levels))._replace(sky=overcast(level.axes.up))
        factor = 100.0  # percent
    if surface.quantity == UGR:
        each = [glare(model, levels, eyes, view, level.axes.up, poses, seed) for view in views]
        of_eyes = Glare(*map(np.concatenate, zip(*each, strict=True)))
    about = level.axes.up if surface.quantity == CYLINDRICAL else None
    points, sides = np.tile(eyes, (len(views), 1)), np.repeat(views, len(free), axis=0)
    rounds = point_rounds(model, points, sides, poses, levels, seed, lights, about)
    for E, error, fraction in light_steps(rounds, noise):
        values, errors = values.copy(), errors.copy()
        if surface.quantity == UGR:
            E, error = of_eyes.rating(E), of_eyes.deviation(E, error)
        values[free], errors[free] = worst(factor * E, factor * error, len(free))
        yield SurfaceLight(surface, grid, values, errors, fraction)


def views_of(surface: CalculationSurface, grid: Grid, up: np.ndarray) -> np.ndarray:
    """Return the directions (V, 3) in which the points of a surface look: its normal, or those of the eyes of UGR."""
    if surface.quantity != UGR:
        return grid.sides[2:]
    first, turn = grid.sides[0], 2 * math.pi * np.arange(surface.views)[:, None] / surface.views
    upright = (first @ up) * up
    return upright + np.cos(turn) * (first - upright) + np.sin(turn) * np.cross(up, first)


def worst(values: np.ndarray, errors: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest of the values (V n,) of each of n points in V views, and its standard error."""
    values, errors = values.reshape(-1, n), errors.reshape(-1, n)
    k = np.where(np.isnan(values), -np.inf, values).argmax(axis=0), np.arange(n)
    return values[k], errors[k]


def all_steps(
    model: Model, surfaces: Sequence[CalculationSurface], level: Level, poses: Mapping[str, Pose], levels: np.ndarray,
    seed: int, noise: float = NOISE,
) -> Iterator[tuple[SurfaceLight, ...]]:  # fmt: skip
    """Measure several surfaces side by side; yield the light of each, in their order, see surface_steps()."""
    steps = [surface_steps(model, s, level, poses, levels, seed, noise) for s in surfaces]
    lights = [next(of) for of in steps]
    while True:
        yield tuple(lights)
        left = [k for k, light in enumerate(lights) if light.fraction < 1]
        if not left:
            return
        for k in left:
            lights[k] = next(steps[k])
            yield tuple(lights)


def point_rounds(
    model: Model, positions: np.ndarray, normals: np.ndarray, poses: Mapping[str, Pose], levels: np.ndarray, seed: int,
    lights: Lights | None = None, about: np.ndarray | None = None,
) -> ReferenceRounds:  # fmt: skip
    """Return rounds of paths at points (n, 3) [m] with normals (n, 3), which count alike; lights, about: see there."""
    weights = np.ones(len(positions))
    return ReferenceRounds(
        model.scene, positions, normals, seed, weights, poses, model=model, levels=levels, lights=lights, about=about
    )


def light_steps(rounds: ReferenceRounds, noise: float) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Trace rounds until their noise is small; yield values (n,), standard errors (n,) and the fraction done.

    nan before round FIRST_ROUNDS. The last standard errors are those of LAST_ROUNDS sets of paths or more. Points that
    stay noisy end it at 65,536 paths each for 1 %, in inverse proportion to the square of the noise.
    """
    most = (1 << 16) * max((0.01 / noise) ** 2, 1.0)
    state, weights, fraction = rounds.state, np.ones(len(rounds.state.sets)), 0.0
    E, error = np.full((2, len(weights)), np.nan)
    seen = FIRST_ROUNDS - 1
    while fraction < 1:
        rounds.step()
        if state.rounds > seen:
            seen = state.rounds
            E, error = (
                luminance(state.mean[:, :3]),
                luminance(state.standard_error[:, :3]) / small_sample_bias(state.sets),
            )
            mean, left = float(E.mean()), 0.0
            if mean > 0:
                # relative to 0.05 of the mean where a point is dimmer
                of_points = float((error / np.maximum(E, 0.05 * mean)).max())
                left = max(math.sqrt(2 / math.pi) * float(error.mean()) / mean, of_points / OF_POINT) / noise
            done = seen >= LAST_ROUNDS and (left <= 1 or state.paths.mean() >= most)
            now = min(1 / max(left, 1e-9) ** 2, seen / LAST_ROUNDS, 0.99)
            fraction = 1.0 if done else max(fraction, now)  # the noise is measured, and may rise again
        yield E.copy(), error.copy(), fraction
