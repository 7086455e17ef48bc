"""The painted images of the office: carpet, ceiling tiles, wood, cloth, monitor, whiteboard, doors, binders."""

from __future__ import annotations

import numpy as np

from scenes.textures import Image, cloud, noise, pixels, ramp, shades, srgb, swatches, weave, wood

BINDERS = "2d5d62 d9a441 e4e1d8 39434d b65a3a 7f9a8e cfc6b4 1f3a44"
BINDER_COUNT = len(BINDERS.split())


def carpet() -> Image:
    """Return four carpet tiles, laid over 1.2 x 1.2 m, their pile in turn along x and along y."""
    n = 256
    x, y = pixels(n, n)
    turned = (np.floor(2 * x) + np.floor(2 * y)).astype(int) % 2
    yarn = np.where(turned, noise(x * 16, y * 128, (16, 128), 3), noise(x * 128, y * 16, (128, 16), 4))
    patch = cloud(x * 8, y * 8, (8, 8), 5, 3)
    return shades(0.16 + 0.10 * turned + 0.42 * yarn + 0.3 * patch, "565c62 6b7176 83888b 989b9b", 48)


def ceiling() -> Image:
    """Return a mineral tile of 0.6 x 0.6 m between grey rails."""
    n = 128
    x, y = pixels(n, n)
    rim = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
    value = 0.80 + 0.2 * cloud(x * 16, y * 16, (16, 16), 7, 2)
    return shades(np.where(rim < 0.016, 0.12, value), "b4b5b4 dcddda f3f3f0", 32)


def oak() -> Image:
    return wood(256, 128, "a5835b c6a57a d9be97", 8)


def felt() -> Image:
    return weave(96, 32, "2f6266 3f787b 528d8e", 4)


def ochre() -> Image:
    return weave(96, 32, "b7812a d0993c e0b25a", 6)


def charcoal() -> Image:
    return weave(96, 32, "363a3f 474c52 5a6067", 7)


def binders() -> Image:
    return swatches(BINDERS)


def monitor() -> Image:
    """Return a dark screen: a title bar, a list of lines on the left, the plan of a room on the right."""
    w, h = 192, 112
    x, y = pixels(w, h)
    index = np.where(y < 0.07, 1, 0)
    line = np.floor(y * 18).astype(int)
    inside = y * 18 - line
    length = np.array([0, 0, 14, 22, 18, 25, 9, 0, 20, 24, 12, 19, 0, 23, 16, 21, 8, 0]) / 100
    written = (x > 0.05) & (x < 0.05 + length[np.clip(line, 0, 17)]) & (np.abs(inside - 0.5) < 0.2)
    index = np.where(written, 2 + line % 2, index)
    px, py = np.abs(x - 0.67) / 0.24, np.abs(y - 0.54) / 0.34
    rim = np.maximum(px, py)
    index = np.where((rim < 1) & (rim > 0.955), 4, index)
    for k in range(6):
        far = np.hypot((x - 0.67 - 0.15 * (k % 3 - 1)) * w / h, y - 0.54 - 0.3 * (k // 3 - 0.5))
        index = np.where((np.abs(far - 0.115) < 0.006) & (rim < 0.955), 3, np.where(far < 0.03, 5, index))
    return Image(index.astype(np.uint8), srgb("14202a 24435a 5f7f8c 3d6f7d a9c3c4 e3b85a").astype(np.uint8))


def board() -> Image:
    """Return a whiteboard: a curve over its axes, a plan with six lamps, lines of writing."""
    w, h = 416, 224
    x, y = pixels(w, h)
    x = x * w / h  # in heights
    index = np.zeros((h, w), int)
    thin = 0.008
    axes = ((np.abs(x - 0.14) < thin) & (y > 0.14) & (y < 0.82)) | ((np.abs(y - 0.80) < thin) & (x > 0.12) & (x < 0.8))
    curve = 0.76 - 0.5 * np.exp(-(((x - 0.45) / 0.14) ** 2))
    slope = 0.5 * np.exp(-(((x - 0.45) / 0.14) ** 2)) * 2 * (x - 0.45) / 0.14**2
    drawn = (np.abs(y - curve) < 1.3 * thin * np.sqrt(1 + slope * slope)) & (x > 0.17) & (x < 0.76)
    level = (np.abs(y - 0.42) < 0.7 * thin) & (x > 0.16) & (x < 0.78) & (np.floor(x / 0.03).astype(int) % 2 == 0)
    index = np.where(axes, 1, np.where(drawn, 2, np.where(level, 3, index)))
    rim = np.maximum(np.abs(x - 1.32) / 0.36, np.abs(y - 0.34) / 0.22)
    index = np.where(np.abs(rim - 1) < 0.025, 1, index)
    for k in range(6):
        px, py = 1.32 + 0.23 * (k % 3 - 1), 0.34 + 0.2 * (k // 3 - 0.5)
        index = np.where(np.maximum(np.abs(x - px) / 0.055, np.abs(y - py) / 0.025) < 1, 3, index)
    for k, length in enumerate((0.62, 0.5, 0.56)):
        stroke = 0.70 + 0.075 * k + 0.008 * np.sin(2 * np.pi * x * 23) * np.sin(2 * np.pi * x * 5.3 + k)
        gap = np.sin(2 * np.pi * x * 5.7 + 2 * k) < 0.75
        index = np.where((np.abs(y - stroke) < thin) & (x > 1.0) & (x < 1.0 + length) & gap, 2 if k == 0 else 1, index)
    return Image(index.astype(np.uint8), srgb("eff1ee 3a4650 1f5f9c c4472f").astype(np.uint8))


def locker() -> Image:
    """Return the front of a cabinet: two leaves with a gap between them, and two handles."""
    w, h = 128, 256
    x, y = pixels(w, h)
    rim = np.minimum(np.minimum(x, 1 - x) * w, np.minimum(y, 1 - y) * h)
    gap = (np.abs(x - 0.5) * w < 1.2) | ((rim > 2.5) & (rim < 4.5)) | (np.abs(y - 0.62) * h < 1.0)
    handle = (np.abs(np.abs(x - 0.5) - 0.055) * w < 1.6) & (np.abs(y - 0.47) < 0.045)
    paint = 6 + np.floor(6 * cloud(x * 3, y * 6, (3, 6), 9, 3)).astype(int)
    index = np.where(handle, 1, np.where(gap, 0, paint))
    tints = np.concatenate([srgb("5a625e 4b4f50"), ramp("b9c2b6 c3ccc0", 16)])
    return Image(index.astype(np.uint8), tints.astype(np.uint8))
