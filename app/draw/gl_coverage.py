"""The share of a view that each reflector covers: a small picture of depths, and a count of samples per reflector."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import moderngl

from app.draw.gl_objects import DrawnObject
from gi_core.gloss.reflectors import Reflector

Shares = dict[tuple[int, int], float]  # by object and its reflector: of the view, more than 0


class GLCoverage:
    """Shares of views. `of` counts them, or returns those of an earlier call with the same key."""

    def __init__(self, ctx: moderngl.Context, samples: int) -> None:
        self._ctx, self._samples = ctx, min(samples, ctx.max_samples)
        self._targets: dict[tuple[int, int], tuple] = {}
        self._queries: list[moderngl.Query] = []
        self._known: dict[tuple, Shares] = {}

    def of(
        self,
        key: tuple,
        size: tuple[int, int],
        objects: Mapping[int, DrawnObject],
        place: Callable[[int], None],
        cull: bool,
        omitted: Callable[[Reflector], bool],
    ) -> Shares:
        """Return the shares of a view of `size` (width, height) of some objects; key: all that they depend on.

        place(o) sets up the program of the mask for object o; omitted: reflectors that the view does not show.
        """
        shares = self._known.pop(key, None)
        if shares is None:
            shares = self._counted(size, objects, place, cull, omitted)
        self._known[key] = shares  # the latest comes last
        if len(self._known) > 64:  # 64 views whose shares are kept, those asked for last
            del self._known[next(iter(self._known))]
        return shares

    def _counted(self, size, objects, place, cull, omitted) -> Shares:
        scale = 256 / max(size)  # 256 pixels along the long side of the small picture
        width, height = (max(round(scale * n), 1) for n in size)
        ctx = self._ctx
        target = self._target((width, height))
        target.use()
        target.clear()
        ctx.enable_only(ctx.DEPTH_TEST)
        ctx.depth_func = "<="
        asked: list[tuple[tuple[int, int], moderngl.Query]] = []
        for o, drawn in objects.items():
            place(o)
            drawn.mark(cull, omitted)
        for o, drawn in objects.items():
            for k, reflector in enumerate(drawn.reflectors):
                if omitted(reflector):
                    continue
                place(o)
                query = self._query(len(asked))
                with query:
                    drawn.mark_reflector(k, cull)
                asked.append(((o, k), query))
        ctx.depth_func = "<"
        whole = width * height * max(target.samples, 1)
        return {which: query.samples / whole for which, query in asked if query.samples}

    def _query(self, n: int) -> moderngl.Query:
        if n == len(self._queries):
            self._queries.append(self._ctx.query(samples=True))
        return self._queries[n]

    def _target(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        if size not in self._targets:
            colour = self._ctx.renderbuffer(size, 1, samples=self._samples)
            depth = self._ctx.depth_renderbuffer(size, samples=self._samples)
            self._targets[size] = self._ctx.framebuffer([colour], depth), colour, depth
        return self._targets[size][0]

    def release(self) -> None:
        for things in self._targets.values():
            for thing in things:
                thing.release()
        self._targets.clear()
        self._known.clear()
