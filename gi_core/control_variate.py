"""Irradiance of a frame whose static light comes from a better source than the frame's own photons.

A frame of few photons is noisy everywhere, but what a mobile changes is small. With F the frame's irradiance,
B that of the same photons without mobiles, and G a better answer for the static scene (all photons, or gathered):

    E = G F / B        where F < B: light is taken away, G is darkened in proportion
    E = G + (F - B)    elsewhere: light is added

F and B share their photons, so most of their noise cancels. The
difference alone would leave the noise of B in full shadow, where F is 0 and E must be; the ratio alone is
undefined where B is thin. Where F = B, E = G; as F < B makes B > 0, nothing is divided by zero, and nothing is
negative. If each segment is blocked or not on its own, F / B is an unbiased share however few there are, but
none (a binomial share does not depend on the count). What was measured is in docs/measurements.md.
"""

from __future__ import annotations

import numpy as np

from gi_core.jit import inlined, kernel
from gi_core.sums import CHUNK_BITS, CHUNK_GRAIN, Evaluated
from gi_core.threads import run_ranges


@inlined
def _combined(frame, resting, better):
    if frame < resting:
        return better * (frame / resting)
    return better + (frame - resting)


@kernel
def _read_out(changed, resting, better, same, sums, scale, area, first, last, out):
    """Read chunks first .. last - 1 out; those that have not changed are what they are at rest."""
    static = len(resting)
    for chunk in range(first, last):
        start, stop = chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(out))
        if not changed[chunk]:
            for r in range(start, stop):
                for c in range(3):
                    out[r, c] = better[r, c]
            continue
        for r in range(start, stop):
            # No area, no light: nothing can reach such a receiver, or it has no face.
            factor = scale / area[r] if area[r] > 0.0 else 0.0
            for c in range(3):
                E = sums[r, c] * factor
                out[r, c] = E if same or r >= static else _combined(E, resting[r, c], better[r, c])


def frame_irradiance(
    frame: Evaluated, flux_unit: float, resting: np.ndarray, better: np.ndarray, threads: int
) -> np.ndarray:
    """Return E (R, 3) [W/m2] of a frame; flux_unit [W] is that of its sums.

    resting, better: irradiance (n, 3) of static receivers without mobiles, of the frame's photons and of the
    better source; the same array twice gives the frame's own light as it is.
    """
    out = np.empty(frame.sums.shape)
    same = better is resting

    def work(_, first, last):
        _read_out(frame.changed, resting, better, same, frame.sums, flux_unit, frame.area, first, last, out)

    run_ranges(work, len(frame.changed), threads, CHUNK_GRAIN)
    return out
