"""Flux as integers: sums that do not depend on order, thread count or history.

A photon starts with 2^30 units in its largest channel. Throughput never grows, because the survival probability is
the largest channel of rho. One contribution is therefore at most 2^30, and an int64 sum holds 2^33 contributions.

A path has at most MAX_SEGMENTS = 64 segments, and each crosses a disc at most once. So MAX_PHOTONS = 2^27 = 134 million
photons cannot overflow a sum. One unit is 1e-9 of the photon's flux.
"""

from __future__ import annotations

from gi_core.base.jit import kernel

UNITS = 1 << 30
MAX_SEGMENTS = 64
MAX_PHOTONS = 1 << 27


@kernel
def attenuate(q, rho, survival):
    """Return flux q (integer) after reflection by rho with the given survival probability.

    Computed in float64 and rounded to nearest: the same bits on every machine.
    """
    return int(q * (rho / survival) + 0.5)
