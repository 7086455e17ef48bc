"""Lights (KHR_lights_punctual) and cameras of glTF nodes; both look along their node's -z."""

from __future__ import annotations

import math

import numpy as np

from gi_core.scene.types import Camera, DirectionalLight, PointLight, SpotLight

NARROWEST = 0.01  # degrees: a cone of none has no light


def node_light(json: dict, node: dict, matrix: np.ndarray, number: int):
    """Return the light at a node, or None."""
    held = node.get("extensions", {}).get("KHR_lights_punctual")
    if held is None:
        return None
    light = json["extensions"]["KHR_lights_punctual"]["lights"][held["light"]]
    name = str(light.get("name") or f"light {number}")
    colour = np.array(light.get("color", [1, 1, 1]), np.float64).reshape(3) * light.get("intensity", 1.0)
    position = tuple(float(x) for x in matrix[:3, 3])
    direction = _forward(matrix)
    if light["type"] == "point":  # candela in every direction
        return PointLight(name, position, tuple(float(c) for c in 4 * math.pi * colour))
    intensity = tuple(float(c) for c in colour)
    if light["type"] == "directional":
        return DirectionalLight(name, direction, intensity)
    if light["type"] != "spot":
        raise ValueError(f"a light must be point, spot or directional, got {light['type']!r}")
    cone = light.get("spot", {})
    outer = min(max(math.degrees(cone.get("outerConeAngle", math.pi / 4)), NARROWEST), 90.0)
    inner = min(math.degrees(cone.get("innerConeAngle", 0.0)), outer)
    return SpotLight(name, position, direction, intensity, inner, outer)


def node_camera(json: dict, node: dict, matrix: np.ndarray) -> Camera | None:
    """Return the perspective camera at a node, or None; the target is one unit ahead."""
    if "camera" not in node:
        return None
    camera = json["cameras"][node["camera"]]
    if camera.get("type") != "perspective":
        return None
    position = matrix[:3, 3]
    target = position + np.array(_forward(matrix))
    fov = math.degrees(camera["perspective"]["yfov"])
    if not 0 < fov < 180:
        raise ValueError(f"yfov of a camera must be > 0 and < pi, got {camera['perspective']['yfov']}")
    return Camera(tuple(map(float, position)), tuple(map(float, target)), fov)


def _forward(matrix: np.ndarray) -> tuple[float, float, float]:
    d = -matrix[:3, 2]
    size = float(np.sqrt((d * d).sum()))
    return tuple(float(x) for x in d / size) if size > 0 else (0.0, 0.0, -1.0)  # a node of no size has no direction
