"""OpenEXR files: linear float32 layers with parameters, by the format's own library."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from app.cli.writable import replacing
from app.draw.layers import Layers
from gi_core.scene.errors import utf8


def write_exr(path: Path, layers: Layers, parameters: Mapping[str, object]) -> Path:
    """Write layers and one text attribute per parameter; return the full path. Raises OSError.

    R, G, B, A hold colour and coverage; `irradiance` and `albedo` are layers by their names.
    """
    named = {"": layers.colour, "irradiance.": layers.irradiance, "albedo.": layers.albedo}
    channels = {f"{name}{c}": layer[..., k].copy() for name, layer in named.items() for k, c in enumerate("RGB")}
    return write_channels(path, channels | {"A": layers.coverage[..., 0].copy()}, parameters)


def write_channels(path: Path, channels: Mapping[str, np.ndarray], parameters: Mapping[str, object]) -> Path:
    """Write channels (h, w) float32 by name and one text attribute per parameter; return the full path.

    The file appears whole or not at all. Raises OSError.
    """
    import OpenEXR

    path = path.resolve()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {f"gi-viewer {utf8(key)}": utf8(str(value)) for key, value in parameters.items()}
    try:
        with replacing(path) as part, OpenEXR.File(header, dict(channels)) as file:
            file.write(os.fspath(part))
    except RuntimeError as problem:  # of the library
        raise OSError(f"{path} cannot be written: {problem}") from None
    return path
