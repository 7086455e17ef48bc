"""The perfectly diffuse surface: f = rho / pi, sampled by pdf = cos / pi. See the package for the contract."""

from __future__ import annotations

import math

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import cosine_hemisphere


@kernel
def sample(u, v):
    """Return a direction (x, y, z) distributed as pdf()."""
    return cosine_hemisphere(u, v)


@kernel
def pdf(cos_out):
    """Return the density [1/sr] of sample()."""
    return max(0.0, cos_out) / math.pi


@kernel
def weight(rho):
    """Return f cos / pdf of a sampled direction: rho exactly, without the rounding of the quotient."""
    return rho
