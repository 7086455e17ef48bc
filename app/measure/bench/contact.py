"""`gi-viewer bench SCENE --contact`: what it costs that mobiles shorten regions, and have theirs shortened.

Each pose of the walk is computed twice in a row, with contact and as if objects did not meet, in alternating order:
whatever else the machine does meets both.
"""

from __future__ import annotations

import time

from app.cli.progress import Bar, compile_kernels, solve
from app.draw import motion
from app.measure.bench.series import Series
from app.measure.machine import commit, processor
from app.settings import STEP, Settings, UsageError, make_solver, open_moving_scene


def bench(settings: Settings, frames: int) -> list[str]:
    """Return the lines to print. Raises SceneError, and UsageError for settings under which nothing meets."""
    with Bar() as bar:
        bar("loading", 0.0)
        scene = open_moving_scene(settings)
        compile_kernels(bar)
        solver = make_solver(scene, settings)
        if solver.estimator != "tangent_plane" or not solver.setting.control:
            raise UsageError(f"--contact needs tangent_plane with artifact control, got {_what(solver)}")
        solve(solver, bar)
        return lines(solver, *measure(solver, frames, bar))


def _what(solver) -> str:
    return solver.estimator + ("" if solver.setting.control else " without it")


def measure(solver, frames: int, bar: Bar) -> tuple[dict[bool, tuple[Series, Series]], Series, Series]:
    """Return milliseconds by the clock and of the processor, with and without; receivers in contact, static and not."""
    estimate = solver.frame_parts().background.estimate
    lap = motion.walk(motion.paths_of(solver), STEP * solver.scene_size, min(frames, 1000))
    took, static, on_mobiles = {on: (Series(), Series()) for on in (True, False)}, Series(), Series()
    for k in range(-1, frames):  # the first one does not count
        bar("moving", max(k, 0) / frames)
        poses = lap[k % len(lap)]
        for on in (True, False) if k % 2 else (False, True):
            # Contacts of poses are found once: a frame elsewhere between the two makes each find its own.
            with estimate.contact_switched(on):
                solver.move_all(lap[(k - 1) % len(lap)])
                clock, cpu = time.perf_counter(), time.process_time()
                solver.move_all(poses)
                cpu, clock = time.process_time() - cpu, time.perf_counter() - clock
            if k >= 0:
                took[on][0].add(1e3 * clock)
                took[on][1].add(1e3 * cpu)
                if on:
                    static.add(solver.control_facts.stale)
                    on_mobiles.add(solver.control_facts.on_mobiles)
    return took, static, on_mobiles


def lines(solver, took: dict[bool, tuple[Series, Series]], static: Series, on_mobiles: Series) -> list[str]:
    """Return what was measured as lines for a person."""
    (clock, cpu), (clock_apart, cpu_apart) = took[True], took[False]
    rows = [
        ("scene", f"{solver.scene.name}: {solver.photons_traced:,} photons, radius {solver.radius:.4g} m"),
        ("machine", f"{processor()}, {solver.model.threads} threads, commit {commit() or 'unknown'}"),
        ("in contact", f"{static.median:,.0f} static receivers and {on_mobiles.median:,.0f} on mobiles (medians)"),
        ("without", f"{clock_apart.median:.2f} ms a frame, CPU {cpu_apart.median:.2f} ms (medians)"),
        ("with contact", f"{clock.median:.2f} ms a frame, CPU {cpu.median:.2f} ms"),
        ("it costs", f"{_more(clock.median, clock_apart.median)}, by CPU time {_more(cpu.median, cpu_apart.median)}"),
    ]
    return [f"{name:<14}{text}" for name, text in rows]


def _more(a: float, b: float) -> str:
    return f"{a - b:+.2f} ms ({100 * (a / b - 1):+.1f} %)" if b else "nothing"
