"""The contract of a reflection model: three kernels of a module.

Directions are unit vectors in the local frame of the reflecting side, z along its normal. `photons.trace` and
`gather.path_tracer` call `sample` and `weight`, `gather.shared_samples` `sample`, `lights.next_event` `pdf`.
Receivers keep irradiance E, from which `geometry.radiosity` and `gather.one_bounce` read rho E / pi: a model whose f
depends on direction needs another record there.
"""

from __future__ import annotations

from typing import Protocol


class Bsdf(Protocol):
    """A reflection model f [1/sr]."""

    def sample(self, u: float, v: float) -> tuple[float, float, float]:
        """Return a direction of flight (x, y, z) after reflection from two numbers in [0, 1). Always valid: z >= 0."""

    def pdf(self, cos_out: float) -> float:
        """Return the density [1/sr] of `sample` at a direction of z = cos_out; 0 below the surface."""

    def weight(self, rho: float) -> float:
        """Return f cos / pdf of a sampled direction for one channel of reflectance rho in [0, 1); 0 absorbs.

        Photons and paths multiply their flux by it, so no caller evaluates f alone.
        """
