"""Textures on the graphics card: images of materials, and directional light, uploaded where it has changed."""

from __future__ import annotations

from collections.abc import Iterable

import moderngl
import numpy as np

from gi_core.geometry.texture_filter import levels
from gi_core.gloss.light import GlossLight
from gi_core.scene.types import Texture


def is_software(ctx: moderngl.Context) -> bool:
    """Return whether this OpenGL draws on the processor."""
    name = ctx.info["GL_RENDERER"].lower()
    return any(word in name for word in ("llvmpipe", "softpipe", "swiftshader", "software"))


class GLTextures:
    """Uploaded textures by image."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._loaded: dict[Texture, moderngl.Texture] = {}
        self._largest = int(ctx.info["GL_MAX_TEXTURE_SIZE"])

    def keep(self, textures: Iterable[Texture]) -> None:
        """Upload missing textures, and keep no others."""
        loaded = self._loaded
        self._loaded = {t: loaded[t] if t in loaded else self._upload(t) for t in dict.fromkeys(textures)}

    def of(self, texture: Texture) -> moderngl.Texture:
        return self._loaded[texture]

    def _upload(self, texture: Texture) -> moderngl.Texture:
        pixels = texture.pixels
        if max(pixels.shape[:2]) > self._largest:
            pixels = next(level for level in levels(texture) if max(level.shape[:2]) <= self._largest)
        h, w = pixels.shape[:2]
        stored = 0x8C41  # GL_SRGB8: decoded to linear by the sampler, before filtering
        if texture.cover is not None:
            step = -(-texture.cover.shape[0] // h)  # nearest texel of a reduced copy
            cover = texture.cover[::step, ::step][:h, :w, None]
            pixels, stored = np.concatenate([pixels, cover], axis=2), 0x8C43  # GL_SRGB8_ALPHA8
        data = np.ascontiguousarray(pixels)
        made = self._ctx.texture((w, h), data.shape[2], data, alignment=1, internal_format=stored)
        made.build_mipmaps()
        made.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.NEAREST if texture.nearest else moderngl.LINEAR)
        made.repeat_x, made.repeat_y = (way == "repeat" for way in texture.wrap)  # surface.frag mirrors by itself
        return made


LINES = 4096  # texels along a column: as many receivers; OpenGL 3.3 promises 1024, every driver in use 16384


class GlossTexture:
    """Light of the glossy receivers: a line per owner of cells in columns of LINES, two texels per cell (RGBA16F).

    A second texture (R32F) has the owner of each receiver, a line per receiver in columns of a texel.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self.lines = min(LINES, ctx.info["GL_MAX_TEXTURE_SIZE"])
        self._texture: moderngl.Texture | None = None
        self._owners: moderngl.Texture | None = None
        self.light: GlossLight | None = None  # on show; None: there is no texture

    def upload(self, light: GlossLight | None) -> None:
        """Show the light of a frame; None changes nothing. Only differences from the last call are uploaded."""
        if light is None or light is self.light:
            return
        before, self.light = self.light, light
        n, cells, _ = light.resting.shape
        size = 2 * cells * -(-n // self.lines), min(n, self.lines)
        if self._texture is None or self._texture.size != size:
            self._texture, before = self._ctx.texture(size, 4, dtype="f2"), None
            self._texture.filter = moderngl.NEAREST, moderngl.NEAREST
        if before is None or before.place is not light.place:
            self._write_owners(light.place)
        if before is None or before.resting is not light.resting:
            rows = np.arange(n)
        else:
            rows = np.union1d(before.changed, light.changed)
        if not len(rows):
            return
        place = np.full(n, -1)
        place[light.changed] = np.arange(len(light.changed))
        # 16 unchanged receivers between changed ones are uploaded with them: a call costs more
        for run in np.split(rows, np.flatnonzero((np.diff(rows) > 16) | (np.diff(rows // self.lines) > 0)) + 1):
            self._write(light, place, int(run[0]), int(run[-1]) + 1)

    def _write_owners(self, place: np.ndarray) -> None:
        columns, lines = -(-len(place) // self.lines), min(len(place), self.lines)
        whole = np.zeros(columns * lines, np.float32)
        whole[: len(place)] = place
        texels = np.ascontiguousarray(whole.reshape(columns, lines).T)
        self._owners = self._ctx.texture((columns, lines), 1, texels.tobytes(), dtype="f4")
        self._owners.filter = moderngl.NEAREST, moderngl.NEAREST

    def _write(self, light: GlossLight, place: np.ndarray, first: int, last: int) -> None:
        """Upload receivers first .. last - 1, all of one column."""
        values = light.resting[first:last].astype(np.float32)
        moved = np.flatnonzero(place[first:last] >= 0)
        values[moved] = light.cells[place[first:last][moved]]
        count, cells, _ = values.shape
        texels = np.zeros((count, cells, 2, 4), np.float16)
        texels[:, :, 0, :3], texels[:, :, 1, :3] = values[:, :, :3], values[:, :, 3:]
        column, line = divmod(first, self.lines)
        assert self._texture is not None
        self._texture.write(texels.tobytes(), viewport=(2 * cells * column, line, 2 * cells, count))

    def use(self, cells: int, owners: int) -> None:
        """Bind the textures of the light on show to units."""
        assert self._texture is not None and self._owners is not None
        self._texture.use(cells)
        self._owners.use(owners)
