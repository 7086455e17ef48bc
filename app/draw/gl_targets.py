"""Framebuffers of a picture, programs that draw into them, and its edges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import resources

import moderngl
import numpy as np

from app.draw.tonemap import BACKGROUND, UNLIT
from gi_core.display.edges import Edges, blend_edges, place_edges


class Programs:
    """Programs of the files of `shaders`, compiled at first use with macros defined.

    Choices that a whole picture shares are macros, because a software renderer runs both sides of every branch.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self.made: dict[tuple[str, ...], moderngl.Program] = {}  # by vertex shader, fragment shader and macros

    def of(self, vertex: str, fragment: str, *defines: str) -> moderngl.Program:
        key = vertex, fragment, *defines
        if key not in self.made:
            read = [resources.files("shaders").joinpath(name).read_text("utf-8") for name in (vertex, fragment)]
            macros = "".join(f"#define {define}\n" for define in defines)
            read = [text.replace("\n", f"\n{macros}", 1) for text in read]  # #version must stay first
            self.made[key] = self._ctx.program(vertex_shader=read[0], fragment_shader=read[1])
        return self.made[key]

    def cover(self, program: moderngl.Program) -> None:
        """Draw a program of screen.vert over the whole framebuffer."""
        self._ctx.vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)


def put(program: moderngl.Program, **values) -> None:
    """Set those uniforms that compilation has left in a program; bytes fill arrays."""
    for name, value in values.items():
        if name in program and isinstance(value, bytes):
            program[name].write(value)  # type: ignore[union-attr]
        elif name in program:
            program[name] = value


def rectangle(
    points: np.ndarray, to_clip: np.ndarray, size: tuple[int, int], margin: float
) -> tuple[int, int, int, int] | None:
    """Return the pixel rectangle (x, y, width, height) of points (n, 3) with a margin; None: out of sight.

    It is the whole picture, of a size in pixels, if they reach behind the eye.
    """
    clip = np.c_[points, np.ones(len(points))] @ to_clip.T
    for axis in range(3):
        if (clip[:, axis] < -clip[:, 3]).all() or (clip[:, axis] > clip[:, 3]).all():
            return None
    if clip[:, 3].min() <= 1e-6 * np.abs(clip).max():
        return 0, 0, *size
    at = (clip[:, :2] / clip[:, 3:] + 1) / 2 * size
    low = np.clip(np.floor(at.min(axis=0) - margin), 0, size).astype(int)
    high = np.clip(np.ceil(at.max(axis=0) + margin), 0, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


class Targets:
    """Framebuffers of one size: multisampled, resolved, and a mask for the outline."""

    def __init__(self, ctx, size: tuple[int, int], samples: int) -> None:
        self.size, self.samples = size, samples
        shown = ctx.texture(size, 4)
        shown.filter = (moderngl.LINEAR, moderngl.LINEAR)
        marks = ctx.texture(size, 1)
        if samples > 1:
            colour, depth = ctx.renderbuffer(size, 4, samples=samples), ctx.depth_renderbuffer(size, samples=samples)
            self.picture = ctx.framebuffer([shown])
            self.drawn = ctx.framebuffer([colour], depth)
        else:
            self.picture = self.drawn = ctx.framebuffer([shown], ctx.depth_renderbuffer(size))
        self.mask = ctx.framebuffer([marks], ctx.depth_renderbuffer(size))


class LinearTarget:
    """A framebuffer of radiance times exposure in half floats, multisampled, for pictures before their tone map."""

    def __init__(self, ctx: moderngl.Context, programs: Programs) -> None:
        self._ctx, self._programs, self._key = ctx, programs, ((0, 0), 0)

    def resize(self, size: tuple[int, int], samples: int) -> None:
        """Set width and height in pixels, and samples per pixel."""
        if self._key == (size, samples):
            return
        self._key = size, samples
        samples = samples if samples > 1 else 0  # llvmpipe takes 4 samples for 1
        self._light = self._ctx.texture(size, 4, samples=samples, dtype="f2")
        depth = self._ctx.depth_renderbuffer(size, samples=samples)
        self.drawn = self._ctx.framebuffer([self._light], depth)

    def tone_map(self, picture: moderngl.Framebuffer, code: int) -> None:
        """Write a picture by a tone map of surface.frag, the mean of the samples."""
        self._ctx.enable_only(self._ctx.NOTHING)
        picture.use()
        self._light.use(0)
        program = self._programs.of(
            "screen.vert", "surface.frag", "RESOLVED", f"TONE_MAP {code}", f"SAMPLES {max(self._key[1], 1)}"
        )
        put(program, light=0, background=BACKGROUND, unlit=UNLIT)
        self._programs.cover(program)


MOST_EDGES = 100_000  # in a picture


def smooth_edges(
    picture: moderngl.Framebuffer,
    depths: moderngl.Framebuffer,
    edges: Sequence[Edges],
    to_clip: Sequence[np.ndarray],
    cull: bool,
    colours: Callable[[int, np.ndarray, np.ndarray], np.ndarray],
) -> None:
    """Smooth a picture of one sample per pixel, a texture of bytes, of objects with some edges, on the processor.

    depths: the framebuffer that has theirs; to_clip: (4, 4) per object; cull: as for place_edges(). colours(object,
    edge (n,), face (n,)): display colours (n, 3) in 0 .. 255 of faces as place_edges() numbers them.
    """
    (width, height), n, of_object = picture.size, 0, []
    room, faces = np.empty((MOST_EDGES, 10)), np.empty((MOST_EDGES, 3), np.int32)
    for shape, matrix in zip(edges, to_clip, strict=True):
        of_object.append(n)
        size = np.array(picture.size, np.float64)
        n += place_edges(*shape[:4], matrix, size, cull, np.empty((4, 4)), room[n:], faces[n:])
    if not n:
        return
    placed, wanted, thin = room[:n], np.zeros(n, bool), np.zeros((n, 2, 3), np.float32)
    drawn, depth = np.empty((height, width, 4), np.uint8), np.empty((height, width), np.float32)
    picture.read_into(drawn, components=4)
    depths.read_into(depth, attachment=-1, components=1, dtype="f4")
    out = drawn.copy()
    gaps = np.zeros((n, 5), np.float32)
    blend_edges(placed, thin, depth, drawn, out, wanted, gaps, 0)
    rows = np.flatnonzero(wanted)
    if len(rows):
        for o, part in enumerate(np.split(rows, np.searchsorted(rows, of_object[1:]))):
            for side in range(2):
                face = np.where(placed[part, 7 + 2 * side] < 0, 0, faces[part, 1 + side])
                thin[part, side] = colours(o, faces[part, 0], face)
        blend_edges(placed[rows], thin[rows], depth, drawn, out, wanted, gaps, 1)
    # Of fewer than 12 pixels, the share of the gap is chance: 8 add 0.05 of 255 to office.
    rows = np.flatnonzero((gaps[:, :2] > 0).all(axis=1) & (gaps[:, :2].sum(axis=1) >= 12))
    blend_edges(placed[rows], thin[rows], depth, drawn, out, wanted, gaps[rows], 2)
    picture.color_attachments[0].write(out)  # type: ignore[union-attr]
