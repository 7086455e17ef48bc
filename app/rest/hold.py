"""Levels of lamps that hold the targets of calculation surfaces with the least power, see `gi_core.frames.held_light`.

A lamp gets at most the level asked for; sun, sky and lamps of no watts stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np

from app.rest.calculation_surface import AT_MOST, NOISE, SurfaceLight, light_steps, surfaces_of, views_of, worst
from app.rest.surface_grid import Grid, grid_of, level_of, stands
from app.settings import Settings
from gi_core.frames.held_light import Held, HeldLevels, HeldSurface
from gi_core.gather.glare import glare
from gi_core.gather.reference import ReferenceRounds
from gi_core.geometry.error import luminance
from gi_core.lights.power import full_watts, is_electric
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms
from gi_core.scene import Pose, Scene
from gi_core.scene.types import ILLUMINANCE, UGR, UNITS, CalculationSurface
from gi_core.scene.validate import parts_of
from gi_core.solver import Solver

Measured = tuple[Held, list["Grid"], str]  # targets, the points of their surfaces, and the unit of power


class HeldResult(NamedTuple):
    """What holds in a frame, in words."""

    power: str
    missing: tuple[str, ...]  # where targets cannot be held; lamps are then as near to all of them as they can be
    sentences: tuple[str, ...]  # all, with prices and levels
    lights: tuple[SurfaceLight, ...]


class Inputs(NamedTuple):
    """All that the light of held surfaces depends on, besides poses and levels."""

    surfaces: tuple[CalculationSurface, ...]
    factor: float  # of maintenance
    watts: tuple[tuple[str, float], ...]  # stated on the command line


def inputs_of(settings: Settings, scene: Scene, moving: bool) -> Inputs | None:
    """Return the targets to hold, None without any; moving: no surface on a mobile can be held."""
    if not is_on(settings, scene):
        return None
    places = set(parts_of(scene)) - ({m.name for m in scene.mobiles} if moving else set())
    surfaces = (
        s for s in surfaces_of(settings, scene) if s.quantity in (ILLUMINANCE, UGR) and (not s.on or s.on in places)
    )
    factor = settings.maintenance_factor or scene.maintenance_factor
    return Inputs(tuple(s for s in surfaces if s.targets), factor, settings.watts)


def is_on(settings: Settings, scene: Scene) -> bool:
    """Return whether lamps are to hold targets."""
    return scene.hold if settings.hold is None else settings.hold


def power_of_lamps(model: Model, stated: tuple[tuple[str, float], ...]) -> tuple[np.ndarray, str]:
    """Return the power (G,) of lamps at the levels of the scene file and its unit: watts, else lumens of all.

    0: daylight, which nothing dims: sun, sky, and lamps of no watts.
    """
    lamps, electric, full = model.emitters.lamps, is_electric(model.emitters), full_watts(model.scene, stated)
    power, unit = luminance(model.emitters.flux_of_lamps), UNITS[model.scene.units].flux
    if all(name in full for name, g in lamps.sources.items() if electric[g]):
        power, unit = np.zeros(lamps.count), "W"
        for name, g in lamps.sources.items():
            power[g] += full.get(name, 0.0)
    return np.where(electric, power, 0.0), unit


def measured_steps(
    model: Model, of: Inputs, seed: int, poses: Mapping[str, Pose] | None = None, noise: float = NOISE
) -> Iterator[tuple[float, Measured | None]]:
    """Trace the light per lamp at the points of surfaces until its noise is small, in steps of some 10 ms.

    Yield the fraction done, and the result at the end. poses: of mobiles in place; None: without them.
    """
    level, lamps, surfaces = level_of(model), model.emitters.lamps.count, []
    grids, each = [grid_of(s, model, level, poses or {}) for s in of.surfaces], np.eye(lamps)[:, :, None] * np.ones(3)
    for k, (surface, grid) in enumerate(zip(of.surfaces, grids, strict=True)):
        is_ugr, views = surface.quantity == UGR, views_of(surface, grid, level.axes.up)
        positions, view = np.tile(grid.positions, (len(views), 1)), np.repeat(views, len(grid.positions), axis=0)
        n = len(positions)
        rounds = ReferenceRounds(model.scene, positions, view, seed, np.ones(n), poses, model=model,
                                 mobiles=poses is not None, per_lamp=True)  # fmt: skip
        for *_, fraction in light_steps(rounds, noise):
            yield (k + fraction) / (len(grids) + 1), None
        light, errors = (a[:, -3 * lamps :] for a in (rounds.state.mean, rounds.state.standard_error))
        of_eyes = np.zeros((2, n, lamps))
        for g in range(lamps if is_ugr else 0):
            of_eyes[:, :, g] = np.concatenate(
                [glare(model, each[g], grid.positions, v, level.axes.up, poses, seed) for v in views], axis=1
            )
        surfaces.append(HeldSurface(surface, positions, view, light, errors, *of_eyes))
    points = np.concatenate([s.positions for s in surfaces])
    normals = np.repeat([grid.sides[2] for grid in grids], [len(s.positions) for s in surfaces], axis=0)
    lit = np.concatenate([s.light.any(axis=1) for s in surfaces])

    def counts(at: Transforms) -> np.ndarray:
        return lit & stands(model, at, points, normals, level.axes.up)

    power, unit = power_of_lamps(model, of.watts)
    yield 1.0, (Held(model, surfaces, power, of.factor, counts), grids, unit)


def hold_now(solver: Solver, settings: Settings, noise: float, bar: Callable[[str, float], None]) -> HeldResult | None:
    """Set the levels that hold targets at the solver's poses; return the result, None without targets."""
    of = inputs_of(settings, solver.scene, moving=False)
    if of is None:
        return None
    if not of.surfaces:
        return HeldResult("", (), ("no surface has a target that lamps can hold",), ())
    steps = measured_steps(solver.model, of, solver.seed, solver.poses, noise)
    while (step := next(steps))[1] is None:
        bar("finding levels", step[0])
    held = step[1][0]
    answer = held.answer(solver.levels, held.counts(solver.model.transforms(solver.poses)))
    solver.set_lamps(dict(zip(solver.lamps.names, answer.levels.tolist(), strict=True)))
    return result_of(*step[1], answer)


