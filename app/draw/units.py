"""Quantities and units of a scene: photometric for `units = "photometric"`, else radiometric."""

from __future__ import annotations

from typing import NamedTuple


class Units(NamedTuple):
    """Names and units of light on and from a surface."""

    on_surface: str  # quantity per area
    per_area: str
    from_surface: str  # quantity per area and solid angle
    per_solid_angle: str
    flux: str


RADIOMETRIC = Units("Irradiance", "W/m²", "radiance", "W/m²/sr", "W")
PHOTOMETRIC = Units("Illuminance", "lx", "luminance", "cd/m²", "lm")


def units_of(units: str) -> Units:
    """Return the quantities for `Scene.units`."""
    return PHOTOMETRIC if units == "photometric" else RADIOMETRIC
