"""Texture filtering: the mean over a triangle, and the value of a pixel.

Both sample mipmaps, so cost does not grow with the texels under a triangle or a pixel. Values are linear.

The footprint of a pixel comes from rays of neighbouring pixels, intersected with the plane of the visible face.

Mipmaps are a chain of copies of an image, each half the size of the previous one.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from gi_core.base.jit import allocating, inlined, kernel
from gi_core.base.threads import available_cores, run_ranges
from gi_core.base.vec import cross, difference, dot, weighted
from gi_core.scene.types import Paint, Texture


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    """Return linear values float64 of sRGB values in 0 .. 1, of any shape."""
    v = np.asarray(value, np.float64)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


LINEAR = srgb_to_linear(np.arange(256) / 255.0)  # of a byte
# The sRGB byte of a linear value in 65535ths; even near black each byte covers five values.
LINEAR_BYTES = np.arange(256) / 255.0  # of a byte of a linear texture
BYTE = np.searchsorted(srgb_to_linear((np.arange(255) + 0.5) / 255.0), np.arange(1 << 16) / 65535.0).astype(np.uint8)
NEAREST_BYTE = np.round(np.arange(1 << 16) / 257.0).astype(np.uint8)  # BYTE of linear textures
_chains: WeakKeyDictionary[Texture, tuple[np.ndarray, ...]] = WeakKeyDictionary()


def levels(texture: Texture) -> tuple[np.ndarray, ...]:
    """Return the image and its copies, each half as wide and high, down to one texel; read-only uint8, coded alike."""
    if texture not in _chains:
        value, byte = (LINEAR_BYTES, NEAREST_BYTE) if texture.linear else (LINEAR, BYTE)
        chain = [np.ascontiguousarray(texture.pixels).view()]
        linear = np.zeros((0, 0, 3), np.float32)
        while max(chain[-1].shape[:2]) > 1:
            # From the unrounded copy: eleven successive roundings would accumulate.
            chain[-1].flags.writeable = False  # numba would compile again for writable arrays
            linear, smaller = _halved(chain[-1], linear, value, byte)
            chain.append(smaller)
        chain[-1].flags.writeable = False
        _chains[texture] = tuple(chain)
    return _chains[texture]


def mean_linear(pixels: np.ndarray) -> np.ndarray:
    """Return the mean linear colour (3,) of an image (h, w, 3) uint8."""
    counts = [np.bincount(pixels[..., c].reshape(-1), minlength=256) for c in range(3)]
    return np.array([count @ LINEAR for count in counts]) / max(pixels[..., 0].size, 1)


@kernel
def _weights(i, size):
    """Return the weights of the three old texels from 2 i on in new texel i of a row of `size` texels."""
    if size == 1:
        return 1.0, 0.0, 0.0
    if size % 2 == 0:
        return 0.5, 0.5, 0.0
    # Odd size: the outer two texels are shared with the neighbours.
    half = size // 2
    return (half - i) / size, half / size, (i + 1) / size


@allocating
def _halved(image, linear, table, byte):
    """Return an image at half its size, float32 linear and uint8; `linear` is empty or the image unrounded."""
    h, w = image.shape[0], image.shape[1]
    out = np.empty((max(h // 2, 1), max(w // 2, 1), 3), np.float32)
    rounded = np.empty(out.shape, np.uint8)
    for y in range(out.shape[0]):
        down = _weights(y, h)
        for x in range(out.shape[1]):
            across = _weights(x, w)
            red, green, blue = 0.0, 0.0, 0.0
            for j in range(3):
                for i in range(3):
                    weight = down[j] * across[i]
                    if weight == 0.0:
                        continue
                    v, u = 2 * y + j, 2 * x + i
                    if len(linear):
                        red += weight * linear[v, u, 0]
                        green += weight * linear[v, u, 1]
                        blue += weight * linear[v, u, 2]
                    else:
                        red += weight * table[image[v, u, 0]]
                        green += weight * table[image[v, u, 1]]
                        blue += weight * table[image[v, u, 2]]
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = red, green, blue
            for k in range(3):
                rounded[y, x, k] = byte[int(min(max(out[y, x, k], 0.0), 1.0) * 65535 + 0.5)]
    return out, rounded


PARALLEL = 1e-30  # parallel rays do not intersect the plane


class Footprints(NamedTuple):
    """In texture coordinates, float64."""

    place: np.ndarray  # (n, 2)
    across: np.ndarray  # (n, 2), offset to the pixel on the right
    along: np.ndarray  # (n, 2), offset to the pixel below


def footprints(corners, uv, face, u, v, eye, directions, steps) -> Footprints:
    """Return the texture footprints of pixels.

    corners (F, 3, 3) float32 [m] and uv (F, 3, 2) float32 of all faces; face (n,), weights u, v (n,) of its
    corners 1 and 2, and unit directions (n, 3) float32 of the rays from eye (3,) that hit it. Rows of steps (3, 3):
    movement of a ray at unit distance along the view per pixel to the right, per pixel down, and the view direction.
    Reflected rays have an eye (n, 3) and steps (n, 3, 3) each.
    """
    out = Footprints(*(np.empty((len(face), 2)) for _ in range(3)))
    eye = np.array(np.broadcast_to(eye, (len(face), 3)), np.float64)
    steps = np.array(np.broadcast_to(steps, (len(face), 3, 3)), np.float64)
    u, v = (np.ascontiguousarray(w, np.float64).reshape(-1) for w in (u, v))
    _footprints(corners, uv, face.astype(np.int64), u, v, eye, directions, steps, *out)
    return out


@kernel
def _footprints(corners, uv, face, u, v, eye, directions, steps, place, across, along):
    for i in range(len(face)):
        f = face[i]
        p = _double(corners[f, 0])
        e1, e2 = difference(_double(corners[f, 1]), p), difference(_double(corners[f, 2]), p)
        q = weighted((1.0, u[i], v[i]), difference(p, eye[i]), e1, e2)
        n = cross(e1, e2)
        square = max(dot(n, n), 1e-60)
        g, h = cross(e2, n), cross(n, e1)  # the gradients of u and v, times square
        forward = dot(directions[i], steps[i, 2])
        d = directions[i, 0] / forward, directions[i, 1] / forward, directions[i, 2] / forward
        depth, steepness = dot(q, steps[i, 2]), dot(n, d)
        if abs(steepness) < PARALLEL:
            steepness = PARALLEL
        for s in range(2):
            # Offset to the intersection of the neighbouring ray.
            slant = dot(n, steps[i, s]) / steepness
            sideways = difference(steps[i, s], (slant * d[0], slant * d[1], slant * d[2]))
            moved = depth * sideways[0], depth * sideways[1], depth * sideways[2]
            du, dv = dot(moved, g) / square, dot(moved, h) / square
            for c in range(2):
                a, b = uv[f, 1, c] - uv[f, 0, c], uv[f, 2, c] - uv[f, 0, c]
                if s == 0:
                    across[i, c] = du * a + dv * b
                    place[i, c] = uv[f, 0, c] + u[i] * a + v[i] * b
                else:
                    along[i, c] = du * a + dv * b


@inlined
def _double(a):
    return np.float64(a[0]), np.float64(a[1]), np.float64(a[2])


MOST_REFLECTANCE = 0.98  # paths in a closed room of reflectance 1 would never end
WRAPS = {"repeat": 0, "mirror": 1, "clamp": 2}  # as in the kernels below
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

    Trilinear, with up to eight samples along the longer side of the footprint.
    """
    chain = levels(texture)
    h, w = chain[0].shape[:2]
    x, y = (np.sqrt((a[:, 0] * w) ** 2 + (a[:, 1] * h) ** 2) for a in (across, along))
    longer, shorter = np.maximum(x, y), np.maximum(np.minimum(x, y), 1e-6)
    axis = np.where((x >= y)[:, None], across, along)
    taps = np.clip(np.ceil(longer / shorter), 1, 8).astype(np.int64)
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
    # 1,500,000 samples over all triangles take a tenth of a second on two cores. 16 along the longest edge of one have
    # half a percent of error of the mean, 64 a tenth.
    fineness = np.clip(np.sqrt(1_500_000 / len(uv)), 16, 64)
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
def wrapped(i, n, way):
    """Return the texel, 0 .. n - 1, at a place i by one of WRAPS."""
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
    i, k = wrapped(int(left), w, wrap_u), wrapped(int(left) + 1, w, wrap_u)
    j, m = wrapped(int(top), h, wrap_v), wrapped(int(top) + 1, h, wrap_v)
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
