"""Framebuffers of a picture, and programs that draw into them."""

from __future__ import annotations

from importlib import resources

import moderngl

from app.draw.tonemap import BACKGROUND, UNLIT


def load_program(ctx, vertex: str, fragment: str, *defines: str):
    """Return the program of two files of `shaders`, with macros defined."""
    read = [resources.files("shaders").joinpath(name).read_text("utf-8") for name in (vertex, fragment)]
    for define in defines:
        read = [text.replace("\n", f"\n#define {define}\n", 1) for text in read]  # #version must stay first
    return ctx.program(vertex_shader=read[0], fragment_shader=read[1])


class Targets:
    """Framebuffers of one size: multisampled, resolved, and a mask for the outline."""

    def __init__(self, ctx, size: tuple[int, int], samples: int) -> None:
        self.size, self.samples = size, samples
        shown = ctx.texture(size, 4)
        shown.filter = (moderngl.LINEAR, moderngl.LINEAR)
        marks = ctx.texture(size, 1)
        self._owned = [shown, marks]
        if samples > 1:
            colour, depth = ctx.renderbuffer(size, 4, samples=samples), ctx.depth_renderbuffer(size, samples=samples)
            self._owned += [colour, depth]
            self.picture = ctx.framebuffer([shown])
            self.drawn = ctx.framebuffer([colour], depth)
        else:
            depth = ctx.depth_renderbuffer(size)
            self._owned.append(depth)
            self.picture = self.drawn = ctx.framebuffer([shown], depth)
        of_mask = ctx.depth_renderbuffer(size)
        self._owned.append(of_mask)
        self.mask = ctx.framebuffer([marks], of_mask)

    def release(self) -> None:
        if self.drawn is not self.picture:
            self.drawn.release()
        for thing in (self.picture, self.mask, *self._owned):
            thing.release()


class LinearTarget:
    """A framebuffer of radiance times exposure in half floats, multisampled, for pictures before their tone map."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx, self._key = ctx, ((0, 0), 0)
        self._program = load_program(ctx, "screen.vert", "surface.frag", "RESOLVED")
        self._screen = ctx.vertex_array(self._program, [])
        self._owned: tuple = ()

    def resize(self, size: tuple[int, int], samples: int) -> None:
        """Set width and height in pixels, and samples per pixel."""
        if self._key == (size, samples):
            return
        self._free()
        self._key = size, samples
        self._light, depth = (
            self._ctx.texture(size, 4, samples=samples, dtype="f2"),
            self._ctx.depth_renderbuffer(size, samples=samples),
        )
        self.drawn = self._ctx.framebuffer([self._light], depth)
        self._owned = self.drawn, self._light, depth

    def tone_map(self, picture: moderngl.Framebuffer, code: int) -> None:
        """Write a picture by a tone map of surface.frag, the mean of the samples."""
        self._ctx.enable_only(self._ctx.NOTHING)
        picture.use()
        self._light.use(0)
        program = self._program
        program["light"], program["samples"] = 0, self._key[1]
        program["background"], program["unlit"] = BACKGROUND, UNLIT
        program["tone_map"] = code
        self._screen.render(moderngl.TRIANGLES, vertices=3)

    def _free(self) -> None:
        for thing in self._owned:
            thing.release()

    def release(self) -> None:
        self._free()
        self._screen.release()
        self._program.release()
