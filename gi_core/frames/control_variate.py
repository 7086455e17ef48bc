"""Irradiance of a frame whose static light comes from a better source than the frame's own photons.

A frame of few photons is noisy everywhere, but the change that mobiles cause is small. F is the frame's irradiance, B
that of the same photons without mobiles, and G a better static solution (all photons, or gathered light):

    E = G F / B        where F < B: light is removed, G is scaled down
    E = G + (F - B)    elsewhere: light is added

F and B share their photons, so most of their noise cancels. The difference alone would leave the noise of B in full
shadow, where F = 0 and E must be 0. The ratio alone is undefined where B = 0. Where F = B, E = G. F < B implies B > 0,
so there is no division by zero, and E is never negative. If segments are blocked independently, F / B is an unbiased
share for any number of segments but zero.

Most receivers hardly change, and their measured change is noise of a few photons. The change E - G is therefore shrunk
by its estimated noise (James and Stein 1961, positive part), with the factor

    1 - v / d^2,   d = A - T,   v = q (T (B - T + q) / (B + q) + A)

in flux, summed over channels: T removed from B, A added by new suffixes, q the flux per photon. Photons are
independent. The variance of the removed share follows Laplace's rule, so one of one removed photon is no evidence of
full shadow, but eight of eight are. The factor is continuous: 0 for changes within noise, nearly 1 far above it.
docs/archive/measurements.md has the measurements.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import run_ranges
from gi_core.lights.mix import mixed
from gi_core.photons.flux_sums import CHUNK_BITS, CHUNK_GRAIN, NOT_ADDITIVE, Evaluated


@inlined
def _combined(frame, resting, better):
    if frame < resting:
        return better * (frame / resting)
    return better + (frame - resting)


@inlined
def _shrinkage(taken, new_flux, before, flux_per_cut):
    """Return the James-Stein factor of a change, 0 .. 1; fluxes are summed over channels."""
    difference = new_flux - taken
    chance = flux_per_cut * new_flux
    if taken > 0.0:
        chance += flux_per_cut * taken * (before - taken + flux_per_cut) / (before + flux_per_cut)
    return max(1.0 - chance / (difference * difference), 0.0) if difference != 0.0 else 0.0


@inlined
def _certain(sums, background, new_flux, levels, flux_per_cut, r):
    """Return the factor of receiver r's change; levels (G,): means over channels."""
    if new_flux[r, 0] == NOT_ADDITIVE:
        return 1.0
    before = now = new = 0.0
    for g in range(len(levels)):
        before += levels[g] * (background[r, 3 * g] + background[r, 3 * g + 1] + background[r, 3 * g + 2])
        now += levels[g] * (sums[r, 3 * g] + sums[r, 3 * g + 1] + sums[r, 3 * g + 2])
        new += levels[g] * new_flux[r, g]
    return _shrinkage(before + new - now, new, before, flux_per_cut)


@kernel
def _read_out(
    changed, background, resting, better, same, sums, new_flux, levels, mean_levels, flux_per_cut, scale, area, first,
    last, out,
):  # fmt: skip
    """Write irradiance of the changed chunks among first .. last - 1."""
    static = len(resting)
    for chunk in range(first, last):
        start, stop = chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(out))
        if not changed[chunk]:
            continue
        for r in range(start, stop):
            # Area 0: no light can reach the receiver, or it has no face.
            factor = scale / area[r] if area[r] > 0.0 else 0.0
            x, y, z = mixed(sums, r, levels)
            if same or r >= static:
                out[r, 0], out[r, 1], out[r, 2] = x * factor, y * factor, z * factor
                continue
            kept = _certain(sums, background, new_flux, mean_levels, flux_per_cut, r)
            for c, flux in enumerate((x, y, z)):
                E, at_rest = _combined(flux * factor, resting[r, c], better[r, c]), better[r, c]
                out[r, c] = at_rest + kept * (E - at_rest) if kept < 1.0 else E


def frame_irradiance(
    frame: Evaluated,
    flux_unit: float,
    background: np.ndarray,
    resting: np.ndarray,
    better: np.ndarray,
    levels: np.ndarray,
    threads: int,
) -> np.ndarray:
    """Return E (R, 3) [W/m2] of a frame at levels (G, 3) of its lamps; flux_unit [W] of its sums.

    background: sums (n, 3 G) int64 of static receivers without mobiles, of the frame's photons. resting, better:
    irradiance (n, 3) [W/m2] without mobiles, of the frame's photons and of the better source. The same array for both
    gives the frame's own light unchanged.
    """
    same, out = better is resting, np.empty((len(frame.sums), 3))
    mean_levels = levels.mean(axis=1)
    flux_per_cut = frame.cut.per_photon(mean_levels)

    def work(_, first, last):
        rows = slice(first << CHUNK_BITS, min(last << CHUNK_BITS, len(better)))
        out[rows] = better[rows]  # receivers of unchanged chunks keep their light at rest
        _read_out(
            frame.changed, background, resting, better, same, frame.sums, frame.new_flux, levels, mean_levels,
            flux_per_cut, flux_unit, frame.area, first, last, out,
        )  # fmt: skip

    run_ranges(work, len(frame.changed), threads, CHUNK_GRAIN)
    return out
