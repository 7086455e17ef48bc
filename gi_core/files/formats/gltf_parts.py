"""Nodes of glTF: transforms, copies, morph targets, lights (KHR_lights_punctual) and cameras, which look along -z.

The values of materials are checked before they are used: types by sentences, ranges by limits and notes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gi_core.files.formats.file_parts import listed
from gi_core.files.formats.gltf_buffers import Document
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.pose import rotation
from gi_core.scene.rules import BIGGEST, is_number
from gi_core.scene.types import Camera, DirectionalLight, PointLight, Pose, SpotLight


def local_matrix(node: dict) -> np.ndarray:
    """Return the transform (4, 4) of a node in its parent's space."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # stored by columns
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    length = np.sqrt(x * x + y * y + z * z + w * w) or 1.0
    M = np.eye(4)
    M[:3, :3] = rotation(Pose(quaternion=(w / length, x / length, y / length, z / length)))
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


WORDS = {2: "two", 3: "three", 4: "four"}


class Range(NamedTuple):
    """A rule: a number from `low` to `high`, or `count` of them."""

    low: float = -BIGGEST
    high: float = BIGGEST
    count: int | None = None
    zero: bool = False  # or 0

    @property
    def text(self) -> str:
        """The rule in words."""
        what = "a number" if self.count is None else f"{WORDS[self.count]} numbers"
        return f"{what} from {self.low:g} to {self.high:g}" + " or 0" * self.zero

    def holds(self, value) -> bool:
        """Return whether a value has the type, whatever its range."""
        if self.count is None:
            return is_number(value)
        return isinstance(value, list) and len(value) == self.count and all(map(is_number, value))

    def limited(self, value):
        """Return a value of the type in the range."""
        if isinstance(value, list):
            return [min(max(v, self.low), self.high) for v in value]
        return value if self.zero and value == 0 else min(max(value, self.low), self.high)


Rules = dict[str, "Range | Rules"]

SHARE = Range(0, 1)
TRANSFORM: Rules = {"offset": Range(count=2), "rotation": Range(), "scale": Range(count=2)}
TEXTURE: Rules = {"extensions": {"KHR_texture_transform": TRANSFORM}}
RULES: Rules = {
    "pbrMetallicRoughness": {
        "baseColorFactor": Range(0, 1, 4),
        "metallicFactor": SHARE,
        "roughnessFactor": SHARE,
        "baseColorTexture": TEXTURE,
        "metallicRoughnessTexture": TEXTURE,
    },
    "emissiveFactor": Range(0, count=3),
    "emissiveTexture": TEXTURE,
    "alphaCutoff": Range(0),
    "extensions": {
        "KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": Range(0, 1, 4),
            "specularFactor": Range(0, 1, 3),
            "glossinessFactor": SHARE,
            "diffuseTexture": TEXTURE,
            "specularGlossinessTexture": TEXTURE,
        },
        "KHR_materials_emissive_strength": {"emissiveStrength": Range(0)},
        "KHR_materials_ior": {"ior": Range(1, zero=True)},
        "KHR_materials_specular": {
            "specularFactor": SHARE,
            "specularColorFactor": Range(0, count=3),
            "specularTexture": TEXTURE,
            "specularColorTexture": TEXTURE,
        },
    },
}


def checked_materials(materials, where: str, notes: list[str]) -> list[dict[str, Any]]:
    """Return the materials of a glTF with valid values; those beyond their range are limited, with one note per key.

    Raises SceneError for a value of another type: material, key, rule, value found.
    """
    if not (isinstance(materials, list) and all(isinstance(m, dict) for m in materials)):
        raise SceneError(f"{where}: materials must be a list of objects, got {shown(materials)}; export it again")
    limited: dict[str, list[str]] = {}
    result = []
    for i, m in enumerate(materials):
        name = name_of(i, m)
        beyond: list[str] = []
        result.append(_checked(m, RULES, f'{where}: material "{name}": ', beyond))
        for rule in beyond:
            limited.setdefault(rule, []).append(name)
    for rule, names in limited.items():
        notes.append(f"{rule}: limited in {listed(names)}")
    return result


def name_of(i: int, material: dict) -> str:
    """Return the name of material i."""
    return str(material.get("name") or f"material {i}")


def _checked(values, rules: Rules, where: str, beyond: list[str]) -> dict[str, Any]:
    out = dict(values)
    for key, rule in rules.items():
        if key not in values:
            continue
        value = values[key]
        if isinstance(rule, dict):
            if not isinstance(value, dict):
                raise SceneError(f"{where}{key} must be an object, got {shown(value)}; export it again")
            out[key] = _checked(value, rule, where, beyond)
            continue
        if not rule.holds(value):
            raise SceneError(f"{where}{key} must be {rule.text}, got {shown(value)}; correct it, or export it again")
        out[key] = rule.limited(value)
        if out[key] != value:
            beyond.append(f"{key} must be {rule.text}")
    return out
