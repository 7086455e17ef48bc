"""GLB files: arrays and images in one binary chunk, described by a JSON chunk (glTF 2.0, section 4).

trimesh 5.2 rounds colours to 8 bit and pygltflib leaves chunks to its callers.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from gi_core.files.formats.gltf_buffers import COMPONENT, WIDTH

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
