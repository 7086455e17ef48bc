"""Records of a scene: meshes, materials, lights, mobiles, poses. They import nothing of the other packages."""

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
    Paint,
    PhotometricLight,
    PointLight,
    Pose,
    Probe,
    Scene,
    SkyLight,
    SpotLight,
    Texture,
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
    "Paint",
    "PhotometricLight",
    "PointLight",
    "Pose",
    "Probe",
    "Scene",
    "SceneError",
    "SkyLight",
    "SpotLight",
    "Texture",
]
