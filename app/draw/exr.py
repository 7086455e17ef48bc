"""OpenEXR files: linear float32 layers with parameters, by the format's own library."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from app.draw.layers import Layers


def write_exr(path: Path, layers: Layers, parameters: Mapping[str, object]) -> Path:
    """Write layers and one text attribute per parameter; return the full path.

    R, G, B, A hold colour and coverage; `irradiance` and `albedo` are layers by their names. The file appears whole or
    not at all. Raises OSError.
    """
    import OpenEXR

    path = path.resolve()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {f"gi-viewer {key}": str(value) for key, value in parameters.items()}
    named = {"": layers.colour, "irradiance.": layers.irradiance, "albedo.": layers.albedo}
    channels = {f"{name}{c}": layer[..., k].copy() for name, layer in named.items() for k, c in enumerate("RGB")}
    channels["A"] = layers.coverage[..., 0].copy()
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with OpenEXR.File(header, channels) as file:
            file.write(os.fspath(part))
        os.replace(part, path)
    except BaseException as problem:
        part.unlink(missing_ok=True)
        if isinstance(problem, RuntimeError):  # of the library
            raise OSError(f"{path} cannot be written: {problem}") from None
        raise
    return path
