"""Flux as integers: sums that do not depend on order, thread count or history.

A photon starts with its largest channel at 2^30 units; throughput never grows (survival probability
is the largest channel of rho), so one contribution is at most 2^30 and an int64 sum holds 2^33 of
them. A photon makes at most MAX_SEGMENTS = 64 segments and each crosses a disc at most once, so
2^27 = 134 million photons cannot overflow it; more are refused. One unit is a share 1e-9 of the
photon's flux.
"""

from __future__ import annotations

from gi_core.base.jit import kernel

UNITS = 1 << 30
MAX_SEGMENTS = 64
MAX_PHOTONS = 1 << 27


@kernel
def attenuate(q, rho, survival):
    """Return flux q (integer) after reflection by rho with the given survival probability.

    Elementwise float64 and rounded to nearest: exact for integers up to 2^53, the same everywhere.
    """
    return int(q * (rho / survival) + 0.5)
