"""Image files as textures: each is read once, and refused before it fills the memory."""

from __future__ import annotations

import hashlib
import io
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple
from weakref import WeakValueDictionary

import numpy as np

from gi_core.files.formats.boundary import MOST_IMAGE_PIXELS, Boundary, like_named
from gi_core.files.formats.file_parts import CHANNELS
from gi_core.geometry.texture_filter import BYTE, mean_linear
from gi_core.scene.errors import SceneError
from gi_core.scene.types import HALF, Texture

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA")  # no other plugin of Pillow runs: that of PostScript runs a program
MISSING = 0.7  # reflectance in place of a texture that cannot be read
NO_FINISH = "gloss is even where its texture is missing"
NO_MASK = "surfaces are whole where a mask is missing"

_decoded: WeakValueDictionary[bytes, np.ndarray] = WeakValueDictionary()  # by contents of the file, while in use


class ImageError(ValueError):
    """An image that cannot be used; the message is its name and the fault."""


class DecodedImage(NamedTuple):
    """A decoded image."""

    pixels: np.ndarray  # (h, w, 3) uint8 sRGB, read-only
    alpha: np.ndarray | None  # (h, w) uint8, None: opaque all over

    def mask(self, shape: tuple[int, int]) -> np.ndarray:
        """Return the opacity (h, w) uint8 in a given shape: alpha, or grey (Rec. 601) without alpha."""
        from PIL import Image

        grey = Image.fromarray(self.pixels).convert("L") if self.alpha is None else Image.fromarray(self.alpha)
        return np.array(grey.resize(shape[::-1], Image.Resampling.BILINEAR))


