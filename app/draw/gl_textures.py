"""GL textures: each image is uploaded once for all objects."""

from __future__ import annotations

from collections.abc import Iterable

import moderngl
import numpy as np

from gi_core.geometry.mipmap import levels
from gi_core.scene.types import Texture

SRGB8, SRGB8_ALPHA8 = 0x8C41, 0x8C43  # decoded to linear by the sampler, before filtering
ANISOTROPY = 8.0  # samples at a grazing angle, as in `gi_core.geometry.texture_filter`
# Software drivers: anisotropic filtering takes 1.5 times as long there, and Mesa's blurs near surfaces.
SOFTWARE_DRIVERS = ("llvmpipe", "softpipe", "swiftshader", "software")


class GLTextures:
    """Uploaded textures by image."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._loaded: dict[Texture, moderngl.Texture] = {}
        self._largest = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
        plain = any(name in ctx.info["GL_RENDERER"].lower() for name in SOFTWARE_DRIVERS)
        self._anisotropy = 1.0 if plain else min(ANISOTROPY, ctx.max_anisotropy)

    def keep(self, textures: Iterable[Texture]) -> None:
        """Upload missing textures and release all others."""
        wanted = dict.fromkeys(textures)
        for gone in [t for t in self._loaded if t not in wanted]:
            self._loaded.pop(gone).release()
        for texture in wanted:
            if texture not in self._loaded:
                self._loaded[texture] = self._upload(texture)

    def of(self, texture: Texture) -> moderngl.Texture:
        return self._loaded[texture]

    def _upload(self, texture: Texture) -> moderngl.Texture:
        pixels = texture.pixels
        if max(pixels.shape[:2]) > self._largest:
            pixels = next(level for level in levels(texture) if max(level.shape[:2]) <= self._largest)
        h, w = pixels.shape[:2]
        stored = SRGB8
        if texture.cover is not None:
            step = -(-texture.cover.shape[0] // h)  # nearest texel of a reduced copy
            cover = texture.cover[::step, ::step][:h, :w, None]
            pixels, stored = np.concatenate([pixels, cover], axis=2), SRGB8_ALPHA8
        data = np.ascontiguousarray(pixels)
        made = self._ctx.texture((w, h), data.shape[2], data, alignment=1, internal_format=stored)
        made.build_mipmaps()
        made.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.NEAREST if texture.nearest else moderngl.LINEAR)
        made.repeat_x, made.repeat_y = (way == "repeat" for way in texture.wrap)  # surface.frag mirrors by itself
        made.anisotropy = self._anisotropy
        return made
