"""Reflection models: one file per model, one line per model in `MODELS`.

A model is a module with PARAMETERS (name -> `common.Parameter`), RECIPROCAL, ANISOTROPIC, CONSERVES (True, or the
condition in words), SOURCE, and three functions of its parameters p:
`evaluate(p, i, o)` returns f [1/sr], (n, 3), without the Lambertian part and without a mirror, 0 below the surface;
`diffuse(p)` returns the Lambertian albedo kd (3,) that is split off; `mirror(p, cos_i)` the albedo (n, 3) of a perfect
mirror. Directions i, o are (n, 3) float64 unit vectors away from the surface, z along the normal, x along the tangent.
Every f is unchanged if x or y of both directions change their sign: tables store one quadrant (`gi_core.bsdf.table`).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import NamedTuple

import numpy as np

from gi_core.base.quotation import nearest, shown
from gi_core.bsdf.models import (
    blinn,
    eon,
    ggx,
    he,
    lafortune,
    lewis,
    oren_nayar,
    perfect_diffuse,
    perfect_specular,
    phong,
    poulin_fournier,
    schlick,
    strauss,
    torrance_sparrow,
    ward,
)
from gi_core.bsdf.models.common import Parameter, Values

MODELS: dict[str, ModuleType] = {
    "perfect_diffuse": perfect_diffuse,
    "perfect_specular": perfect_specular,
    "phong": phong,
    "blinn": blinn,
    "torrance_sparrow": torrance_sparrow,
    "poulin_fournier": poulin_fournier,
    "he": he,
    "ward": ward,
    "lewis": lewis,
    "schlick": schlick,
    "oren_nayar": oren_nayar,
    "strauss": strauss,
    "lafortune": lafortune,
    "eon": eon,
    "ggx": ggx,
}


class Lobe(NamedTuple):
    """A model with complete parameters, and its factor in a linear combination. Hashable."""

    model: str
    parameters: tuple[tuple[str, float | tuple[float, float, float]], ...]
    factor: float = 1.0

    def values(self) -> Values:
        """Return the parameters by name: a float, or (3,) float64 for a colour."""
        return {name: np.array(value) if isinstance(value, tuple) else value for name, value in self.parameters}


def lobe(model: str, parameters: Mapping[str, object] | None = None, factor: float = 1.0) -> Lobe:
    """Return a lobe, its parameters checked and completed by defaults.

    A colour is three numbers, or one for grey. ValueError is one sentence: rule and value found.
    """
    largest_factor = 1e6  # of a model in a linear combination: its sums stay finite
    if not (isinstance(model, str) and model in MODELS):
        raise ValueError(f"unknown reflection model {shown(model)}; {nearest(str(model), MODELS)}")
    rules: dict[str, Parameter] = MODELS[model].PARAMETERS
    values = dict(parameters or {})
    for name in values:
        if name not in rules:
            raise ValueError(f'{model} has no parameter "{name}"; it has {", ".join(rules)}')
    if not (_is_number(factor) and 0 <= factor <= largest_factor):
        raise ValueError(f"factor of {model} must be a number from 0 to {largest_factor:g}, got {shown(factor)}")
    checked = tuple((name, _checked(model, name, rules[name], values.get(name))) for name in rules)
    return Lobe(model, checked, float(factor))


def _checked(model: str, name: str, rule: Parameter, value) -> float | tuple[float, float, float]:
    """Return a parameter's value, its default if None, as a float or three floats."""
    value = rule.default if value is None else value
    parts = list(value) if isinstance(value, list | tuple | np.ndarray) else [value]
    fits = len(parts) in ((1, 3) if rule.colour else (1,))
    if not (fits and all(_is_number(part) and rule.low <= part <= rule.high for part in parts)):
        wanted = "a number or three (r, g, b)" if rule.colour else "a number"
        raise ValueError(f"{name} of {model} must be {wanted} from {rule.low:g} to {rule.high:g}, got {shown(value)}")
    if not rule.colour:
        return float(parts[0])
    red, green, blue = (float(part) for part in (parts if len(parts) == 3 else parts * 3))
    return red, green, blue


def _is_number(value) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
