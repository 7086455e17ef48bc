"""Names of the parts of a mobile, and of the materials that an edit gives them."""

from __future__ import annotations


def part_named(mobile: str, material: str) -> str:
    """Return the part of a mobile whose faces have a material."""
    return material.removeprefix(f"{mobile}: ")


def material_named(mobile: str, part: str) -> str:
    """Return the name of a material that a part has alone; without a part, the whole mobile."""
    return f"{mobile}: {part}" if part else mobile
