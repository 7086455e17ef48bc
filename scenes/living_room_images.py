"""The painted images of the living room: floor, rug, cloth, picture, book covers, the cat's coat."""

from __future__ import annotations

import numpy as np

from scenes.textures import Image, boards, cloud, noise, pixels, ramp, shades, srgb, swatches, weave, wood

COVERS = "8c2f22 c9a24a 2f4f4a d8cbb0 34435e 6e3b2a a8642c 54683f e0d9c8 7a2f45 455a73 b98f5a"
COVER_COUNT = len(COVERS.split())


def floor() -> Image:
    """Return oak boards, 15 cm wide when the image is laid over 2.4 x 1.2 m."""
    return boards(640, 320, 8, "85684b b69775 d9c3a4", 3)


def walnut() -> Image:
    return wood(256, 128, "4a2c19 6d4629 8b5f3a", 5)


def oak() -> Image:
    return wood(256, 128, "8a6238 b98d58 d3ad7a", 8)


def sofa() -> Image:
    return weave(96, 24, "2a6166 3f7f82 58999a", 4)


def mustard() -> Image:
    return weave(96, 24, "b07c1e cf9a34 e0b459", 6)


def rust() -> Image:
    return weave(96, 24, "93391c b4532c c96f45", 7)


def linen() -> Image:
    return weave(96, 32, "cfc3ab ded5c2 ebe5d6", 9)


def covers() -> Image:
    return swatches(COVERS)


def rug() -> Image:
    """Return a woven rug: a field of lozenges in a border, yarn by yarn."""
    w, h = 432, 304
    x, y = pixels(w, h)
    across, down = x * 2.7, y * 1.9  # metres
    rim = np.minimum(np.minimum(across, 2.7 - across), np.minimum(down, 1.9 - down))
    cell_x, cell_y = (across - 1.35) / 0.36, (down - 0.95) / 0.36
    u, v = np.abs(cell_x - np.round(cell_x)), np.abs(cell_y - np.round(cell_y))
    lozenge = u + v
    odd = (np.round(cell_x) + np.round(cell_y)).astype(int) % 2
    ground = np.where(lozenge < 0.16, 2, np.where(lozenge < 0.24, 0, np.where(lozenge < 0.42, np.where(odd, 3, 1), 0)))
    steps = np.floor((across + down) / 0.09).astype(int) % 2
    colour = np.select(
        [rim < 0.04, rim < 0.07, rim < 0.17, rim < 0.19], [np.full((h, w), 0), 2, np.where(steps, 1, 4), 2], ground
    )
    base = srgb("d9c8a6 a5432b e6dcc4 c68a2e 2f4c55")
    tones = 8
    worn = cloud(x * 6, y * 4, (6, 4), 31, 3)
    yarn = noise(x * w / 2, y * h, (w // 2, h), 32)
    tone = np.clip(np.floor(tones * (0.25 + 0.35 * worn + 0.4 * yarn)), 0, tones - 1).astype(int)
    palette = base[:, None] * np.linspace(0.80, 1.06, tones)[:, None]
    return Image((colour * tones + tone).astype(np.uint8), np.clip(palette.reshape(-1, 3), 0, 255).astype(np.uint8))


def painting() -> Image:
    """Return hills under a low sun."""
    w, h = 416, 276
    x, y = pixels(w, h)
    value = 0.10 + 0.30 * y + 0.05 * cloud(x * 3, y * 5, (3, 5), 40)  # sky, lighter towards the horizon
    sun = np.hypot((x - 0.66) * w / h, y - 0.42) < 0.105
    index = np.floor(value * 64).astype(int)
    index[sun] = 63
    tints = [ramp("3f6d84 8fb3b4 efd9a8 f0b56a e98b4a", 63), srgb("f6e7b4")]
    for k, (level, colour) in enumerate(zip((0.52, 0.62, 0.74, 0.87), HILLS, strict=True)):
        rise = 0.075 * (noise(x * 3.0 + 0.37 * k, 0 * y + 0.5, (4, 1), 50 + k) - 0.5)
        rise = rise + 0.11 * (noise(x * 1.5 + 0.61 * k, 0 * y + 0.5, (4, 1), 60 + k) - 0.5)
        hill = y > level + rise
        shade = 0.5 * cloud(x * 4, y * 12, (4, 12), 70 + k) + 0.6 * (y - level) / 0.2
        index = np.where(hill, 64 + 16 * k + np.clip(np.floor(shade * 16), 0, 15).astype(int), index)
        tints.append(ramp(colour, 16))
    return Image(index.astype(np.uint8), np.concatenate(tints).astype(np.uint8))


HILLS = ("7d7f93 9b93a0", "5f7a78 7d9088", "3f5f4c 5f7d58", "22382f 3c5638")


def coat() -> Image:
    """Return a ginger cat's coat: u along the body, v from the back (0) to the belly (1)."""
    x, y = pixels(256, 128)
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * (13 * x + 0.6 * noise(x * 8, y * 4, (8, 4), 80)))
    stripes = np.clip(3 * (wave - 0.55), 0, 1) * np.clip(1.5 - 1.9 * y, 0, 1)
    pale = np.clip((y - 0.52) * 4, 0, 1) + np.clip((x - 0.895) * 20, 0, 1) * np.clip((y - 0.08) * 20, 0, 1)
    fur = 0.12 * (cloud(x * 24, y * 8, (24, 8), 81, 3) - 0.5)
    return shades(np.clip(0.45 + 0.5 * np.clip(pale, 0, 1) - 0.42 * stripes + fur, 0, 1), "7c3d12 c9792f f3e4cc", 64)
