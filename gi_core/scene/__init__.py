"""Scenes: the types, and the files they come from."""

from gi_core.scene.errors import SceneError
from gi_core.scene.types import (
    Camera,
    Defaults,
    DirectionalLight,
    KeyFrames,
    Light,
    Material,
    Mesh,
    Mobile,
    PointLight,
    Pose,
    Probe,
    Scene,
    SkyLight,
    SpotLight,
)

__all__ = [
    "Camera",
    "Defaults",
    "DirectionalLight",
    "KeyFrames",
    "Light",
    "Material",
    "Mesh",
    "Mobile",
    "PointLight",
    "Pose",
    "Probe",
    "Scene",
    "SceneError",
    "SkyLight",
    "SpotLight",
]
