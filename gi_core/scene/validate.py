"""Rules for every scene, read from a file or built from arrays, checked before anything is traced."""

from __future__ import annotations

import numpy as np

from gi_core.scene.errors import SceneError
from gi_core.scene.types import DirectionalLight, Light, Material, Mesh, PointLight, Scene, SpotLight

FLUX_OF = {PointLight: "flux", SpotLight: "intensity", DirectionalLight: "irradiance"}  # else radiance


def check_scene(scene: Scene) -> None:
    """Raise SceneError, one sentence, for the first broken rule."""
    for m in scene.materials:
        _check_material(scene.name, m)
    for part, mesh in [("the static part", scene.static), *((f'mobile "{m.name}"', m.mesh) for m in scene.mobiles)]:
        _check_mesh(f"{scene.name}: {part}", mesh, len(scene.materials))
    for mobile in scene.mobiles:
        emitting = [k for k in np.unique(mobile.mesh.face_material) if max(scene.materials[k].emission) > 0]
        if emitting:
            name = scene.materials[emitting[0]].name
            raise SceneError(
                f'{scene.name}: mobile "{mobile.name}": material "{name}" emits light, but lights must stand still: '
                "give it a material without emission, or make it static"
            )
    for light in scene.lights:
        _check_light(scene.name, light)
    if not _finite(scene.up, 3) or not any(scene.up):
        raise SceneError(f"{scene.name}: up must be three numbers that are not all 0, got {scene.up!r}")


def _check_material(scene: str, m: Material) -> None:
    where = f'{scene}: material "{m.name}"'
    if not _finite(m.reflectance, 3) or not all(0 <= c < 1 for c in m.reflectance):
        raise SceneError(f"{where}: reflectance must be three numbers in [0, 1), got {m.reflectance!r}")
    if not _finite(m.emission, 3) or min(m.emission) < 0:
        raise SceneError(f"{where}: emission must be three numbers >= 0, got {m.emission!r}")


def _check_mesh(where: str, mesh: Mesh, materials: int) -> None:
    vertices, faces, material = np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(mesh.face_material)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise SceneError(f"{where}: vertices must be finite numbers of shape (V, 3), got shape {vertices.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise SceneError(f"{where}: faces must be integers of shape (F, 3), got {faces.dtype} {faces.shape}")
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise SceneError(
            f"{where}: faces must name vertices 0 to {len(vertices) - 1}, got {faces.min()} to {faces.max()}"
        )
    if material.shape != (len(faces),) or material.dtype.kind not in "iu":
        raise SceneError(
            f"{where}: face_material must be {len(faces)} integers, one a face, got {material.dtype} {material.shape}"
        )
    if len(material) and not (material.min() >= 0 and material.max() < materials):
        raise SceneError(
            f"{where}: face_material must name materials 0 to {materials - 1}, got {material.min()} to {material.max()}"
        )
    rho = mesh.face_reflectance
    if rho is not None and (np.shape(rho) != (len(faces), 3) or not ((rho >= 0) & (rho < 1)).all()):
        raise SceneError(f"{where}: face_reflectance must be numbers in [0, 1) of shape ({len(faces)}, 3)")


def _check_light(scene: str, light: Light) -> None:
    where, key = f'{scene}: light "{light.name}"', FLUX_OF.get(type(light), "radiance")
    strength = light._asdict()[key]
    if not _finite(strength, 3) or min(strength) < 0:
        raise SceneError(f"{where}: {key} must be three numbers >= 0, got {strength!r}")
    vectors = {name: value for name, value in light._asdict().items() if name in ("position", "direction")}
    for name, vector in vectors.items():
        if not _finite(vector, 3):
            raise SceneError(f"{where}: {name} must be three finite numbers, got {vector!r}")
    if not any(vectors.get("direction", (1,))):
        raise SceneError(f"{where}: direction must not be all 0")
    if isinstance(light, SpotLight) and not 0 <= light.inner_degrees <= light.outer_degrees <= 90:
        raise SceneError(
            f"{where}: angles must be 0 <= inner_degrees <= outer_degrees <= 90, "
            f"got {light.inner_degrees!r} and {light.outer_degrees!r}"
        )


def _finite(values, n: int) -> bool:
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        return False
    return array.shape == (n,) and bool(np.isfinite(array).all())
