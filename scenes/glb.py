"""Writes GLB files for the generators: the least that holds triangles, normals, diffuse materials, textures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gi_core.files.formats.gltf_buffers import GlbWriter


class Part(NamedTuple):
    """Triangles of one material."""

    material: str
    vertices: np.ndarray  # (V, 3)
    faces: np.ndarray  # (F, 3)
    normals: np.ndarray | None = None  # (V, 3) unit
    uv: np.ndarray | None = None  # (V, 2), v downwards in the image


def material(
    name: str, reflectance, emission=(0.0, 0.0, 0.0), two_sided: bool = False, texture: int | None = None
) -> dict:
    """Return a glTF material; emission above 1 needs the strength extension. `texture` numbers the file's images."""
    strength = max(1.0, *emission)
    described = {
        "name": name,
        "doubleSided": two_sided,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*(float(c) for c in reflectance), 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        },
    }
    if texture is not None:
        described["pbrMetallicRoughness"]["baseColorTexture"] = {"index": texture}
    if any(emission):
        described["emissiveFactor"] = [float(e) / strength for e in emission]
        described["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": float(strength)}}
    return described


def glb_bytes(parts: list[Part], materials: list[dict], images: Sequence[bytes] = ()) -> bytes:
    """Return a GLB with one mesh, a primitive a part, float32 positions, and PNG images, each of them a texture."""
    index = {m["name"]: i for i, m in enumerate(materials)}
    file, primitives = GlbWriter(), []
    for part in parts:
        attributes = {"POSITION": file.accessor(part.vertices.astype("<f4"), bounds=True)}
        if part.normals is not None:
            attributes["NORMAL"] = file.accessor(part.normals.astype("<f4"))
        if part.uv is not None:
            attributes["TEXCOORD_0"] = file.accessor(part.uv.astype("<f4"))
        indices = file.accessor(part.faces.astype("<u4").reshape(-1))
        primitives.append({"attributes": attributes, "indices": indices, "material": index[part.material]})
    document = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
    }
    if images:
        document["textures"] = [{"source": file.image(image)} for image in images]
    if any("extensions" in m for m in materials):
        document["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    return file.bytes(document)


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Write files by name and say how large they are."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
        print(f"{folder / name}: {len(data):,} bytes")
