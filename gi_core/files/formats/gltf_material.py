"""The values of materials in glTF, checked before they are used: types by sentences, ranges by limits and notes."""

from __future__ import annotations

from typing import Any, NamedTuple

from gi_core.files.formats.file_parts import listed
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.rules import BIGGEST, is_number

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
