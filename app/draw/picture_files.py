"""Files of pictures: PNG with parameters as tEXt entries, of the window too; OpenEXR layers, films.

OpenEXR is written by the library of that name, films by PyAV, picture by picture.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Mapping
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from app.cli.writable import replacing, write_whole
from app.draw.legend import Legend, Marks, with_legend, with_marks
from app.draw.renderer import Look, Renderer
from app.draw.shot import Layers
from gi_core.scene.errors import utf8

if TYPE_CHECKING:  # heavy, and PNG needs no layers
    from av import VideoFrame


def write_png(path: str | os.PathLike, picture: np.ndarray, parameters: Mapping[str, object] | None = None) -> Path:
    """Write (h, w, 3) or (h, w, 4) uint8 with one text entry per parameter; return the full path.

    The file appears whole or not at all. Raises OSError.
    """
    path = Path(path).resolve()
    write_whole(path, png(picture, parameters))
    return path


def png(picture: np.ndarray, parameters: Mapping[str, object] | None = None) -> bytes:
    """Return a picture as the bytes of a PNG file, as write_png()."""
    info = PngInfo()
    for key, value in (parameters or {}).items():
        info.add_text(_latin(key)[:79], _latin(value))  # characters: the limit of the PNG standard
    data = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(data, "PNG", pnginfo=info)
    return data.getvalue()


def _latin(value: object) -> str:
    """Return text in Latin-1, as tEXt requires, with escapes for other characters."""
    return str(value).encode("latin-1", "backslashreplace").decode("latin-1")


def write_exr(path: Path, layers: Layers, parameters: Mapping[str, object]) -> Path:
    """Write layers and one text attribute per parameter; return the full path. Raises OSError.

    R, G, B, A hold colour and coverage; `irradiance`, `albedo` and `variance` are layers by their names.
    """
    named = {"": layers.colour, "irradiance.": layers.irradiance, "albedo.": layers.albedo}
    if layers.variance is not None:
        named["variance."] = layers.variance
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


CODECS = {  # encoder of PyAV, pixels that it takes, its options; crf: hardly visible losses
    ".mp4": ("libx264", "yuv420p", {"crf": "18"}),
    ".gif": ("gif", "pal8", {}),
    ".webp": ("libwebp", "yuv420p", {"quality": "90"}),
}


def write_video(path: Path, pictures: Iterable[np.ndarray], rate: int) -> Path:
    """Write pictures (h, w, 3) uint8 as they come, `rate` per second; return the full path.

    MP4 has an even width and height: an odd last column or row is repeated. GIF rounds times to 1/100 s. The file
    appears whole or not at all. Raises OSError.
    """
    import av

    path, suffix = path.resolve(), path.suffix.lower()
    codec, pixels, options = CODECS[suffix]
    endless = {} if suffix == ".mp4" else {"loop": "0"}
    with replacing(path) as part, av.open(os.fspath(part), "w", suffix[1:], options=endless) as file:
        stream: Any = file.add_stream(codec, rate=rate, options=options)
        stream.pix_fmt = pixels
        for k, picture in enumerate(pictures):
            if suffix == ".mp4":
                picture = np.pad(picture, [(0, picture.shape[0] % 2), (0, picture.shape[1] % 2), (0, 0)], "edge")
            if k == 0:
                stream.height, stream.width = picture.shape[:2]
            frame = _with_palette(picture) if suffix == ".gif" else av.VideoFrame.from_ndarray(picture, "rgb24")
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return path


def _with_palette(picture: np.ndarray) -> VideoFrame:
    """Return a picture in 256 colours of its own."""
    import av

    image, palette = Image.fromarray(picture).quantize(), np.full((256, 4), 255, np.uint8)
    colours = np.array(image.getpalette(), np.uint8).reshape(-1, 3)
    palette[: len(colours), 1:] = colours  # alpha, red, green, blue
    return av.VideoFrame.from_ndarray((np.asarray(image), palette), "pal8")  # type: ignore[arg-type]


def next_free(folder: Path) -> Path:
    """Return the first of gi-viewer-001.png, -002.png, ... that does not exist."""
    return next(path for n in count(1) if not (path := folder / f"gi-viewer-{n:03d}.png").exists())


def screenshot(
    renderer: Renderer, look: Look, legend: Legend | None, scale: int = 1, marks: Marks | None = None, pixels=1.0
) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 at `scale` times the viewport's size, with its legend and marks.

    pixels: of the viewport per point of the marks.

    A picture of 4 times the size has two samples, not eight, so that it fits into memory.
    """
    (width, height), samples = renderer.size, renderer.samples_now
    renderer.resize(scale * width, scale * height, 8 // scale)
    try:
        renderer.draw(look)
        picture = renderer.pixels()
    finally:
        renderer.resize(width, height, samples)
    picture = picture if marks is None else with_marks(picture, marks, scale * pixels)
    return picture if legend is None else with_legend(picture, legend)