class Images:
    """The textures of one mesh file, of colour and of gloss. One note lists those that cannot be read."""

    def __init__(self, boundary: Boundary) -> None:
        self.textures: list[Texture] = []
        self.finishes: list[Texture] = []
        self._boundary = boundary
        self._index: dict[tuple, int | None] = {}
        self._pictures: dict[str, DecodedImage | None] = {}
        self._means: dict[int, np.ndarray] = {}  # by identity of pixels, which `_pictures` and `textures` keep alive
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

        `name` identifies the image; `load` returns the encoded bytes, or raises an error of these. cut: the factor
        that multiplies alpha, and the value below which the surface is cut away; None: alpha says nothing. mask: name
        and bytes of an image that is there in place of alpha.
        """
        key = (name, wrap, nearest, cut, mask and mask[0])
        if key not in self._index:
            missing = f"surfaces are grey {MISSING} where a texture is missing"
            picture = self._picture(name, load, missing)
            alpha = None
            if picture is not None and mask is not None:
                masking = self._picture(*mask, NO_MASK)
                alpha = None if masking is None else masking.mask(picture.pixels.shape[:2])
            elif picture is not None and cut is not None:
                alpha = picture.alpha
            if alpha is not None and not self._fits(name, alpha.size, missing):
                picture = None
            self._index[key] = None if picture is None else len(self.textures)
            if picture is not None and alpha is None:
                self.textures.append(Texture(picture.pixels, wrap, nearest))
            elif picture is not None:
                cover = _cover_of(alpha, *(cut or (1.0, 0.5)))
                self.textures.append(Texture(_bled(picture.pixels, cover), wrap, nearest, cover))
        return self._index[key]

    def pixels(self, name: str, load: Callable[[], bytes], otherwise: str) -> np.ndarray | None:
        """Return the pixels (h, w, 3) uint8 sRGB of an image; None if it cannot be read, with `otherwise` noted."""
        picture = self._picture(name, load, otherwise)
        return None if picture is None else picture.pixels

    def emissive(self, name: str, load: Callable[[], bytes], wrap: tuple[str, str]) -> Texture | None:
        """Return a texture of emission, None if it cannot be read."""
        pixels = self.pixels(name, load, "lamps emit evenly where an emissive texture is missing")
        return None if pixels is None else Texture(pixels, wrap)

    def mean_alpha(self, name: str, load: Callable[[], bytes]) -> float:
        """Return the mean of alpha from 0 to 1, 1 for an image without or that cannot be read."""
        picture = self._picture(name, load, NO_FINISH)
        return 1.0 if picture is None or picture.alpha is None else float(picture.alpha.mean()) / 255

    def finish(self, name: str, load: Callable[[], bytes], wrap: tuple[str, str], values: str) -> int | None:
        """Return the index of a texture of gloss in `finishes`, None if it cannot be read.

        values: that count, "linear" or "sRGB" colours, or "alpha"; None also for an opaque image then.
        """
        key = (name, wrap, values)
        if key not in self._index:
            picture = self._picture(name, load, NO_FINISH)
            pixels = None if picture is None else picture.pixels
            if picture is not None and values == "alpha":
                fits = picture.alpha is not None and self._fits(name, picture.alpha.size, NO_FINISH)
                pixels = np.repeat(picture.alpha[..., None], 3, axis=2) if fits else None
            self._index[key] = None if pixels is None else len(self.finishes)
            if pixels is not None:
                self.finishes.append(Texture(pixels, wrap, linear=values != "sRGB"))
        return self._index[key]

    def finish_means(self, textures: Sequence[int | None]) -> tuple[float, ...]:
        """Return the mean linear values (8,) of textures of gloss in the order of Finish, 1 without."""
        means: list[float] = []
        for k, channels in zip(textures, CHANNELS, strict=True):
            texture = None if k is None else self.finishes[k]
            if texture is None:
                mean = np.ones(3)
            else:
                mean = texture.pixels.mean(axis=(0, 1)) / 255 if texture.linear else self.mean(texture.pixels)
            means += [float(mean[c]) for c in channels]
        return tuple(means)

    def mean(self, pixels: np.ndarray) -> np.ndarray:
        """Return the mean linear colour (3,) of pixels of this object."""
        if id(pixels) not in self._means:
            self._means[id(pixels)] = mean_linear(pixels)
        return self._means[id(pixels)]

    def plain(self, colour: tuple[float, float, float], name: str, load: Callable[[], bytes]) -> int | None:
        """Return the index of a texture of one linear colour with a mask, None if the mask cannot be read."""
        picture = self._picture(name, load, NO_MASK)
        if picture is None or not self._fits(name, picture.pixels[..., 0].size, NO_MASK):
            return None
        srgb = BYTE[np.round(65535 * np.clip(colour, 0, 1)).astype(np.int64)]
        shape = picture.pixels.shape
        cover = _cover_of(picture.mask(shape[:2]), 1.0, 0.5)
        self.textures.append(Texture(np.broadcast_to(srgb, shape).copy(), cover=cover))
        return len(self.textures) - 1

    def _picture(self, name: str, load: Callable[[], bytes], otherwise: str) -> DecodedImage | None:
        """Return an image, decoded once; None if it cannot be read, with `otherwise` noted."""
        if name not in self._pictures:
            try:
                self._pictures[name] = decode(load(), name, self._boundary)
            except SceneError as error:
                self._note(otherwise, str(error))
            except ImageError as error:
                self._note(otherwise, f"{name} {error}")
            self._pictures.setdefault(name, None)
        return self._pictures[name]

    def _fits(self, name: str, pixels: int, otherwise: str) -> bool:
        """Return whether a copy of an image stays within the limits of the scene; add a note if not."""
        try:
            self._boundary.take(name, "pixels", pixels)
        except SceneError as error:
            self._note(otherwise, str(error))
            return False
        return True

    def _note(self, otherwise: str, trouble: str) -> None:
        listed = self._troubles.setdefault(otherwise, [])
        if trouble not in listed:
            listed.append(trouble)

    def notes(self) -> list[str]:
        """Return one line about all textures that could not be read, or none."""
        named = 4  # images listed by name in a note
        lines = []
        for otherwise, troubles in self._troubles.items():
            more = f"; and {len(troubles) - named} more" if len(troubles) > named else ""
            lines.append(f"{otherwise}: {'; '.join(troubles[:named])}{more}")
        return lines


def _cover_of(alpha: np.ndarray, factor: float, cutoff: float) -> np.ndarray:
    """Return alpha (h, w) uint8 times `factor`, scaled so that `cutoff` becomes HALF, the common threshold."""
    if cutoff <= 0:
        return np.full(alpha.shape, 255, np.uint8)
    return np.round(np.clip(np.arange(256) * (0.5 * factor / cutoff), 0, 255)).astype(np.uint8)[alpha]


def _bled(pixels: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """Return pixels (h, w, 3) with cut-out ones in the mean colour of the rest: interpolation mixes them in."""
    solid = cover >= HALF
    if solid.all() or not solid.any():
        return pixels
    filled = pixels.copy()
    filled[~solid] = np.round(pixels[solid].mean(axis=0)).astype(np.uint8)
    return filled


def decode(data: bytes, name: str, boundary: Boundary) -> DecodedImage:
    """Return an encoded image; equal bytes share their pixels. Raises ImageError, or SceneError beyond the limits."""
    from PIL import Image

    digest = hashlib.sha256(data).digest()
    try:
        with warnings.catch_warnings(), Image.open(io.BytesIO(data), formats=FORMATS) as image:
            warnings.simplefilter("ignore")  # no word of Pillow's on the terminal
            width, height = image.size  # known from the header, nothing is unpacked yet
            if width * height > MOST_IMAGE_PIXELS:
                raise ImageError(f"declares {width} x {height} pixels, more than {MOST_IMAGE_PIXELS:,}")
            if digest not in boundary.images:
                boundary.take(name, "pixels", width * height)
                boundary.images.add(digest)
            alpha = None
            if "A" in image.mode or "transparency" in image.info:
                alpha = np.array(image.convert("RGBA").getchannel("A"))
            pixels = _decoded.get(digest)
            if pixels is None:
                pixels = _rgb(image)
                pixels.flags.writeable = False
                _decoded[digest] = pixels
            return DecodedImage(pixels, None if alpha is None or alpha.min() == 255 else alpha)
    except (ImageError, SceneError, MemoryError):
        raise
    except Image.DecompressionBombError:
        raise ImageError(f"declares more than {MOST_IMAGE_PIXELS:,} pixels") from None
    except Exception:  # Pillow raises OSError, ValueError, SyntaxError, struct.error, ... on damaged files
        raise ImageError("is not a readable image") from None


def _rgb(image) -> np.ndarray:
    """Return the pixels (h, w, 3) uint8 of an open image."""
    if image.mode.startswith("I;16"):
        return np.repeat((np.asarray(image) >> 8).astype(np.uint8)[..., None], 3, axis=2)
    if image.mode == "P" and "transparency" in image.info:
        image = image.convert("RGBA")
    return np.array(image if image.mode == "RGB" else image.convert("RGB"))


def find(folders: list[Path], boundary: Boundary, name: str) -> Path:
    """Return the image file that a mesh file names: within the boundary, in the first of `folders` that has it.

    Exporters write the paths of their own machine: the bare name is tried where the whole path leads nowhere.
    Raises ImageError.
    """
    name = name.replace("\\", "/")
    strays = False
    for wanted in (name, name.rpartition("/")[2]):
        for folder in folders:
            path = like_named(folder / wanted)
            if os.path.isfile(path):
                if boundary.holds(path):
                    return path
                strays = True
    raise ImageError("lies outside the folder of the scene; move it there" if strays else "is missing")
