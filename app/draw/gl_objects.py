"""GL buffers and vertex arrays of one object, and its draw calls."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import moderngl
import numpy as np

from app.draw.vertex_colours import gloss_colours

if TYPE_CHECKING:
    from app.draw.gl_textures import GLTextures
    from app.draw.vertex_colours import DrawMesh
    from gi_core.scene.types import Texture


class DrawCall(NamedTuple):
    """A range of indices with one texture and one culling rule."""

    first: int
    indices: int
    one_sided: bool
    texture: Texture | None
    vertex: int  # one of its draw vertices
    emission: tuple[float, float, float]


class Layer(NamedTuple):
    """One set of vertex colours of an object, and the vertex arrays that use it."""

    colours: moderngl.Buffer  # radiance and weight of front and back
    lit: moderngl.VertexArray  # without textures
    textured: moderngl.VertexArray | None  # for textures, None where there are none
    cut_out: moderngl.VertexArray | None  # the same for textures with holes
    irradiance: moderngl.Buffer | None  # of front and back, under gloss; None without gloss


class DrawnObject:
    """Buffers of one object. One-sided faces come first, so that culling covers one range.

    A second layer of colours is the right side of a wipe.
    """

    def __init__(self, ctx, surface, textured, cut_out, mask, mesh: DrawMesh) -> None:
        self.ctx = ctx
        self._programs = surface, textured, cut_out
        self._one_sided = mesh.back < 0
        order, self._calls = _draw_calls(mesh)
        self.indices = 3 * len(order)
        self._one_sided_indices = sum(call.indices for call in self._calls if call.one_sided)
        self._colours = np.ones((len(mesh.positions), 8), np.float32)
        self._corners = np.zeros((0, 3))  # of its box, object space
        if len(mesh.positions):
            low_high = np.stack([mesh.positions.min(axis=0), mesh.positions.max(axis=0)], axis=1)
            self._corners = np.array(list(itertools.product(*low_high)), np.float64)
        # GL has no empty buffers; a scene may have an empty object.
        self._positions = ctx.buffer(np.ascontiguousarray(mesh.positions, np.float32).tobytes() or bytes(12))
        self._triangles = ctx.buffer(mesh.triangles[order].astype(np.int32).tobytes() or bytes(12))
        self._marked = ctx.vertex_array(mask, [(self._positions, "3f", "position")], self._triangles)
        self._owned = [self._positions, self._triangles, self._marked]
        self._places = None
        if mesh.uv is not None:
            self._places = ctx.buffer(np.ascontiguousarray(mesh.uv, np.float32).tobytes())
            self._owned.append(self._places)
        self._gloss, self._mesh = None, mesh
        self._light: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # by layer: irradiance, and under gloss per vertex
        self.has_tables = mesh.lobe is not None and bool((mesh.lobe[:, 4] < 0).any())
        if mesh.lobe is not None:
            packed = np.c_[mesh.gloss + 1, mesh.normal, mesh.lobe].astype(np.float32)
            self._gloss = ctx.buffer(packed.tobytes())
            self._owned.append(self._gloss)
        self.has_holes = any(call.texture is not None and call.texture.cover is not None for call in self._calls)
        self._layers: dict[int, Layer] = {}
        self._layer(0)

    @property
    def is_textured(self) -> bool:
        return self._places is not None

    def _layer(self, k: int) -> Layer:
        """Return a layer, creating it at first use."""
        if k not in self._layers:
            surface, textured, cut_out = self._programs
            colours = self.ctx.buffer(bytes(max(self._colours.nbytes, 32)), dynamic=True)
            attributes = [(self._positions, "3f", "position"), (colours, "4f 4f", "front", "back")]
            irradiance = None
            if self._gloss is not None:
                irradiance = self.ctx.buffer(bytes(24 * len(self._colours)), dynamic=True)
                attributes.append((self._gloss, "2f 3f 4f 1f", "glossy", "normal", "specular", "alpha"))
                attributes.append((irradiance, "3f 3f", "front_lit", "back_lit"))
            lit = self.ctx.vertex_array(surface, attributes, self._triangles)
            painted = holed = None
            if self._places is not None:
                attributes.append((self._places, "2f", "place"))
                painted = self.ctx.vertex_array(textured, attributes, self._triangles)
                holed = self.ctx.vertex_array(cut_out, attributes, self._triangles) if self.has_holes else None
            self._layers[k] = Layer(colours, lit, painted, holed, irradiance)
            self._owned += [thing for thing in self._layers[k] if thing is not None]
        return self._layers[k]

    def dim(self, emission: np.ndarray) -> None:
        """Set the emission (D, 3) [W/m2/sr] under textures."""
        self._calls = [call._replace(emission=tuple(emission[call.vertex])) for call in self._calls]

    def upload(self, front: np.ndarray, back: np.ndarray, layer: int = 0, weights: np.ndarray | None = None) -> None:
        self._colours[:, :3] = front
        self._colours[:, 4:7] = back
        self._colours[self._one_sided, 4:7] = -1.0  # see surface.frag
        self._colours[:, 3::4] = 1.0 if weights is None else weights
        if len(self._colours):
            self._layer(layer).colours.write(self._colours)

    def light(self, irradiance: np.ndarray, layer: int = 0) -> None:
        """Upload irradiance (R, 3) [W/m2] under gloss."""
        mesh = self._mesh
        lit = np.c_[np.nan_to_num(irradiance[mesh.front]), np.nan_to_num(irradiance[mesh.back])].astype(np.float32)
        self._light[layer] = irradiance, lit
        self._layer(layer).irradiance.write(lit)

    def evaluate_tables(self, cells: np.ndarray, eye: np.ndarray) -> None:
        """Upload the radiance of tabulated gloss towards an eye (3,) in the object's space; cells as GlossLight's."""
        which = np.flatnonzero(self._mesh.lobe[:, 4] < 0)
        for layer, (irradiance, lit) in self._light.items():
            front, back = gloss_colours(self._mesh, cells, irradiance, eye, which)
            lit[which] = np.c_[front, back]
            self._layer(layer).irradiance.write(lit)

    @property
    def is_glossy(self) -> bool:
        return self._gloss is not None

    def draw(self, cull: bool, layer: int = 0) -> None:
        """Draw all triangles in vertex colours."""
        split, lit = self._one_sided_indices if cull else 0, self._layer(layer).lit
        self._part(lit, 0, split, True)
        self._part(lit, split, self.indices - split, False)

    def draw_textured(self, textures: GLTextures, cull: bool, layer: int = 0) -> None:
        """Draw all calls, each with its texture."""
        of = self._layer(layer)
        for call in self._calls:
            vertices = of.lit
            if call.texture is not None:
                vertices = of.textured if call.texture.cover is None else of.cut_out
                textures.of(call.texture).use(0)
                vertices.program["mirrored"] = tuple(float(way == "mirror") for way in call.texture.wrap)
                vertices.program["emission"] = call.emission
            self._part(vertices, call.first, call.indices, cull and call.one_sided)

    def mark(self) -> None:
        self._part(self._marked, 0, self.indices, False)

    def _part(self, vertices, first: int, count: int, cull: bool) -> None:
        if not count:
            return
        if cull:
            self.ctx.enable(self.ctx.CULL_FACE)
        else:
            self.ctx.disable(self.ctx.CULL_FACE)
        vertices.render(moderngl.TRIANGLES, vertices=count, first=first)

    def rectangle(self, to_clip: np.ndarray, size: tuple[int, int], margin: float) -> tuple[int, int, int, int]:
        """Return the object's pixel rectangle (x, y, width, height); the whole picture if it reaches behind the eye."""
        corners = np.c_[self._corners, np.ones(len(self._corners))] @ to_clip.T
        w, h = size
        if not len(corners) or corners[:, 3].min() <= 1e-6 * np.abs(corners).max():
            return (0, 0, w, h)
        at = (corners[:, :2] / corners[:, 3:] + 1) / 2 * size
        low = np.clip(np.floor(at.min(axis=0) - margin - 1), 0, size).astype(int)
        high = np.clip(np.ceil(at.max(axis=0) + margin + 1), 0, size).astype(int)
        return (int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1]))

    def release(self) -> None:
        for thing in reversed(self._owned):
            thing.release()


