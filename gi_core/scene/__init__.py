"""Scenes: the types, and the files they come from.

The loaders are imported at their first use: they need more of `gi_core` than the types do, which the
rest of `gi_core` imports from here.
"""

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
    "PointLight",
    "Pose",
    "Probe",
    "Scene",
    "SceneError",
    "SkyLight",
    "SpotLight",
    "Texture",
    "find_scene",
    "load_scene",
    "shipped_scenes",
]


def __getattr__(name: str):
    if name == "load_scene":
        from gi_core.scene.load import load_scene

        return load_scene
    if name in ("find_scene", "shipped_scenes"):
        from gi_core.scene import find

        return getattr(find, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
