"""The bytes of a glTF, read and written: container, buffers, accessors (glTF 2.0, section 4).

Own code, as trimesh 5.2 rounds colours to 8 bit and pygltflib leaves chunks to its callers.
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.texture_images import ImageError, find
from gi_core.scene.errors import SceneError, shown

COMPONENT = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
COMPRESSED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}
READ = {
    "EXT_mesh_gpu_instancing", "EXT_texture_webp", "KHR_lights_punctual", "KHR_materials_emissive_strength",
    "KHR_materials_ior", "KHR_materials_pbrSpecularGlossiness", "KHR_materials_specular", "KHR_materials_transmission",
    "KHR_materials_unlit", "KHR_materials_volume", "KHR_mesh_quantization", "KHR_node_visibility",
    "KHR_texture_transform",
}  # fmt: skip
LEFT_OUT = {  # with a note: the rest of the file means the same without
    "EXT_lights_ies": "photometric files of lights",
    "EXT_lights_image_based": "light from images",
    "EXT_texture_avif": "textures in AVIF",
    "KHR_animation_pointer": "animations",
    "KHR_materials_anisotropy": "anisotropic gloss",
    "KHR_materials_clearcoat": "clear coats",
    "KHR_materials_diffuse_transmission": "light through thin surfaces",
    "KHR_materials_dispersion": "dispersion",
    "KHR_materials_iridescence": "iridescence",
    "KHR_materials_sheen": "sheen",
    "KHR_materials_variants": "variants of materials but the first",
    "KHR_texture_basisu": "textures in KTX2",
    "MSFT_texture_dds": "textures in DDS",
}
SILENT = {"KHR_xmp", "KHR_xmp_json_ld"}  # about the file, not its picture


class Document:
    """A glTF as JSON and bytes; `notes` lists omitted parts."""

    def __init__(self, path: Path, data: bytes, where: str, boundary: Boundary):
        self.path, self.where, self.boundary, self.notes = path, where, boundary, []
        self.binary = b""
        text = self._chunks(data) if data[:4] == b"glTF" else data
        boundary.take(where, "values in JSON", sum(map(text.count, (b",", b"[", b"{"))))
        try:
            self.json = json.loads(text)
        except ValueError as error:
            readable = isinstance(error, json.JSONDecodeError) and path.suffix.lower() == ".gltf"
            place = f" in line {error.lineno}" if readable else ""
            raise SceneError(
                f"{where}: a .gltf or .glb file must hold glTF JSON, which this does not{place}; export it again"
            ) from None
        if not isinstance(self.json, dict) or not str(self.json.get("asset", {}).get("version", "")).startswith("2"):
            raise SceneError(f'{where}: glTF must be of version 2, with asset.version "2.0"; export it again')
        self._check_extensions()
        self._buffers = {}

    def _check_extensions(self) -> None:
        """Raise SceneError for a version or extensions without which the file cannot be read; note those left out."""
        least = str(self.json["asset"].get("minVersion", "2.0"))
        if least not in ("2", "2.0"):
            raise SceneError(
                f"{self.where}: glTF must be of version 2.0, got minVersion {shown(least)}; export it again"
            )
        required = set(self.json.get("extensionsRequired", []))
        used = required | set(self.json.get("extensionsUsed", []))
        if compressed := ", ".join(sorted(used & COMPRESSED)):
            raise SceneError(
                f"{self.where}: compressed meshes are not read, got {compressed}; export it without compression"
            )
        if unknown := ", ".join(map(shown, sorted(required - READ - LEFT_OUT.keys() - SILENT))):
            raise SceneError(
                f"{self.where}: the file requires the extension {unknown}, not read here; export it without"
            )
        left = sorted(used - READ - SILENT)
        words = [LEFT_OUT.get(name, name) for name in left]
        if words:
            self.notes.append(f"left out: {', '.join(words)}")

    def accessor(self, index: int) -> np.ndarray:
        """Return an accessor's values (count, width): float64 where stored as float or normalised, else int64."""
        a = self.json["accessors"][index]
        dtype, width, count = np.dtype(COMPONENT[a["componentType"]]), WIDTH[a["type"]], a["count"]
        if "bufferView" not in a:
            self.boundary.take(self.where, "elements without data", max(count, 0))
        self.boundary.take(self.where, "numbers", width * max(count, 0))
        if "bufferView" in a:
            values = self._strided(a["bufferView"], a.get("byteOffset", 0), dtype, width, count)
        else:
            values = np.zeros((count, width), dtype)
        if "sparse" in a:
            s = a["sparse"]
            at = s["indices"]
            itype = np.dtype(COMPONENT[at["componentType"]])
            rows = self._strided(at["bufferView"], at.get("byteOffset", 0), itype, 1, s["count"])[:, 0]
            values = values.copy()
            v = s["values"]
            values[rows] = self._strided(v["bufferView"], v.get("byteOffset", 0), dtype, width, s["count"])
        if dtype.kind == "f":
            return values.astype(np.float64)
        if a.get("normalized"):
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values.astype(np.int64)

    def image(self, index: int) -> bytes:
        """Return the encoded bytes of an image. Raises ImageError, SceneError."""
        image = self.json["images"][index]
        if "bufferView" in image:
            return bytes(self._view(image["bufferView"])[0])
        uri = image.get("uri", "")
        if uri.startswith("data:"):
            try:
                return self._uri(uri)
            except ValueError:
                raise ImageError("is not a readable image") from None
        folder = self.path.parent
        return self.boundary.read(find([folder], self.boundary, unquote(uri)), unquote(uri))

    def image_name(self, index: int) -> str:
        """Return the name of an image in notes."""
        image = self.json["images"][index]
        uri = image.get("uri", "data:")
        if not uri.startswith("data:"):
            return unquote(uri)
        return f"image {index}" + (f' "{image["name"]}"' if image.get("name") else "")

    def no_image(self) -> bytes:
        raise ImageError("names no image")

    def _strided(self, view: int, offset: int, dtype, width: int, count: int) -> np.ndarray:
        data, stride = self._view(view)
        size = dtype.itemsize * width
        stride = stride or size
        if stride < size:
            raise SceneError(
                f"{self.where}: byteStride must be at least {size}, an element, got {stride}; export it again"
            )
        if count and offset + stride * (count - 1) + size > len(data):
            raise SceneError(f"{self.where}: an accessor runs past the end of its {len(data)} bytes; export it again")
        return (
            np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize)) if count else np.zeros((0, width))
        )

    def _view(self, index: int):
        view = self.json["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self._buffer(view["buffer"])[start : start + view["byteLength"]], view.get("byteStride", 0)

    def _buffer(self, index: int):
        if index not in self._buffers:
            uri = self.json["buffers"][index].get("uri")
            self._buffers[index] = memoryview(self.binary if uri is None else self._uri(uri))
        return self._buffers[index]

    def _uri(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return self.boundary.read(self.path.parent / unquote(uri), f"{self.where}: its buffer {uri}")

    def _chunks(self, data: bytes) -> bytes:
        text, at = b"", 12
        while at + 8 <= len(data):
            length, kind = struct.unpack_from("<II", data, at)
            chunk = data[at + 8 : at + 8 + length]
            if len(chunk) < length:
                raise SceneError(f"{self.where}: the file ends early, {length - len(chunk)} bytes are missing")
            if kind == 0x4E4F534A:  # "JSON"
                text = chunk
            elif kind == 0x004E4942:  # "BIN"
                self.binary = chunk
            at += 8 + length
        return text


CODES = {np.dtype(form): code for code, form in COMPONENT.items()}
KINDS = {width: name for name, width in WIDTH.items() if not name.startswith("MAT")}


class GlbWriter:
    """Collects the binary chunk; `bytes()` joins it with a document that names its accessors and images by number."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._views: list[dict] = []
        self._accessors: list[dict] = []
        self._images: list[dict] = []

    def accessor(self, array: np.ndarray, bounds: bool = False) -> int:
        """Store an array (n,) or (n, 2 .. 4) of a glTF type; return its number. bounds: with minimum and maximum."""
        rows = array.reshape(len(array), -1)
        described: dict[str, Any] = {
            "bufferView": self._view(np.ascontiguousarray(rows).tobytes()),
            "componentType": CODES[array.dtype],
            "count": len(rows),
            "type": KINDS[rows.shape[1]],
        }
        if bounds:
            described |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self._accessors.append(described)
        return len(self._accessors) - 1

    def image(self, png: bytes) -> int:
        """Store a PNG file; return its number."""
        self._images.append({"bufferView": self._view(png), "mimeType": "image/png"})
        return len(self._images) - 1

    def bytes(self, document: dict) -> bytes:
        """Return the file; `document` has all but accessors, views, buffers and images."""
        stored = {
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._binary)}],
        }
        stored |= {"images": self._images} if self._images else {}
        text = json.dumps({"asset": {"version": "2.0"}} | document | stored, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(self._binary))
        head += struct.pack("<I4s", len(text), b"JSON") + text
        return head + struct.pack("<I4s", len(self._binary), b"BIN\0") + bytes(self._binary)

    def _view(self, data: bytes) -> int:
        self._views.append({"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)})
        self._binary += data + bytes(-len(data) % 4)
        return len(self._views) - 1
