"""The perfectly diffuse surface: f = rho / pi, sampled by pdf = cos / pi.

Directions are unit, in the frame of the reflecting side, z along its normal. Photons and paths multiply their flux by
weight(), so no caller evaluates f alone.
"""

from __future__ import annotations

import math

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import cosine_hemisphere


@kernel
def sample(u, v):
    """Return a direction (x, y, z), z >= 0, distributed as pdf(), from two numbers in [0, 1)."""
    return cosine_hemisphere(u, v)


@kernel
def pdf(cos_out):
    """Return the density [1/sr] of sample() at a direction of z = cos_out; 0 below the surface."""
    return max(0.0, cos_out) / math.pi


@kernel
def weight(rho):
    """Return f cos / pdf of a sampled direction for a channel: rho exactly, without the rounding of the quotient."""
    return rho