def _draw_calls(mesh: DrawMesh) -> tuple[np.ndarray, list[DrawCall]]:
    """Return an order of the triangles (F,) and its draw calls, by side, texture, emission and lamp."""
    corner = mesh.triangles[:, 0]
    kind = (mesh.back[corner] >= 0).astype(np.int64)
    if mesh.texture is not None:
        lamp = np.zeros(len(mesh.positions)) if mesh.lamp is None else mesh.lamp
        glows = (mesh.texture >= 0) & mesh.emission.any(axis=1)
        under = np.where(glows[:, None], np.column_stack([mesh.emission, lamp]), 0.0)[corner]
        glow = np.unique(under, axis=0, return_inverse=True)[1].reshape(-1) if under.any() else 0
        textures = len(mesh.textures) + 1
        kind = (kind * textures + mesh.texture[corner] + 1) * (np.max(glow) + 1) + glow
    _, ones, counts = np.unique(kind, return_index=True, return_counts=True)
    calls, first = [], 0
    for one, count in zip(ones, counts, strict=True):
        v = corner[one]
        texture = None if mesh.texture is None or mesh.texture[v] < 0 else mesh.textures[mesh.texture[v]]
        calls.append(DrawCall(first, 3 * int(count), bool(mesh.back[v] < 0), texture, int(v), tuple(mesh.emission[v])))
        first += 3 * int(count)
    return np.argsort(kind, kind="stable"), calls
