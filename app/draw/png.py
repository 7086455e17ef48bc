"""PNG files with parameters as tEXt entries."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from app.cli.writable import write_whole

KEYWORD_CHARACTERS = 79  # limit of the PNG standard


def write_png(path: str | os.PathLike, picture: np.ndarray, parameters: Mapping[str, object] | None = None) -> Path:
    """Write (h, w, 3) or (h, w, 4) uint8 with one text entry per parameter; return the full path.

    The file appears whole or not at all. Raises OSError.
    """
    path = Path(path).resolve()
    info = PngInfo()
    for key, value in (parameters or {}).items():
        info.add_text(_latin(key)[:KEYWORD_CHARACTERS], _latin(value))
    data = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(data, "PNG", pnginfo=info)
    write_whole(path, data.getvalue())
    return path


def _latin(value: object) -> str:
    """Return text in Latin-1, as tEXt requires, with escapes for other characters."""
    return str(value).encode("latin-1", "backslashreplace").decode("latin-1")
