"""Searches over few receivers and many segments: the part of `bench --tables` that the report has no table for."""

from __future__ import annotations

from app.cli.progress import Bar, solve
from app.measure.bench.bounds import best_seconds
from app.measure.bench.tables import table
from app.settings import Settings, make_solver, open_scene

SCENE = "living_room"  # a chair and a cat that stand on the floor
PHOTONS = 20_000
SEARCHES = ("disc_index", "ray_cache", "brute_force")


def measure(settings: Settings, bar: Bar) -> list[tuple[str, int, int, dict[str, float]]]:
    """Return name, discs, segments and seconds by search, a job."""
    from gi_core.instruments.search_timing import SearchTrial, few_receivers

    asked = Settings(scene=SCENE, photons=PHOTONS, estimator="tangent_plane", seed=settings.seed)
    solver = make_solver(open_scene(asked), asked)
    solve(solver, bar)
    out, jobs = [], few_receivers(solver)
    for k, job in enumerate(jobs):
        bar(f"{SCENE}: {job.name}", k / len(jobs))
        seconds = {}
        for search in SEARCHES:
            made = SearchTrial(search, job.discs).run(job.lines)
            seconds[search] = best_seconds(made if not job.rebuilt else _made_anew(search, job))
        out.append((job.name, len(job.discs.positions), len(job.lines.low), seconds))
    return out


def _made_anew(search: str, job):
    from gi_core.instruments.search_timing import SearchTrial

    return lambda: SearchTrial(search, job.discs).run(job.lines)()


def section(measured: list[tuple[str, int, int, dict[str, float]]]) -> str:
    """Return a table: who, how many, and milliseconds by search."""
    lines = [
        [name, f"{discs:,}", f"{segments:,}", *(f"{1e3 * seconds[search]:.2g}" for search in SEARCHES)]
        for name, discs, segments, seconds in measured
    ]
    body = table(["receivers", "how many", "segments", *(s.replace("_", " ") for s in SEARCHES)], lines)
    return (
        f"## Few receivers and many segments\n\n{body}\n\nMilliseconds; {SCENE}, {PHOTONS:,} photons. Discs in contact "
        "differ in each frame: for them making the search counts, too."
    )
