"""Flux as integers: sums that do not depend on order, thread count or history.

A photon starts with 2^30 units in its largest channel. Throughput never grows, because the survival probability is
the largest channel of rho. One contribution is therefore at most 2^30, and an int64 sum holds 2^33 contributions. A
segment crosses a disc at most once. So MAX_SEGMENTS = 2^32 stored segments cannot overflow a sum, nor can those of a
frame; they would fill 160 GB. One unit is 1e-9 of the photon's flux.

Paths end by survival alone. MAX_PATH only prevents endless loops: at a reflectance of 0.999 one path in 10^28 is so
long.
"""

from __future__ import annotations

from gi_core.base.jit import kernel

UNITS = 1 << 30
MAX_SEGMENTS = 1 << 32
MAX_PHOTONS = 1 << 27
MAX_PATH = 1 << 16  # segments


@kernel
def attenuate(q, rho, survival):
    """Return flux q (integer) after reflection by rho with the given survival probability.

    Computed in float64 and rounded to nearest: the same bits on every machine.
    """
    return int(q * (rho / survival) + 0.5)
