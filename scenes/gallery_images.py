"""The painted images of the gallery: concrete, oak, three pictures, the stone's two colours."""

from __future__ import annotations

import numpy as np

from scenes.textures import Image, cloud, noise, pixels, plaster, ramp, shades, srgb, wood


def concrete() -> Image:
    return plaster(320, "b4b0a9 c6c2bb d3cfc8", 11)


def oak() -> Image:
    return wood(256, 128, "946f48 bd9566 d8b588", 12)


def stone() -> Image:
    """Return lacquer outside (left), bare plaster within (right), a soft edge between them."""
    x, _ = pixels(256, 4)
    edge = np.clip((x - 0.485) / 0.03, 0, 1)
    return shades(edge * edge * (3 - 2 * edge), "c43a1d f0e9dc", 64, dither=0)


def fields() -> Image:
    """Return two floating fields of colour on a warm ground."""
    w, h = 288, 352
    x, y = pixels(w, h)
    mist = 0.055 * (cloud(x * 6, y * 6, (6, 6), 21) - 0.5)
    brush = cloud(x * 3, y * 30, (3, 30), 22, 3)
    edge_x = np.minimum(x, 1 - x) - 0.09 + mist
    upper = np.minimum(edge_x, np.minimum(y - 0.07, 0.55 - y) + mist)
    lower = np.minimum(edge_x, np.minimum(y - 0.62, 0.93 - y) + mist)
    tones = [ramp(c, 48) for c in ("8e3a22 b3542c", "cf8a1f e9b146", "6a1f2b 96323a")]
    index = np.clip(np.floor(brush * 48), 0, 47)
    soft = 0.03 * (noise(x * w, y * h, (w, h), 23) - 0.5)
    index = np.where(upper + soft > 0, index + 48, np.where(lower + soft > 0, index + 96, index))
    return Image(index.astype(np.uint8), np.concatenate(tones))


def circles() -> Image:
    """Return discs and bars over one another, each crossing in a colour of its own."""
    w, h = 448, 320
    x, y = pixels(w, h)
    x = x * w / h
    shapes = [np.hypot(x - cx, y - cy) < r for cx, cy, r in DISCS]
    shapes += [np.abs((x - 0.1) * 0.55 - (y - 0.12)) < 0.045, np.abs(x - 1.12) < 0.05]
    colours = srgb("ece4d3 1f5d73 d9a11f c8452b 26384a 7aa59b")
    mixed = np.ones((h, w, 3)) * colours[0] / 255
    for inside, colour in zip(shapes, colours[1:] / 255, strict=True):
        mixed = np.where(inside[..., None], mixed * (0.12 + 0.88 * colour), mixed)
    flat, index = np.unique(np.round(mixed * 255).astype(int).reshape(-1, 3), axis=0, return_inverse=True)
    return Image(index.reshape(h, w).astype(np.uint8), flat.astype(np.uint8))


DISCS = ((0.46, 0.52, 0.30), (0.86, 0.40, 0.24), (0.98, 0.70, 0.17))


def waves() -> Image:
    """Return bands of blue that rise and fall."""
    w, h = 288, 352
    x, y = pixels(w, h)
    swell = 0.05 * np.sin(2 * np.pi * (1.1 * x + 0.7 * y)) + 0.03 * np.sin(2 * np.pi * (2.3 * x - 0.4))
    band = 11 * (y + swell * (0.4 + y))
    k = np.clip(np.floor(band), 0, 11).astype(int)
    inside = band - np.floor(band)
    tone = np.clip(0.25 + 0.5 * inside + 0.35 * (cloud(x * 4, y * 24, (4, 24), 25) - 0.5), 0, 0.999)
    base = [ramp(c, 16) for c in BLUES]
    return Image((16 * k + np.floor(16 * tone)).astype(np.uint8), np.concatenate(base))


BLUES = (
    "e9e4d4 f4f0e4", "b9d3d3 d8e5e0", "7fb0bb a9cbcf", "4f8ca3 7fb0bb", "c9d8c8 e4eadb", "2f6d8d 5a95ad",
    "1d4f74 3a7798", "8fbcb4 b9d7cc", "163c5e 2b5c80", "0f2b48 214a6c", "d9b36a ecd199", "0b1f36 1a3c5a",
)  # fmt: skip
