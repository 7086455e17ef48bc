"""Pictures in a row as one file: MP4 by PyAV (H.264), GIF and WebP by Pillow."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image

from app.cli.writable import replacing

PILLOW = {".gif": "GIF", ".webp": "WEBP"}
SUFFIXES = (".mp4", *PILLOW)
QUALITY = 18  # of H.264, constant rate factor: hardly visible losses


def write_video(path: Path, pictures: Iterable[np.ndarray], rate: int) -> Path:
    """Write pictures (h, w, 3) uint8 as they come, `rate` per second; return the full path.

    MP4 has an even width and height: an odd last column or row is repeated. GIF rounds times to 1/100 s. The file
    appears whole or not at all. Raises OSError.
    """
    path = path.resolve()
    with replacing(path) as part:
        if path.suffix.lower() == ".mp4":
            _write_mp4(part, pictures, rate)
        else:
            _write_pillow(part, pictures, rate, PILLOW[path.suffix.lower()])
    return path


def _write_mp4(path: Path, pictures: Iterable[np.ndarray], rate: int) -> None:
    import av

    with av.open(os.fspath(path), "w", format="mp4") as file:
        stream = file.add_stream("libx264", rate=rate, options={"crf": str(QUALITY)})
        stream.pix_fmt = "yuv420p"
        for k, picture in enumerate(pictures):
            even = np.pad(picture, [(0, picture.shape[0] % 2), (0, picture.shape[1] % 2), (0, 0)], "edge")
            if k == 0:
                stream.height, stream.width = even.shape[:2]
            file.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
        file.mux(stream.encode(None))


def _write_pillow(path: Path, pictures: Iterable[np.ndarray], rate: int, form: str) -> None:
    first, *others = (Image.fromarray(p) for p in pictures)
    options = {"quality": 90, "method": 4} if form == "WEBP" else {}
    first.save(path, form, save_all=True, append_images=others, duration=round(1000 / rate), loop=0, **options)
