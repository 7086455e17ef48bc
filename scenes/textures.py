"""Images painted by arithmetic: wood, weave, rugs, pictures. At most 256 colours each: PNGs with a palette.

Noise comes from a hash of whole numbers and is tileable, so that floors repeat without seams.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import numpy as np


class Image(NamedTuple):
    """A picture as numbers into a palette of sRGB colours."""

    index: np.ndarray  # (h, w) uint8
    palette: np.ndarray  # (n, 3) uint8


def png(image: Image) -> bytes:
    """Return the image as an indexed PNG."""
    h, w = image.index.shape
    rows = np.concatenate([np.zeros((h, 1), np.uint8), image.index], axis=1)  # filter 0 before every row
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 3, 0, 0, 0)),
        (b"PLTE", np.ascontiguousarray(image.palette, np.uint8).tobytes()),
        (b"IDAT", zlib.compress(rows.tobytes(), 9)),
        (b"IEND", b""),
    ]
    data = b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + data


def srgb(text: str) -> np.ndarray:
    """Return colours (n, 3) in 0..255 of "c8a06e 4a3020": two hexadecimal digits a channel."""
    return np.array([[int(c[k : k + 2], 16) for k in (0, 2, 4)] for c in text.split()], float)


def ramp(colours: str, n: int) -> np.ndarray:
    """Return a palette (n, 3) uint8 that runs through colours, evenly."""
    c = srgb(colours)
    t = np.linspace(0, len(c) - 1, n)
    return np.round(np.stack([np.interp(t, np.arange(len(c)), c[:, k]) for k in range(3)], axis=1)).astype(np.uint8)


def noise(x: np.ndarray, y: np.ndarray, period: tuple[int, int], seed: int) -> np.ndarray:
    """Return smooth noise in 0..1 at coordinates, one bump a unit, repeating after `period` units."""
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    s, t = _eased(x - i), _eased(y - j)
    corner = [[_hash((i + a) % period[0], (j + b) % period[1], seed) for b in (0, 1)] for a in (0, 1)]
    low = corner[0][0] * (1 - t) + corner[0][1] * t
    high = corner[1][0] * (1 - t) + corner[1][1] * t
    return low * (1 - s) + high * s


def cloud(x, y, period: tuple[int, int], seed: int, octaves: int = 4) -> np.ndarray:
    """Return noise in 0..1 of several sizes, each half as large and half as strong as the last."""
    total, weight = 0.0, 0.0
    for k in range(octaves):
        n = 2**k
        total = total + noise(x * n, y * n, (period[0] * n, period[1] * n), seed + k) / n
        weight += 1 / n
    return total / weight


def pixels(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the middles of the pixels, x and y (h, w) in 0..1."""
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    return x, y


def shades(value: np.ndarray, colours: str, n: int = 64, dither: float = 0.5) -> Image:
    """Return values in 0..1 as an image in the shades of a ramp, steps broken up by a little noise."""
    h, w = value.shape
    grain = _hash(*np.meshgrid(np.arange(h), np.arange(w), indexing="ij"), 977) - 0.5
    index = np.clip(np.floor(value * (n - 1) + 0.5 + dither * grain), 0, n - 1)
    return Image(index.astype(np.uint8), ramp(colours, n))


def boards(width: int, height: int, across: int, colours: str, seed: int, stagger: bool = True) -> Image:
    """Return a floor of boards that run along x, `across` of them from top to bottom, with two butt joints each."""
    x, y = pixels(width, height)
    board = np.floor(y * across).astype(np.int64)
    inside = y * across - board
    shift = _hash(board, 3 * board, seed) if stagger else 0.0
    along = (x + shift) * 2
    plank = np.floor(along).astype(np.int64) % 2
    joint = along - np.floor(along)
    tone = _hash(board, plank, seed + 1)
    grain = cloud(x * 4, (y * across + 7 * plank) * 6, (4, 6 * across), seed + 2, 4)
    rings = noise(x * 2, (inside * 3 + 13 * board) % (3 * across), (2, 3 * across), seed + 7)
    figure = 0.5 + 0.5 * np.sin(2 * np.pi * (6 * rings + 1.5 * grain))
    value = 0.30 + 0.34 * tone + 0.24 * (grain - 0.5) + 0.14 * (figure - 0.5)
    gap = np.minimum(np.minimum(inside, 1 - inside) * height / across, np.minimum(joint, 1 - joint) * width / 2)
    return shades(np.clip(value, 0.03, 1) * np.where(gap < 0.8, 0.25, 1.0), colours)


def wood(width: int, height: int, colours: str, seed: int) -> Image:
    """Return wood whose grain runs along x, without joints."""
    x, y = pixels(width, height)
    bend = cloud(x, y * 3, (1, 3), seed, 2)
    grain = cloud(x * 3, y * 48, (3, 48), seed + 5, 3)
    figure = 0.5 + 0.5 * np.sin(2 * np.pi * (2 * bend + 6 * y))
    return shades(0.25 + 0.22 * figure + 0.5 * grain, colours, 48)


def weave(size: int, threads: int, colours: str, seed: int) -> Image:
    """Return cloth of warp and weft."""
    x, y = pixels(size, size)
    over = 0.5 + 0.5 * np.sin(2 * np.pi * threads * x) * np.sin(2 * np.pi * threads * y)
    slub = noise(x * 3, y * threads, (3, threads), seed) + noise(x * threads, y * 3, (threads, 3), seed + 1)
    return shades(0.15 + 0.35 * over + 0.25 * slub, colours, 32)


def plaster(size: int, colours: str, seed: int, octaves: int = 5) -> Image:
    """Return clouds: concrete, plaster, felt."""
    x, y = pixels(size, size)
    return shades(cloud(x * 4, y * 4, (4, 4), seed, octaves), colours, 48)


def swatches(colours: str) -> Image:
    """Return an image of plain colours side by side, eight pixels each; swatch() finds one."""
    c = srgb(colours)
    return Image(np.repeat(np.arange(len(c), dtype=np.uint8), 8)[None].repeat(8, axis=0), c.astype(np.uint8))


def swatch(k: int, count: int) -> tuple[float, float]:
    """Return where colour k of `count` lies in an image of swatches()."""
    return (k + 0.5) / count, 0.5


def _eased(t):
    return t * t * (3 - 2 * t)


def _hash(i, j, seed: int) -> np.ndarray:
    """Return numbers in [0, 1) that look random (multiply and xor, after Wang 2007)."""
    h = (np.asarray(i, np.int64) * 374761393 + np.asarray(j, np.int64) * 668265263 + seed * 974711) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 2246822519) & 0xFFFFFFFF
    return (h ^ (h >> 16)) / 2.0**32
