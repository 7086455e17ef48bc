"""Texture filtering: the mean over a triangle, and the value of a pixel.

Both sample mipmaps, so cost does not grow with the texels under a triangle or a pixel. Values are linear.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.threads import available_cores, run_ranges
from gi_core.geometry.mipmap import LINEAR, LINEAR_BYTES, levels
from gi_core.scene.types import Paint, Texture

MOST_REFLECTANCE = 0.98  # paths in a closed room of reflectance 1 would never end
WRAPS = {"repeat": 0, "mirror": 1, "clamp": 2}  # as in the kernels below
TEXTURE_SAMPLES = 1_500_000  # over all triangles, within FINENESS: a tenth of a second on two cores
FINENESS = 16, 64  # samples along the longest edge of a triangle: the error of the mean is half a percent, or a tenth
MOST_TAPS = 8  # samples along a pixel's footprint where a surface is seen at a grazing angle
REFLECTANCE = np.minimum(LINEAR, MOST_REFLECTANCE)


def mean_colours(paint: Paint, most: float = MOST_REFLECTANCE) -> np.ndarray:
    """Return the mean reflectance (F, 3) float64 of each face: corner colours times textures, over its area.

    most: colours are limited to it.
    """
    colour = paint.corner_colour.astype(np.float64)
    result = np.minimum(colour.mean(axis=1), most)
    for t, texture in enumerate(paint.textures):
        faces = np.flatnonzero(paint.face_texture == t)
        if len(faces):
            result[faces] = _means(texture, paint.corner_uv[faces].astype(np.float64), colour[faces], most)
    return result


def lookup(texture: Texture, uv: np.ndarray, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the colour (n, 3) of pixels centred at uv (n, 2), with extents `across` and `along` (n, 2) in uv.

    Trilinear, with up to MOST_TAPS samples along the longer side of the footprint.
    """
    chain = levels(texture)
    h, w = chain[0].shape[:2]
    x, y = (np.sqrt((a[:, 0] * w) ** 2 + (a[:, 1] * h) ** 2) for a in (across, along))
    longer, shorter = np.maximum(x, y), np.maximum(np.minimum(x, y), 1e-6)
    axis = np.where((x >= y)[:, None], across, along)
    taps = np.clip(np.ceil(longer / shorter), 1, MOST_TAPS).astype(np.int64)
    lod = np.clip(np.log2(np.maximum(longer / taps, 1e-6)), 0, len(chain) - 1)
    level = np.minimum(lod.astype(np.int64), len(chain) - 1)
    out = np.empty((len(uv), 3))
    uv, axis = _finite(uv), _finite(axis)
    if texture.nearest:
        near = longer <= 1
        # Texel centres have the texel's own value.
        uv[near], axis[near] = (np.floor(uv[near] * [w, h]) + 0.5) / [w, h], 0.0
    u, v = (WRAPS[way] for way in texture.wrap)
    for k in np.unique(level):
        rows = np.flatnonzero(level == k)
        fine, coarse = chain[k], chain[min(k + 1, len(chain) - 1)]
        out[rows] = _seen(fine, coarse, REFLECTANCE, u, v, uv[rows], axis[rows], taps[rows], lod[rows] - k)
    return out


def _means(texture: Texture, uv: np.ndarray, colour: np.ndarray, most: float) -> np.ndarray:
    """Return the mean (n, 3) over each triangle uv (n, 3, 2), weighted by colours (n, 3, 3) at its corners."""
    chain = levels(texture)
    h, w = chain[0].shape[:2]
    uv = _finite(uv)
    edges = (uv - np.roll(uv, 1, axis=1)) * [w, h]
    longest = np.sqrt((edges * edges).sum(axis=2)).max(axis=1)  # texels
    fineness = np.clip(np.sqrt(TEXTURE_SAMPLES / len(uv)), *FINENESS)
    last = len(chain) - 1
    if "clamp" in texture.wrap:
        # 32 texels: least size of clamped mipmaps, whose edges would blur into the image
        last = max(k for k, c in enumerate(chain) if k == 0 or min(c.shape[:2]) >= 32)
    level = np.clip(np.ceil(np.log2(np.maximum(longest / fineness, 1.0))), 0, last).astype(np.int64)
    samples = np.clip(np.ceil(longest / 2.0**level), 1, np.ceil(fineness)).astype(np.int64)
    out = np.empty((len(uv), 3))
    u, v = (WRAPS[way] for way in texture.wrap)
    table = LINEAR_BYTES if texture.linear else np.minimum(LINEAR, most)
    for k in np.unique(level):
        rows = np.flatnonzero(level == k)
        pixels, triangles = chain[k], (uv[rows], colour[rows], samples[rows])

        def work(_, first, last, pixels=pixels, triangles=triangles):
            return _under(pixels, table, u, v, *(a[first:last] for a in triangles))

        out[rows] = np.concatenate(run_ranges(work, len(rows), available_cores(), 64))  # 64 triangles per thread
    return out


