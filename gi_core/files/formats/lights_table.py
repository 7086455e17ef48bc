"""Lights of scene files: a table [[light]] per light, read by its type, and changed key by key."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.photometry_file import PhotometryFile, read_photometry
from gi_core.files.formats.toml_fields import Table
from gi_core.scene.errors import SceneError
from gi_core.scene.types import DirectionalLight, Light, PhotometricLight, PointLight, SkyLight, SpotLight

LIGHTS = {
    "point": ("position", "flux"),
    "spot": ("position", "direction", "intensity", "inner_degrees", "outer_degrees"),
    "panel": ("position", "direction", "c0", "flux", "size"),
    "photometric": ("file", "position", "direction", "c0", "flux", "size"),
    "directional": ("direction", "irradiance"),
    "sky": ("radiance",),
}
# A surface of constant radiance: intensity falls with the cosine, linear between whole degrees within 4e-5.
GAMMAS, PLANES = np.arange(0.0, 91.0), np.array([0.0, 360.0])
COSINE = np.tile(np.append(np.cos(np.radians(GAMMAS[:-1])), 0.0), (2, 1))


class Luminaires:
    """Photometric files of a scene, each read once, and facts of the scene that their lights need."""

    def __init__(self, folder: Path, boundary: Boundary, units: str, up: tuple[float, float, float]):
        self.files: dict[Path, PhotometryFile] = {}
        self.photometric, self.up = units == "photometric", np.array(up)
        self._folder, self._boundary = folder, boundary

    def read(self, name: str, where: str) -> PhotometryFile:
        path = self._folder / name
        if path not in self.files:
            self.files[path] = read_photometry(path, f"{where}: {name}", self._boundary)
        return self.files[path]


def read_light(values: dict, where: str, default_name: str, luminaires: Luminaires) -> Light:
    """Return the light of a table [[light]]. Raises SceneError."""
    kind = Table({k: v for k, v in values.items() if k == "type"}, where, ("type",)).text("type", choices=tuple(LIGHTS))
    t = Table(values, where, ("type", "name", *LIGHTS[kind]))
    name = t.text("name", default_name)
    return _photometric(t, name, luminaires) if kind == "photometric" else READERS[kind](t, name)


def changed_light(light: Light, table: Table) -> Light:
    """Return a light with the values that a table gives in place of its own. Raises SceneError for a wrong key."""
    keys = light._fields[1:] if not isinstance(light, PhotometricLight) else LIGHTS["panel"]
    t, changes = Table(table.values, table.where, keys), {}
    for key in t.values:
        changes[key] = t.number(key) if key.endswith("degrees") else t.vector(key, 2 if key == "size" else 3)
    return light._replace(**changes)


def _spot(t: Table, name: str) -> SpotLight:
    outer = t.number("outer_degrees", above=0, below=90.0001)
    inner = t.number("inner_degrees", 0.0, least=0)
    if inner > outer:
        raise SceneError(f"{t.where}: inner_degrees must be at most outer_degrees {outer:g}, got {inner:g}")
    return SpotLight(name, t.vector("position"), t.direction("direction"), t.vector("intensity", least=0), inner, outer)


def _panel(t: Table, name: str) -> PhotometricLight:
    axis, size = t.direction("direction"), t.vector("size", 2, least=0)
    flux = t.vector("flux", least=0)
    return PhotometricLight(name, t.vector("position"), axis, _c0(t), flux, GAMMAS, PLANES, COSINE, size)


def _photometric(t: Table, name: str, luminaires: Luminaires) -> PhotometricLight:
    file = luminaires.read(t.text("file"), t.where)
    direction = np.array(t.direction("direction"))
    axis = direction / np.sqrt((direction * direction).sum())
    if "flux" in t:
        flux = t.vector("flux", least=0)
    elif luminaires.photometric:
        tilt = math.degrees(math.acos(min(max(-float((axis * luminaires.up).sum()), -1.0), 1.0)))
        flux = (file.flux * (file.tilt.factor(tilt) if file.tilt else 1.0),) * 3
    else:
        raise SceneError(
            f"{t.where}: flux is missing; write flux = [r, g, b] in watts, or units = "
            f'"photometric" at the top of the file for the {file.flux:.0f} lm of {t.text("file")}'
        )
    at, size = t.vector("position"), t.vector("size", 2, file.size, least=0)
    axes = t.direction("direction"), _c0(t)
    return PhotometricLight(name, at, *axes, flux, file.gammas, file.planes, file.intensity, size)


def _c0(t: Table) -> tuple[float, float, float]:
    """Return the direction of C0, by default the axis of coordinates most perpendicular to the light's direction."""
    return t.direction("c0", c0_of(t.direction("direction")))


def c0_of(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the axis of coordinates, x, y or z, that is most perpendicular to a direction; the first of several."""
    axis = np.array(direction) / np.sqrt((np.array(direction) ** 2).sum())
    x, y, z = np.eye(3)[int(np.argmin(np.abs(axis)))].tolist()
    return x, y, z


READERS: dict[str, Callable[[Table, str], Light]] = {  # one per key of LIGHTS, except "photometric"
    "point": lambda t, name: PointLight(name, t.vector("position"), t.vector("flux", least=0)),
    "directional": lambda t, name: DirectionalLight(name, t.direction("direction"), t.vector("irradiance", least=0)),
    "sky": lambda t, name: SkyLight(name, t.vector("radiance", least=0)),
    "spot": _spot,
    "panel": _panel,
}
