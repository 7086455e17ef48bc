"""Scaling of a mesh file with its lights and its camera."""

from __future__ import annotations

from typing import assert_never

from gi_core.files.formats.mesh_file import MeshFile
from gi_core.scene.types import Camera, DirectionalLight, Light, PhotometricLight, PointLight, SkyLight, SpotLight


def scaled(read: MeshFile, factor: float) -> MeshFile:
    """Return the file with every length times `factor`, and the same picture.

    Irradiance falls with the square of the distance: lamps with a place get the square of the factor, so that
    irradiance stays. Radiance and sunlight do not depend on distance and stay.
    """
    if factor == 1.0:
        return read
    camera = read.camera
    if camera is not None:
        camera = Camera(_times(camera.position, factor), _times(camera.target, factor), camera.vertical_fov_degrees)
    return read._replace(
        mesh=read.mesh._replace(vertices=read.mesh.vertices * factor),
        lights=[_light(light, factor) for light in read.lights],
        camera=camera,
    )


def _light(light: Light, factor: float) -> Light:
    match light:
        case PointLight() | PhotometricLight():
            return light._replace(position=_times(light.position, factor), flux=_times(light.flux, factor**2))
        case SpotLight():
            return light._replace(position=_times(light.position, factor), intensity=_times(light.intensity, factor**2))
        case DirectionalLight() | SkyLight():
            return light
        case _:
            assert_never(light)


def _times(values, factor: float) -> tuple[float, float, float]:
    return tuple(v * factor for v in values)
