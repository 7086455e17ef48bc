"""Images: valid ones of each format, and damaged ones."""

import functools
import io
import struct
import zlib

import numpy as np
from PIL import Image

from tests.support.grammar.choices import Grammar


def _png_header(width: int, height: int) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = zlib.compress(bytes(1000))
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
        + chunk(b"IDAT", rows)
        + chunk(b"IEND", b"")
    )


@functools.cache
def images() -> tuple[list[bytes], list[bytes]]:
    """Images that every viewer reads, and files that are none or not quite."""
    rng = np.random.default_rng(0)
    good, odd = [], []
    for mode, kinds in {
        "RGB": ("PNG", "JPEG"),
        "RGBA": ("PNG",),
        "L": ("PNG", "JPEG"),
        "LA": ("PNG",),
        "P": ("PNG",),
    }.items():
        for kind in kinds:
            for size in ((4, 4), (1, 1), (7, 3)):
                picture = Image.fromarray(rng.integers(0, 256, (size[1], size[0], 4), dtype=np.uint8), "RGBA").convert(
                    mode
                )
                picture.save(stream := io.BytesIO(), kind)
                good.append(stream.getvalue())  # fmt: skip
    colour = Image.fromarray(rng.integers(0, 256, (8, 8, 3), dtype=np.uint8))
    forms = [
        ("1", "PNG"), ("I;16", "PNG"), ("CMYK", "JPEG"), ("RGB", "BMP"), ("RGB", "TIFF"), ("RGB", "TGA"),
        ("RGB", "PPM"),
    ]  # fmt: skip
    for mode, kind in [*forms, ("P", "GIF"), ("RGB", "WEBP"), ("RGB", "EPS"), ("RGB", "ICO"), ("RGB", "PCX")]:
        (colour.convert("L") if mode == "I;16" else colour).convert(mode).save(stream := io.BytesIO(), kind)
        odd.append(stream.getvalue())
    odd += [
        b"",
        b"\x89PNG\r\n\x1a\n",
        good[0][:40],
        good[3][: len(good[3]) // 2],
        b"%PDF-1.4\n%%EOF\n",
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\nshowpage\n",
    ]
    odd += [
        _png_header(20000, 20000),
        _png_header(2**31 - 1, 1),
        _png_header(0, 4),
        _png_header(70000, 4),
        b"<svg/>",
        b"#?RADIANCE\n\n-Y 4 +X 4\n",
    ]
    odd += [
        b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80),
        b"DDS " + bytes(124),
        b"P6 9999999 9999999 255\n",
        b"newmtl a\nKd 1 1 1\n",
    ]
    return good, odd


def image(g: Grammar) -> bytes:
    good, odd = images()
    return g.pick(*odd) if g.chance(g.oddity * 3) else g.pick(*good)
