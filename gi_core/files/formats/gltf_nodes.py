"""Nodes of glTF: transforms, copies, morph targets, lights (KHR_lights_punctual) and cameras, which look along -z."""

from __future__ import annotations

import math

import numpy as np

from gi_core.files.formats.gltf_buffers import Document
from gi_core.scene.types import Camera, DirectionalLight, PointLight, SpotLight


def local_matrix(node: dict) -> np.ndarray:
    """Return the transform (4, 4) of a node in its parent's space."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # stored by columns
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    length = np.sqrt(x * x + y * y + z * z + w * w) or 1.0
    x, y, z, w = x / length, y / length, z / length, w / length
    M = np.eye(4)
    M[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    M[:3, :3] *= np.array(node.get("scale", [1, 1, 1]), np.float64)
    M[:3, 3] = node.get("translation", [0, 0, 0])
    return M


def instances(document: Document, node: dict) -> list[np.ndarray]:
    """Return the transforms (4, 4) of a node's copies of its mesh, in the node's space."""
    copies = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
    if copies is None:
        return [np.eye(4)]
    values = {key.lower(): document.accessor(index) for key, index in copies["attributes"].items()}
    count = max(map(len, values.values()), default=0)
    rows = [{key: column[i] for key, column in values.items()} for i in range(count)]
    document.boundary.take(document.where, "nodes", len(rows))
    return [local_matrix(row) for row in rows]


def morphed(document: Document, primitive: dict, weights: list, p, n):
    """Return positions and normals moved by the targets of a primitive; None for normals that these do not move."""
    for weight, target in zip(weights, primitive.get("targets", []), strict=False):
        if weight and "POSITION" in target:
            p = p + weight * document.accessor(target["POSITION"])
            n = n + weight * document.accessor(target["NORMAL"]) if n is not None and "NORMAL" in target else None
    return p, n


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
    # 0.01 degrees: a cone of none has no light
    outer = min(max(math.degrees(cone.get("outerConeAngle", math.pi / 4)), 0.01), 90.0)
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