def result_of(held: Held, grids: Sequence[Grid], unit: str, answer: HeldLevels) -> HeldResult:
    """Return the result of holding targets at levels."""
    rows = zip(held.surfaces, grids, held.rows, strict=True)
    lights = tuple(
        SurfaceLight(s.surface, grid, *worst(answer.values[k], answer.errors[k], len(grid.positions)), 1.0)
        for s, grid, k in rows
    )
    names, power = held.model.emitters.lamps.names, f"{answer.of.power:.4g} {unit}"
    targets = [(light, *target) for s, light in zip(held.surfaces, lights, strict=True) for target in s.targets]
    short = compress(targets, (answer.of.missing > 0) | [not np.isfinite(of[0].values).any() for of in targets])
    missing = tuple(dict.fromkeys(_missing(held.model.scene, *target) for target in short))
    lines = ["targets cannot be held", *missing] if missing else [f"targets held with {power}"]
    for (light, name, value), price in zip(targets, answer.of.prices, strict=True):
        if not missing:
            costs = f"1 % more takes {price:.2g} {unit}" if price > 1e-6 * answer.of.power else "costs nothing"
            lines.append(f"{light.surface.name}: {name} {_shown(held.model.scene, light, name, value)} {costs}")
    lit = [f"{names[g]} {100 * answer.of.factors[g]:.3g} %" for g in np.flatnonzero(held.power * answer.of.factors)]
    return HeldResult(power, missing, (*lines, f"levels: {', '.join(lit) or 'all off'}"), lights)


def _shown(scene: Scene, light: SurfaceLight, name: str, value: float) -> str:
    unitless = name == "U0" or light.surface.quantity == UGR
    return f"{value:.4g}" + ("" if unitless else f" {UNITS[scene.units].per_area}")


def _missing(scene: Scene, light: SurfaceLight, name: str, target: float) -> str:
    """Return by how much a target is missed, and where."""
    numbers = {row[0]: row[1] for row in light.rows()}
    if not np.isfinite(light.values).any():
        return f"{light.surface.name}: no point of it counts"
    worst = np.nanargmax(light.values) if name in AT_MOST else np.nanargmin(light.values)
    place = "" if name == "mean" else f" at ({', '.join(f'{x:.2f}' for x in light.grid.positions[worst])}) m"
    off = (numbers[name] - target) * (1 if name in AT_MOST else -1)
    wanted, text = (_shown(scene, light, name, x) for x in (target, abs(off)))
    how = (
        f"{text} {'too high for' if name in AT_MOST else 'short of'} {wanted}" if off > 0 else f"not certainly {wanted}"
    )
    return f"{light.surface.name}: {name} is {_shown(scene, light, name, numbers[name])}{place}, {how}"
