"""Mipmaps: a chain of copies of an image, each half the size of the previous one, and linear values."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.scene.types import Texture


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    """Decode sRGB values in 0..1 to linear ones."""
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
