"""Image files as textures: each is read once, and refused before it fills the memory."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Callable
from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.geometry.cutouts import bled, cover_of
from gi_core.geometry.mipmap import BYTE
from gi_core.scene.types import Texture

MOST_PIXELS = 1 << 26  # 8192 x 8192: a file of a few kilobytes can declare any size
MISSING = 0.7  # reflectance in place of a texture that cannot be read
NO_MASK = "surfaces are whole where a mask is missing"
NAMED = 4  # images listed by name in a note

_decoded: WeakValueDictionary[bytes, np.ndarray] = WeakValueDictionary()  # by contents of the file, while in use


class ImageError(ValueError):
    """An image that cannot be used; the message is its name and the fault."""


class Images:
    """The textures of one mesh file. One note lists those that cannot be read."""

    def __init__(self) -> None:
        self.textures: list[Texture] = []
        self._index: dict[tuple, int | None] = {}
        self._troubles: dict[str, list[str]] = {}  # by replacement

    def texture(
        self,
        name: str,
        load: Callable[[], bytes],
        wrap: tuple[str, str] = ("repeat", "repeat"),
        nearest: bool = False,
        cut: tuple[float, float] | None = None,
        mask: tuple[str, Callable[[], bytes]] | None = None,
    ) -> int | None:
        """Return the index of a texture in `textures`, None if it cannot be read.

        `name` identifies the image; `load` returns the encoded bytes, or raises ImageError or OSError. cut: the factor
        that multiplies alpha, and the value below which the surface is cut away; None: alpha says nothing. mask: name
        and bytes of an image that is there in place of alpha: `decode_mask`.
        """
        key = (name, wrap, nearest, cut, mask and mask[0])
        if key not in self._index:
            pixels = self.pixels(name, load, f"surfaces are grey {MISSING} where a texture is missing")
            self._index[key] = None if pixels is None else len(self.textures)
            if pixels is not None:
                alpha = None
                if mask is not None:
                    alpha = self._mask(*mask, pixels.shape[:2])
                elif cut is not None:
                    alpha = decode_alpha(load())
                if alpha is None:
                    self.textures.append(Texture(pixels, wrap, nearest))
                else:
                    cover = cover_of(alpha, *(cut or (1.0, 0.5)))
                    self.textures.append(Texture(bled(pixels, cover), wrap, nearest, cover))
        return self._index[key]

    def pixels(self, name: str, load: Callable[[], bytes], otherwise: str) -> np.ndarray | None:
        """Return the pixels (h, w, 3) uint8 sRGB of an image; None if it cannot be read, with `otherwise` noted."""
        try:
            return decode(load())
        except ImageError as error:
            trouble = f"{name} {error}"
        except OSError as error:
            trouble = f"{name} cannot be read ({error.strerror or error})"
        listed = self._troubles.setdefault(otherwise, [])
        if trouble not in listed:
            listed.append(trouble)
        return None

    def plain(self, colour: tuple[float, float, float], name: str, load: Callable[[], bytes]) -> int | None:
        """Return the index of a texture of one linear colour with a mask, None if the mask cannot be read."""
        image = self.pixels(name, load, NO_MASK)
        if image is None:
            return None
        srgb = BYTE[np.round(65535 * np.clip(colour, 0, 1)).astype(np.int64)]
        cover = cover_of(decode_mask(load(), image.shape[:2]), 1.0, 0.5)
        self.textures.append(Texture(np.broadcast_to(srgb, image.shape).copy(), cover=cover))
        return len(self.textures) - 1

    def _mask(self, name: str, load: Callable[[], bytes], shape: tuple[int, int]) -> np.ndarray | None:
        return None if self.pixels(name, load, NO_MASK) is None else decode_mask(load(), shape)

    def notes(self) -> list[str]:
        """Return one line about all textures that could not be read, or none."""
        lines = []
        for otherwise, troubles in self._troubles.items():
            more = f"; and {len(troubles) - NAMED} more" if len(troubles) > NAMED else ""
            lines.append(f"{otherwise}: {'; '.join(troubles[:NAMED])}{more}")
        return lines


def decode(data: bytes) -> np.ndarray:
    """Return the pixels (h, w, 3) uint8 sRGB, read-only, of an encoded image. Raises ImageError."""
    key = hashlib.sha256(data).digest()
    pixels = _decoded.get(key)
    if pixels is None:
        pixels = _decode(data)
        pixels.flags.writeable = False
        _decoded[key] = pixels
    return pixels


def _decode(data: bytes) -> np.ndarray:
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as image:
            width, height = image.size
            if width * height > MOST_PIXELS:  # known from the header, nothing is unpacked yet
                raise ImageError(f"declares {width} x {height} pixels, more than {MOST_PIXELS:,}")
            if image.mode.startswith("I;16"):
                return np.repeat((np.asarray(image) >> 8).astype(np.uint8)[..., None], 3, axis=2)
            return np.array(image.convert("RGB"))
    except ImageError:
        raise
    except Image.DecompressionBombError:
        raise ImageError(f"declares more than {MOST_PIXELS:,} pixels") from None
    except Exception:  # Pillow raises OSError, ValueError, SyntaxError, struct.error, ... on damaged files
        raise ImageError("is not a readable image") from None


def decode_alpha(data: bytes) -> np.ndarray | None:
    """Return alpha (h, w) uint8 of an encoded image that `decode` takes; None if it is opaque all over."""
    from PIL import Image

    with Image.open(io.BytesIO(data)) as image:
        if not ("A" in image.mode or "transparency" in image.info):
            return None
        alpha = np.array(image.convert("RGBA"))[..., 3]
    return None if alpha.min() == 255 else alpha


def decode_mask(data: bytes, shape: tuple[int, int]) -> np.ndarray:
    """Return the opacity (h, w) uint8 of an image in a given shape: its alpha, or its grey without alpha."""
    from PIL import Image

    alpha = decode_alpha(data)
    if alpha is None:
        with Image.open(io.BytesIO(data)) as image:
            alpha = np.array(image.convert("L"))
    return np.array(Image.fromarray(alpha).resize(shape[::-1], Image.Resampling.BILINEAR))


def find(folders: list[Path], boundary: Boundary, name: str) -> Path:
    """Return the image file that a mesh file names: within the boundary, in the first of `folders` that has it.

    Exporters write the paths of their own machine: the bare name is tried where the whole path leads nowhere.
    Raises ImageError.
    """
    name = name.replace("\\", "/")
    strays = False
    for wanted in (name, name.rpartition("/")[2]):
        for folder in folders:
            path = folder / wanted
            if os.path.isfile(path):
                if boundary.holds(path):
                    return path
                strays = True
    raise ImageError("lies outside the folder of the scene; move it there" if strays else "is missing")
