"""Daylight by place, date and hour: where the sun stands, and the light of a clear sky, as two lights of a scene.

The sun: J. Meeus, Astronomical Algorithms, 2nd ed. 1998, chapters 12, 13 and 25 (low accuracy), with parallax, and
refraction by equation 16.4, at 1010 hPa and 10 degrees C. From 1901 to 2099 it is at most 0.009 degrees from NREL's
Solar Position Algorithm, at 6,004 random times and places with the sun up.
Irradiance: P. Ineichen, R. Perez, Solar Energy 73 (2002) 151, at sea level; air mass of F. Kasten, A. Young, Applied
Optics 28 (1989) 4735. Illuminance: R. Perez et al., Solar Energy 44 (1990) 271, clearest skies, 2 cm of water.
"""

from __future__ import annotations

import datetime
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import frame_of, unit
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.pose import three
from gi_core.scene.types import Daylight, DirectionalLight, Scene, SkyLight

LUMENS_PER_WATT = 179.0  # of white light of equal energy
SUN, SKY = "sun", "sky"  # names of the two lights
NOTE = "daylight: "  # begins the note on a sun below the horizon


class Sun(NamedTuple):
    """Where the sun's centre stands, seen through air."""

    altitude: float  # degrees above the horizon
    azimuth: float  # degrees from north by east
    distance: float  # [au]

    def __str__(self) -> str:
        side = "above" if self.altitude > 0 else "below"
        return f"{abs(self.altitude):.2f} degrees {side} the horizon, {self.azimuth:.2f} from north by east"


def sun_of(daylight: Daylight) -> Sun:
    """Return where the sun stands."""
    latitude, longitude = map(math.radians, daylight.place)
    day = datetime.date.fromisoformat(daylight.date) - datetime.date(2000, 1, 1)
    days = day.days + (daylight.hour - daylight.utc_offset) / 24 - 0.5  # since 2000-01-01 12:00 UTC
    t = days / 36525
    anomaly = math.radians(357.52911 + (35999.05029 - 0.0001537 * t) * t)
    centre = (1.914602 - 0.004817 * t) * math.sin(anomaly) + 0.000289 * math.sin(3 * anomaly)
    centre += (0.019993 - 0.000101 * t) * math.sin(2 * anomaly)
    e, node = 0.016708634 - 0.000042037 * t, math.radians(125.04 - 1934.136 * t)
    distance = 1.000001018 * (1 - e * e) / (1 + e * math.cos(anomaly + math.radians(centre)))
    nutation = -0.00478 * math.sin(node)
    true = 280.46646 + (36000.76983 + 0.0003032 * t) * t + centre
    apparent = math.radians(true - 0.00569 + nutation)
    tilt = math.radians(23.439291 - 0.0130042 * t + 0.00256 * math.cos(node))
    ascension = math.atan2(math.cos(tilt) * math.sin(apparent), math.cos(apparent))
    declination = math.asin(math.sin(tilt) * math.sin(apparent))
    sidereal = 280.46061837 + 360.98564736629 * days + nutation * math.cos(tilt)
    angle = math.radians(sidereal) + longitude - ascension
    x = math.sin(declination) * math.cos(latitude) - math.cos(declination) * math.cos(angle) * math.sin(latitude)
    y = -math.cos(declination) * math.sin(angle)  # x and y: towards north and east
    z = math.sin(declination) * math.sin(latitude) + math.cos(declination) * math.cos(angle) * math.cos(latitude)
    altitude = math.degrees(math.atan2(z, math.hypot(x, y)))
    altitude -= 0.00244 * math.cos(math.radians(altitude))  # parallax
    if altitude > -1:  # degree; else the sun is down, refraction or not
        altitude += 1.02 / 60 / math.tan(math.radians(altitude + 10.3 / (altitude + 5.11)))
    return Sun(altitude, math.degrees(math.atan2(y, x)) % 360, distance)


def clear_sky(sun: Sun, turbidity: float) -> tuple[float, float]:
    """Return the illuminance [lx] by the sun on a plane that faces it, and by the sky on open ground.

    turbidity: of Linke; both are 0 while the sun is below the horizon.
    """
    if sun.altitude <= 0:
        return 0.0, 0.0
    height = math.sin(math.radians(sun.altitude))
    mass = 1 / (height + 0.50572 * (sun.altitude + 6.07995) ** -1.6364)
    outside = 1367 / sun.distance**2  # [W/m2]
    whole = 0.868 * outside * height * math.exp(-0.0387 * mass * turbidity)
    beam = 0.827 * outside * math.exp(-0.09 * mass * (turbidity - 1))
    beam = min(beam, whole / height * (1 - (0.1 - 0.2 * math.exp(-turbidity)) / 0.982))
    diffuse = whole - beam * height
    brightness = mass * diffuse / outside
    from_zenith = math.radians(90 - sun.altitude)
    of_beam = 101.18 + 1.58 * 2 - 1.10 * math.exp(5.73 * from_zenith - 5) - 8.29 * brightness  # [lm/W]
    of_sky = 152.23 + 0.35 * 2 - 45.27 * height - 7.98 * math.log(brightness)
    return max(0.0, beam * of_beam), diffuse * of_sky


def axes_of(daylight: Daylight, up) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return east, north and up, unit vectors (3,), in the axes of a scene."""
    east, north, up = frame_of(up)
    if daylight.north is not None:
        east = unit(np.cross(daylight.north, up))
        north = np.cross(up, east)
    return east, north, up


def lights_of(daylight: Daylight, up, units: str) -> tuple[DirectionalLight, SkyLight]:
    """Return the lights "sun" and "sky" in the axes of a scene; units: as of Scene."""
    sun, (east, north, up) = sun_of(daylight), axes_of(daylight, up)
    h, a = math.radians(sun.altitude), math.radians(sun.azimuth)
    to_sun = math.cos(h) * (math.cos(a) * north + math.sin(a) * east) + math.sin(h) * up
    E, E_sky = (E / (1 if units == "photometric" else LUMENS_PER_WATT) for E in clear_sky(sun, daylight.turbidity))
    sky = SkyLight(SKY, (E_sky / math.pi,) * 3, daylight.sky, three(to_sun))
    return DirectionalLight(SUN, three(-to_sun), (E,) * 3), sky


def daylit(scene: Scene, daylight: Daylight, where: str) -> Scene:
    """Return a scene with daylight, whose lights replace those of the scene's own. Raises SceneError at a place."""
    if daylight.north is not None and float(np.linalg.norm(np.cross(unit(daylight.north), unit(scene.up)))) < 1e-6:
        got = shown(list(daylight.north))
        raise SceneError(f"{where}: [daylight]: north must not lie along up, got {got} for both; leave it out")
    sun, sky = lights_of(daylight, scene.up, scene.units)
    if scene.daylight is None:
        for light in scene.lights:
            if light.name in (sun.name, sky.name):
                raise SceneError(
                    f'{where}: light "{light.name}": names must differ, [daylight] has this one; rename the light'
                )
        lights = (*scene.lights, sun, sky)
    else:
        own = {(type(light), light.name): light for light in (sun, sky)}
        lights = tuple(own.get((type(light), light.name), light) for light in scene.lights)
    notes = tuple(note for note in scene.notes if not note.startswith(NOTE))
    if (now := sun_of(daylight)).altitude <= 0:
        notes += (f"{NOTE}the sun is {now}: no light",)
    return replace(scene, daylight=daylight, lights=lights, notes=notes)