@kernel
def _wrapped(i, n, way):
    if 0 <= i < n:  # the usual case; a division would dominate the cost
        return i
    if way == 0:
        return i % n
    if way == 1:
        i = i % (2 * n)
        return i if i < n else 2 * n - 1 - i
    return min(max(i, 0), n - 1)


@kernel
def _texel(pixels, table, wrap_u, wrap_v, u, v):
    """Return the bilinear value at (u, v); texel centres lie at half numbers."""
    h, w = pixels.shape[0], pixels.shape[1]
    x, y = u * w - 0.5, v * h - 0.5
    left, top = np.floor(x), np.floor(y)
    fx, fy = x - left, y - top
    i, k = _wrapped(int(left), w, wrap_u), _wrapped(int(left) + 1, w, wrap_u)
    j, m = _wrapped(int(top), h, wrap_v), _wrapped(int(top) + 1, h, wrap_v)
    a, b, c, d = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    p, q, r, s = pixels[j, i], pixels[j, k], pixels[m, i], pixels[m, k]
    red = a * table[p[0]] + b * table[q[0]] + c * table[r[0]] + d * table[s[0]]
    green = a * table[p[1]] + b * table[q[1]] + c * table[r[1]] + d * table[s[1]]
    blue = a * table[p[2]] + b * table[q[2]] + c * table[r[2]] + d * table[s[2]]
    return red, green, blue


@allocating
def _under(pixels, table, wrap_u, wrap_v, uv, colour, samples):
    out = np.empty((len(uv), 3))
    for f in range(len(uv)):
        n = samples[f]
        red, green, blue = 0.0, 0.0, 0.0
        # Sample the centres of n^2 equal subtriangles: those that point up, then down.
        for i in range(n):
            for j in range(n - i):
                for down in range(2 if i + j < n - 1 else 1):
                    b, c = (i + (1 + down) / 3) / n, (j + (1 + down) / 3) / n
                    a = 1 - b - c
                    u = a * uv[f, 0, 0] + b * uv[f, 1, 0] + c * uv[f, 2, 0]
                    v = a * uv[f, 0, 1] + b * uv[f, 1, 1] + c * uv[f, 2, 1]
                    texel = _texel(pixels, table, wrap_u, wrap_v, u, v)
                    red += texel[0] * (a * colour[f, 0, 0] + b * colour[f, 1, 0] + c * colour[f, 2, 0])
                    green += texel[1] * (a * colour[f, 0, 1] + b * colour[f, 1, 1] + c * colour[f, 2, 1])
                    blue += texel[2] * (a * colour[f, 0, 2] + b * colour[f, 1, 2] + c * colour[f, 2, 2])
        out[f, 0], out[f, 1], out[f, 2] = red / (n * n), green / (n * n), blue / (n * n)
    return out


@allocating
def _seen(fine, coarse, table, wrap_u, wrap_v, uv, axis, taps, share):
    out = np.empty((len(uv), 3))
    for p in range(len(uv)):
        red, green, blue = 0.0, 0.0, 0.0
        for i in range(taps[p]):
            at = (i + 0.5) / taps[p] - 0.5
            u, v = uv[p, 0] + at * axis[p, 0], uv[p, 1] + at * axis[p, 1]
            near = _texel(fine, table, wrap_u, wrap_v, u, v)
            far = _texel(coarse, table, wrap_u, wrap_v, u, v) if share[p] > 0 else near
            red += near[0] + share[p] * (far[0] - near[0])
            green += near[1] + share[p] * (far[1] - near[1])
            blue += near[2] + share[p] * (far[2] - near[2])
        out[p, 0], out[p, 1], out[p, 2] = red / taps[p], green / taps[p], blue / taps[p]
    return out


def _finite(uv: np.ndarray) -> np.ndarray:
    """Return coordinates with non-finite values replaced."""
    return np.clip(np.nan_to_num(np.asarray(uv, np.float64)), -1e6, 1e6)
