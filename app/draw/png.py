"""PNG files that carry the parameters that made them, as tEXt entries."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

KEYWORD = 79  # characters that the name of an entry may have


def write_png(path: str | os.PathLike, picture: np.ndarray, parameters: dict[str, object] | None = None) -> Path:
    """Write (h, w, 3) or (h, w, 4) uint8 with one text entry a parameter; return the full path.

    The file appears whole or not at all. Raises OSError where it cannot be written.
    """
    path = Path(path).resolve()
    info = PngInfo()
    for key, value in (parameters or {}).items():
        info.add_text(_latin(key)[:KEYWORD], _latin(value))
    data = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(data, "PNG", pnginfo=info)
    # Not a tempfile: those are readable by nobody else, and the picture would stay so.
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(data.getvalue())
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    return path


def read_parameters(path: str | os.PathLike) -> dict[str, str]:
    """Return the text entries of a PNG."""
    with Image.open(path) as image:
        return dict(image.text)


def _latin(value: object) -> str:
    """tEXt is Latin-1, names of entries too: anything else becomes an escape instead of an error."""
    return str(value).encode("latin-1", "backslashreplace").decode("latin-1")
