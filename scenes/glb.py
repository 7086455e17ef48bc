"""Writes GLB files for the generators: the least that holds triangles, normals, diffuse materials, textures."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

FLOAT, UNSIGNED = 5126, 5125


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
    binary, views, accessors, primitives = b"", [], [], []

    def store(array, component, kind, **extra) -> int:
        nonlocal binary
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": array.nbytes})
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": kind, **extra}
        )
        binary += array.tobytes()
        return len(accessors) - 1

    for part in parts:
        p = np.ascontiguousarray(part.vertices, "<f4")
        bounds = {"min": [float(x) for x in p.min(axis=0)], "max": [float(x) for x in p.max(axis=0)]}
        attributes = {"POSITION": store(p, FLOAT, "VEC3", **bounds)}
        if part.normals is not None:
            attributes["NORMAL"] = store(np.ascontiguousarray(part.normals, "<f4"), FLOAT, "VEC3")
        if part.uv is not None:
            attributes["TEXCOORD_0"] = store(np.ascontiguousarray(part.uv, "<f4"), FLOAT, "VEC2")
        indices = store(np.ascontiguousarray(part.faces, "<u4").reshape(-1), UNSIGNED, "SCALAR")
        primitives.append({"attributes": attributes, "indices": indices, "material": index[part.material]})
    image_views = []
    for image in images:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(image)})
        image_views.append(len(views) - 1)
        binary += image + bytes(-len(image) % 4)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    if images:
        document["images"] = [{"bufferView": v, "mimeType": "image/png"} for v in image_views]
        document["textures"] = [{"source": i} for i in range(len(images))]
    if any("extensions" in m for m in materials):
        document["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    head = struct.pack("<4sII", b"glTF", 2, total) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Write files by name and say how large they are."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
        print(f"{folder / name}: {len(data):,} bytes")
