"""`gi-viewer tune`: best settings for a time or an error on this scene and machine, with their predicted errors."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from app import values
from app.cli import options, saved_scene
from app.cli.options import settings_of
from app.cli.progress import opened, solve
from app.cli.terminal import Exit, say
from app.settings import Settings, UsageError, make_solver, open_moving_scene

if TYPE_CHECKING:
    from app.measure.tuning import Tuned
    from gi_core.solver import Solver


def add_options(parser: argparse.ArgumentParser) -> None:
    options.scene(parser)
    options.light(parser, "photons", "radius", "control", "search", "light", "rays", "lamps", "seed")
    add = options.measuring(parser)
    options.budget(add, "")
    add("--error", type=values.percent, metavar="PCT", help="choose the fastest settings with this error at rest [%%]")
    add("--check", action="store_true", help="solve with the choice and measure its error")


def run(arguments: argparse.Namespace) -> int:
    say(tuned_lines(settings_of(arguments), arguments.error, arguments.check))
    return Exit.OK


def tuned_lines(settings: Settings, error: float | None, check: bool = False) -> list[str]:
    """Return the lines to print: each trial, and the choice.

    error: wanted at rest [%]; None: the least error in motion that settings.budget [ms] allows. check: solve with
    the choice and measure it. Raises SceneError, UsageError.
    """
    from app.measure.tuning import tune

    if settings.budget <= 0:
        raise UsageError("--budget must be over 0 to choose settings by")
    with opened(settings, open_moving_scene) as (bar, scene):
        solver = make_solver(scene, settings)
        solve(solver, bar)
        tuned = tune(solver, 1e-3 * settings.budget, bar, None if error is None else 1e-2 * error)
        lines = [*_models(tuned, settings.budget), "", *_choice(tuned, settings.budget, error)]
        lines.append(command_line(settings, tuned))
        if check:
            lines += ["", checked(solver, tuned, bar)]
    return lines


def _models(tuned: Tuned, budget: float) -> list[str]:
    """Return a table of the settings tried; budget: [ms] per frame."""
    from app.measure.tuning import compared

    lines = [
        f"{'tried':<32}{'noise at 1e6':>13}{'bias':>8}{'frame: start':>14}{'per 1e5 photons':>16}{'in motion':>11}"
    ]
    errors = compared(tuned, 1e-3 * budget)
    for model, (error, in_noise) in zip(tuned.models, errors, strict=True):
        lines.append(
            f"{_name(model.setting):<32}{100 * (model.noise / 1e6) ** 0.5:>11.1f} %{100 * model.bias:>6.1f} %"
            f"{1e3 * model.start:>11.1f} ms{1e8 * model.slope:>13.1f} ms"
            f"{100 * error:>9.1f} %{', in noise' * in_noise}"
        )
    if any(in_noise for _, in_noise in errors):
        lines.append("in noise: it differs from the choice by less than the trials scatter about their models")
    for name, exponents in tuned.exponents.items():
        powers = ", ".join(f"{letter} r^{exponents[letter]:.2f}" for letter in ("A", "B", "c"))
        lines.append(f"{name}, by radius: {powers} (A / photons: noise squared; B: bias; c: time per photon)")
    return lines


def _choice(tuned: Tuned, budget: float, error: float | None) -> list[str]:
    """Return the choice and its expected errors and frame time, in words."""
    c = tuned.choice
    asked = f"frames of {budget:g} ms" if error is None else f"{error:g} % at rest"
    met = "" if c.met else f" ({asked} is out of reach: this comes nearest)"
    return [
        f"for {asked}: {_name(c.setting)}, {c.photons:,} photons{met}",
        f"expected with moving objects: {100 * c.error:.1f} % at rest, {100 * c.moving_error:.1f} % in motion "
        f"({c.frame:,} photons{_gathered(tuned)}, {1e3 * c.seconds:.1f} ms per frame)",
    ]


def command_line(settings: Settings, tuned: Tuned) -> str:
    """Return the command that opens the window with the choice."""
    chosen = tuned.choice.setting
    return saved_scene.command_line(
        replace(
            settings, estimator=chosen.estimator, photons=tuned.choice.photons, radius=float(f"{chosen.radius:.4g}"),
            neighbours=chosen.neighbours, control=chosen.control, light=settings.light_chosen,
        )
    )  # fmt: skip


def _gathered(tuned: Tuned) -> str:
    return f", {tuned.paths} paths per vertex of moving objects" if tuned.paths else ""


def _name(setting) -> str:
    from gi_core.estimators import ESTIMATORS

    summary = ESTIMATORS[setting.estimator].summary(setting)
    return f"{setting.estimator}, {summary}" if summary else setting.estimator


def checked(solver: Solver, tuned: Tuned, bar) -> str:
    """Return the measured errors and frame time of the choice, in words."""
    from app.measure.tuning import measured

    at_rest, moving, frame, seconds = measured(solver, tuned, bar)
    return (
        f"measured: {100 * at_rest:.1f} % at rest, {100 * moving:.1f} % in motion "
        f"({frame:,} photons, {1e3 * seconds:.1f} ms per frame)"
    )
