"""Irradiance of a frame whose static light comes from a better source than the frame's own photons.

A frame of few photons is noisy everywhere, but what a mobile changes is small. With F the frame's irradiance,
B that of the same photons without mobiles, and G a better answer for the static scene (all photons, or gathered):

    E = G F / B        where F < B: light is taken away, G is darkened in proportion
    E = G + (F - B)    elsewhere: light is added

F and B share their photons, so most of their noise cancels. The
difference alone would leave the noise of B in full shadow, where F is 0 and E must be; the ratio alone is
undefined where B is thin. Where F = B, E = G; as F < B makes B > 0, nothing is divided by zero, and nothing is
negative. If each segment is blocked or not on its own, F / B is an unbiased share however few there are, but
none (a binomial share does not depend on the count).

Most receivers hardly change, and what few photons say of them is chance: a photon more, one less. So of the change
E - G only the share is kept by which it exceeds what chance alone would make (James and Stein 1961, positive part):

    1 - v / d^2,   d = A - T,   v = q (T (B - T + q) / (B + q) + A)

in flux, all channels together: T taken out of B, A brought by branches, q a photon's. Each photon comes or not by
itself, those taken out as a share of those that were there, by Laplace's rule: one of one does not tell of full
shadow, eight of eight do. It is 0 where nothing stands out, nearly 1 where no doubt is left, and goes from one to
the other without a jump. What was measured is in docs/measurements.md.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import run_ranges
from gi_core.photons.flux_sums import CHUNK_BITS, CHUNK_GRAIN, NOT_ADDITIVE, Evaluated


@inlined
def _combined(frame, resting, better):
    if frame < resting:
        return better * (frame / resting)
    return better + (frame - resting)


@inlined
def _share_kept(taken, brought, before, each):
    """Return the share of a change that chance does not explain; fluxes are of all channels together."""
    difference = brought - taken
    chance = each * brought
    if taken > 0.0:
        chance += each * taken * (before - taken + each) / (before + each)
    return max(1.0 - chance / (difference * difference), 0.0) if difference != 0.0 else 0.0


@inlined
def _certain(sums, background, brought, each, r):
    """Return the share of receiver r's change that is kept."""
    if brought[r] == NOT_ADDITIVE:
        return 1.0
    before = background[r, 0] + background[r, 1] + background[r, 2]
    now = sums[r, 0] + sums[r, 1] + sums[r, 2]
    return _share_kept(float(before + brought[r] - now), float(brought[r]), float(before), each)


@kernel
def _read_out(changed, background, resting, better, same, sums, brought, each, scale, area, first, last, out):
    """Read chunks first .. last - 1 out; receivers of unchanged chunks keep their light at rest."""
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
            if same or r >= static:
                for c in range(3):
                    out[r, c] = sums[r, c] * factor
                continue
            kept = _certain(sums, background, brought, each, r)
            for c in range(3):
                E, at_rest = _combined(sums[r, c] * factor, resting[r, c], better[r, c]), better[r, c]
                out[r, c] = at_rest + kept * (E - at_rest) if kept < 1.0 else E


def frame_irradiance(
    frame: Evaluated,
    flux_unit: float,
    background: np.ndarray,
    resting: np.ndarray,
    better: np.ndarray,
    threads: int,
) -> np.ndarray:
    """Return E (R, 3) [W/m2] of a frame; flux_unit [W] is that of its sums.

    background: sums (n, 3) int64 of static receivers without mobiles, of the frame's photons; resting, better:
    irradiance (n, 3) of the same, of the frame's photons and of the better source; the same array twice gives the
    frame's own light as it is.
    """
    same, out = better is resting, np.empty((len(frame.sums), 3))

    def work(_, first, last):
        _read_out(
            frame.changed, background, resting, better, same, frame.sums, frame.brought, frame.carried,
            flux_unit, frame.area, first, last, out,
        )  # fmt: skip

    run_ranges(work, len(frame.changed), threads, CHUNK_GRAIN)
    return out
