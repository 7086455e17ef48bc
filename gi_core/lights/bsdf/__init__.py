"""Reflection models, one per file, by `base.Bsdf`. Kernels call `lambertian` alone: all faces are diffuse so far."""

from gi_core.lights.bsdf import lambertian
from gi_core.lights.bsdf.base import Bsdf

BSDFS: dict[str, Bsdf] = {"lambertian": lambertian}
