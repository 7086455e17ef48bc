"""Records that every mesh-file reader returns: parts in world space, materials, lights if the format has any."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.scene.types import Camera, Finish, Light, Material, Texture

CHANNELS = (1,), (2,), (0, 1, 2), (0, 1, 2)  # of the textures of Finish that count: eight in all


def listed(names: list[str]) -> str:
    """Return the first few names in words."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


class Placed(NamedTuple):
    """A texture on the faces of a part."""

    texture: np.ndarray  # (F,) int64 into FileParts.finishes, -1: none
    uv: np.ndarray  # (F, 3, 2) as Part.corner_uv


class Part(NamedTuple):
    """Triangles of one material (or several: `material` is per face)."""

    vertices: np.ndarray  # (V, 3) float64, world space of the file
    faces: np.ndarray  # (F, 3) int64 into vertices
    material: np.ndarray  # (F,) int64 into FileParts.materials
    corner_normals: np.ndarray | None = None  # (F, 3, 3) float64 any length, as in the file
    corner_colour: np.ndarray | None = None  # (F, 3, 3) linear; None: that of the material, white under a texture
    face_texture: np.ndarray | None = None  # (F,) int64 into FileParts.textures, -1: none
    corner_uv: np.ndarray | None = None  # (F, 3, 2), v downwards; as good as zero where there is no texture
    finish: tuple[Placed | None, ...] = (None,) * len(Finish._fields)  # textures of gloss, in the order of Finish


class FileParts(NamedTuple):
    """A mesh file as read, before any cleaning."""

    parts: list[Part]
    materials: list[Material]
    lights: list[Light]
    camera: Camera | None
    up: str  # "y" or "z", the format's custom
    notes: list[str]
    textures: tuple[Texture, ...] = ()
    finishes: tuple[Texture, ...] = ()
