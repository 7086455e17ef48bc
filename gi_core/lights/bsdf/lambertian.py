"""The perfectly diffuse surface: f = rho / pi.

Directions are in the local frame of the side that is lit, z along its normal.
`sample` returns the direction only: with pdf = cos / pi the weight f cos / pdf is rho exactly.
"""

from __future__ import annotations

import math

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import cosine_hemisphere


@kernel
def eval(rho, cos_out):
    """Return f(w_i, w_o) cos(theta_o) for one channel; 0 below the surface."""
    return rho / math.pi * max(0.0, cos_out)


@kernel
def sample(u, v):
    """Return a direction (x, y, z) distributed as pdf()."""
    return cosine_hemisphere(u, v)


@kernel
def pdf(cos_out):
    """Return the density [1/sr] of sample()."""
    return max(0.0, cos_out) / math.pi
