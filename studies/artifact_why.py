"""Error at receivers beside objects, split into noise and variation of light within a disc.

    python -m studies.artifact_why [--times N]

On a flat floor a perfect estimate is the mean of E over a receiver's region. This mean is path traced at points
of the region. *Shape* is its difference from E at the receiver, which no number of photons removes. *Noise* is the
difference of the estimate from it. Shape is also predicted for regions cut to be symmetric, down to half a radius.
The scenes are in tests/support.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from gi_core.base.random_numbers import basis
from gi_core.discs.region import RAYS
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.solver import Solver
from tests.support import control_scenes as scenes

CASES = {
    "leg, black": lambda: scenes.leg(True, True),
    "book, black": lambda: scenes.book(True),
    "leg, white": lambda: scenes.leg(True),
    "book, white": lambda: scenes.book(),
}
PATHS, SPREAD, PATHS_THERE = 1024, 24, 64  # paths per receiver; points per region; paths per point
OPEN = 300  # receivers in the open that are measured
LEAST = 0.5  # of the radius: least extent of a symmetric region


def reaches(solver: Solver, rows: np.ndarray) -> np.ndarray:
    """Return how far the regions of static receivers reach (n, RAYS) [m] in the solver's frame."""
    estimate, r = solver.frame.background.estimate, solver.setting.radius
    contact = estimate._contact.contacts_at(solver.frame.change.at, mobiles=False).regions[0]
    alone = estimate.searches[0].discs.regions
    out = np.full((len(rows), RAYS), r)
    for j, i in enumerate(rows):
        if alone.row[i] >= 0:
            out[j] = alone.reach[alone.row[i], :, 1] * (r / 255)
    met = np.flatnonzero(np.isin(contact.rows, rows))
    out[np.searchsorted(rows, contact.rows[met])] = contact.reach[met, :, 1] * (r / 255)
    return out


def spread(d: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return n points (m, n, 2) [m] spread evenly over polygons with corners at distances d (m, RAYS)."""
    triangles = d * np.roll(d, -1, axis=1)
    up_to = np.cumsum(triangles, axis=1) / triangles.sum(axis=1)[:, None]
    u = (np.arange(n) + rng.random((len(d), n))) / n
    k = np.array([np.searchsorted(a, b) for a, b in zip(up_to, u, strict=True)]).clip(0, RAYS - 1)
    s, t = rng.random((2, len(d), n))
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    row, out = np.arange(len(d))[:, None], 0.0
    for weight, corner in ((s, k), (t, (k + 1) % RAYS)):
        angle = 2 * math.pi * corner / RAYS
        out = out + (weight * d[row, corner])[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return out


def mean_over(solver: Solver, points: np.ndarray, normals: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return the mean of the true E (m,) [W/m2] over regions around points (m, 3)."""
    axes = np.array([basis(*map(float, n)) for n in normals]).reshape(-1, 2, 3)
    there = points[:, None] + spread(d, SPREAD, np.random.default_rng(0)) @ axes
    facing = np.broadcast_to(normals[:, None], there.shape)
    E = reference_irradiance(
        solver.scene, there.reshape(-1, 3), facing.reshape(-1, 3), PATHS_THERE, 1, model=solver.model
    )[0]
    return E[:, 0].reshape(len(points), SPREAD).mean(axis=1)


def areas(d: np.ndarray, radius: float) -> np.ndarray:
    """Return the shares (m,) of a free disc."""
    return (d * np.roll(d, -1, axis=1)).mean(axis=1) / radius**2


def line(name: str, where: str, share: np.ndarray, T, M, noise: float, error: str = "", light: str = "") -> str:
    shape, mean = np.abs(M - T).mean(), T.mean()
    return (
        f"{name:<14}{where:<8}{len(T):>5}{share.mean():>6.2f}{light:>7}{M.mean() / mean:>8.3f}{error:>7}"
        f"{100 * shape / mean:>6.1f}%{100 * noise / mean:>6.1f}%"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--times", type=float, default=6.0, help="photons, times those of the tests (6)")
    times = parser.parse_args().times
    print(f"{'':<14}{'where':<8}{'n':>5}{'area':>6}{'E/T':>7}{'mean/T':>8}{'error':>7}{'shape':>7}{'noise':>7}")
    for name, build in CASES.items():
        case = build()
        solver = Solver(case.scene, photons=int(times * case.photons), radius=case.radius)
        solver.solve()
        beside, free = scenes.classes(case, solver.surfaces, solver.receivers)
        some = np.random.default_rng(0).permutation(np.flatnonzero(free))[:OPEN]
        rows = np.sort(np.concatenate([np.flatnonzero(beside), some]))
        points, normals = (a[rows] for a in evaluation_points(solver.surfaces, solver.receivers))
        T = reference_irradiance(case.scene, points, normals, PATHS, 0, model=solver.model)[0][:, 0]
        E, d = solver.irradiance[rows, 0], reaches(solver, rows)
        M = mean_over(solver, points, normals, d)

        for where, of in (("beside", beside[rows]), ("open", ~beside[rows])):
            error = f"{100 * np.abs(E - T)[of].mean() / T[of].mean():.1f}%"
            light, noise = f"{E[of].mean() / T[of].mean():.3f}", np.abs(E - M)[of].mean()
            print(line(name, where, areas(d[of], case.radius), T[of], M[of], noise, error, light), flush=True)
        # Chance goes as 1 / sqrt(area): predicted from that of the regions as they are.
        of = beside[rows]
        even = np.minimum(d, np.maximum(np.roll(d, RAYS // 2, axis=1), LEAST * case.radius))
        more = np.sqrt(areas(d, case.radius) / areas(even, case.radius))
        M, noise = mean_over(solver, points, normals, even), (more * np.abs(E - M))[of].mean()
        print(line(name, "even", areas(even[of], case.radius), T[of], M[of], noise), flush=True)


if __name__ == "__main__":
    main()
