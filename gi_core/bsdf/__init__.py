"""Reflection models, one per file, by `base.Bsdf`. Kernels call `lambertian` alone: all faces are diffuse so far."""

from gi_core.bsdf import lambertian
from gi_core.bsdf.base import Bsdf

BSDFS: dict[str, Bsdf] = {"lambertian": lambertian}
