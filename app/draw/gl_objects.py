"""GL buffers and vertex arrays of one object, and its draw calls."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import moderngl
import numpy as np

from app.draw.bare_lights import HIGHLIGHTS
from app.draw.draw_mesh import DrawMesh, GlossVertices, Turning, other_diagonals
from app.draw.gl_targets import put, rectangle
from app.draw.gl_textures import GLTextures
from app.draw.vertex_colours import gloss_colours
from gi_core.gloss.light import Directions
from gi_core.gloss.reflectors import Reflector
from gi_core.gloss.sharp import hemispherical_albedo
from gi_core.scene.types import Texture


class DrawCall(NamedTuple):
    """A range of indices with one texture and one culling rule."""

    first: int
    indices: int
    one_sided: bool
    texture: Texture | None
    vertex: int  # one of its draw vertices
    emission: tuple[float, float, float]
    reflector: int  # of the mesh, -1: none
    pane: tuple[float, ...] | None  # see DrawMesh; None: opaque


class Colours(NamedTuple):
    """Buffers of the vertex colours of an object."""

    front: moderngl.Buffer  # radiance
    back: moderngl.Buffer  # radiance, negative where one-sided
    weights: moderngl.Buffer  # of front and back
    triangles: moderngl.Buffer  # with the diagonals for these colours ...
    turning: Turning  # ... and its content
    irradiance: moderngl.Buffer | None  # of front and back, under gloss; None without gloss
    sent: moderngl.Buffer | None  # radiance of gloss on front and back that the processor evaluates; None without gloss
    attributes: list[tuple]  # as moderngl describes them
    arrays: dict[moderngl.Program, moderngl.VertexArray]  # of the programs that have drawn them


class MarkedFaces(NamedTuple):
    """Some faces of an object, for their outline; one-sided ones come first."""

    faces: np.ndarray  # (k,)
    triangles: moderngl.Buffer
    vertices: moderngl.VertexArray
    indices: int
    one_sided: int  # indices of one-sided faces
    corners: np.ndarray  # (8, 3) of their box, object space


@dataclass
class Gloss:
    """Buffers of an object's gloss, and its vertices that have any; others show it in reflections."""

    lobes: moderngl.Buffer | None = None  # of all vertices; None: no gloss
    tangents: moderngl.Buffer | None = None  # of tables in reflections
    strengths: moderngl.Buffer | None = None  # of lights without a surface
    has_strength: bool = False  # whether any is not 0
    at_vertices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))  # that show gloss themselves ...
    tabulated: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))  # ... those of them by a table


class DrawnObject:
    """Buffers of one object."""

    def __init__(self, ctx, mask: moderngl.Program, mesh: DrawMesh) -> None:
        self.ctx, self._mask = ctx, mask
        self._two_sided = np.flatnonzero(mesh.back >= 0)
        order, self._calls = _draw_calls(mesh)
        places = np.argsort(order)
        # The mesh with its faces in the order of the draw calls.
        self._ordered = mesh._replace(
            triangles=mesh.triangles[order].astype(np.int32), quads=mesh.quads._replace(faces=places[mesh.quads.faces])
        )
        self.mesh = mesh
        self._back = np.full((self._vertices, 3), -1.0, np.float32)  # it stays where one-sided: see surface.frag
        self._corners = _box(mesh.positions)
        # GL has no empty buffers; a scene may have an empty object.
        self._positions = ctx.buffer(np.ascontiguousarray(mesh.positions, np.float32).tobytes() or bytes(12))
        self._triangles = ctx.buffer(_indices(self._ordered))
        self._faces: MarkedFaces | None = None  # those marked last
        self._marked = ctx.vertex_array(mask, [(self._positions, "3f", "position")], self._triangles)
        self._places = None
        if mesh.uv is not None:
            self._places = ctx.buffer(np.ascontiguousarray(mesh.uv, np.float32).tobytes())
        self._light: np.ndarray | None = None  # irradiance under gloss
        self._radiance: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # of both sides, weights
        self._gloss = Gloss()
        if mesh.gloss is not None:
            plain = mesh.triangles if mesh.reflector is None else mesh.triangles[mesh.reflector < 0]
            self._gloss.at_vertices = np.unique(plain)
            self._gloss.tabulated = self._gloss.at_vertices[mesh.gloss.lobe[self._gloss.at_vertices, 4] < 0]
            packed = np.c_[mesh.gloss.receivers + 1, mesh.gloss.normal, _with_albedo(mesh.gloss)].astype(np.float32)
            self._gloss.lobes = ctx.buffer(packed.tobytes())
        if mesh.reflectors and mesh.gloss.tangent is not None:
            self._gloss.tangents = ctx.buffer(np.ascontiguousarray(mesh.gloss.tangent, np.float32).tobytes())
        if mesh.reflectors:
            self._gloss.strengths = ctx.buffer(bytes(4 * HIGHLIGHTS * self._vertices), dynamic=True)
        self._colours = self._buffers()

    @property
    def _vertices(self) -> int:
        return len(self.mesh.positions)

    @property
    def has_holes(self) -> bool:
        return any(call.texture is not None and call.texture.cover is not None for call in self._calls)

    def draws(self, mesh: DrawMesh) -> bool:
        """Return whether its buffers are those of a mesh, with any emission."""
        return all(a is b for a, b in zip(self.mesh._replace(emission=mesh.emission), mesh, strict=True))

    def _buffers(self) -> Colours:
        triangles = self.ctx.buffer(_indices(self._ordered), dynamic=True)
        vertices = max(self._vertices, 1)  # GL has no empty buffers
        front, weights = (self.ctx.buffer(bytes(size * vertices), dynamic=True) for size in (12, 8))
        back = self.ctx.buffer(np.full((vertices, 3), -1.0, np.float32), dynamic=True)
        attributes: list[tuple] = [(self._positions, "3f", "position"), (weights, "2f", "weights")]
        attributes += [(front, "3f", "front"), (back, "3f", "back")]
        irradiance = sent = None
        if self.mesh.gloss is not None:
            irradiance, sent = (self.ctx.buffer(bytes(24 * self._vertices), dynamic=True) for _ in range(2))
            attributes.append((self._gloss.lobes, "2f 3f 4f 1f", "glossy", "normal", "specular", "alpha"))
            attributes.append((irradiance, "3f 3f", "front_lit", "back_lit"))
            attributes.append((sent, "3f 3f", "front_sent", "back_sent"))
        if self._gloss.tangents is not None:
            attributes.append((self._gloss.tangents, "3f", "along"))
        if self._gloss.strengths is not None:
            attributes.append((self._gloss.strengths, "4f 4f 4f 4f", "lit_a", "lit_b", "lit_c", "lit_d"))
        if self._places is not None:
            attributes.append((self._places, "2f", "place"))
        return Colours(front, back, weights, triangles, Turning(self._ordered), irradiance, sent, attributes, {})

    def _array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Return the vertex array with the attributes that a program reads."""
        of = self._colours
        if program not in of.arrays:
            # moderngl refuses attributes that compilation has removed, unless it skips errors.
            of.arrays[program] = self.ctx.vertex_array(program, of.attributes, of.triangles, skip_errors=True)
        return of.arrays[program]

    def dim(self, emission: np.ndarray) -> None:
        """Set the emission (D, 3) [W/m2/sr] under textures."""
        self.mesh = self.mesh._replace(emission=emission)
        self._calls = [call._replace(emission=tuple(emission[call.vertex])) for call in self._calls]

    def upload(self, front: np.ndarray, back: np.ndarray, weights: np.ndarray | None = None) -> None:
        """Upload the radiance (D, 3) float32 of both sides, and their weights (D, 2) float32; None: all 1."""
        if not self._vertices:
            return
        of = self._colours
        weights = np.ones((self._vertices, 2), np.float32) if weights is None else weights
        self._radiance = front, back, weights
        of.front.write(np.ascontiguousarray(front, np.float32))
        of.weights.write(weights)
        if len(self._two_sided):
            self._back[self._two_sided] = back[self._two_sided]
            first, last = self._two_sided[[0, -1]]
            of.back.write(self._back[first : last + 1], offset=self._back.strides[0] * int(first))
        if of.turning.turn(other_diagonals(self.mesh, front, back, weights)):
            of.triangles.write(of.turning.triangles)

    def radiance_at(self, edge: np.ndarray, face: np.ndarray, textured: bool) -> np.ndarray:
        """Return the mean radiance (n, 3) of faces at edges (n,), without gloss.

        face (n,): 2 k for the front of an edge's face k, 2 k + 1 for its back.
        """
        assert self._radiance is not None
        mesh, v, out = self.mesh, self.mesh.edges.corners[edge, face // 2], np.zeros((len(edge), 3))
        for back in range(2):
            rows = np.flatnonzero(face % 2 == back)
            share = self._radiance[2][v[rows], back, None]
            light = self._radiance[back][v[rows]]
            if textured and mesh.texel is not None:
                light = light * mesh.texel[v[rows]]
                if not back:
                    light += np.where(mesh.texture[v[rows], None] >= 0, mesh.emission[v[rows]], 0.0)
            out[rows] = (share * light).sum(axis=1) / share.sum(axis=1)
        return out

    def light(self, irradiance: np.ndarray) -> None:
        """Upload irradiance (R, 3) [W/m2] under gloss."""
        mesh = self.mesh
        lit = np.c_[np.nan_to_num(irradiance[mesh.front]), np.nan_to_num(irradiance[mesh.back])].astype(np.float32)
        self._light = irradiance
        self._colours.irradiance.write(lit)

    def shine(self, strength: np.ndarray | None) -> None:
        """Upload the strength (D, HIGHLIGHTS) float32 of lights without a surface; None: all 0."""
        gloss = self._gloss
        if gloss.strengths is not None and (strength is not None or gloss.has_strength):
            gloss.strengths.write(np.zeros((self._vertices, HIGHLIGHTS), np.float32) if strength is None else strength)
            gloss.has_strength = strength is not None

    def is_evaluated(self, single_rays: bool) -> bool:
        """Return whether the processor evaluates gloss for each eye: of tables, of all where single rays are kept."""
        return len(self._gloss.at_vertices if single_rays else self._gloss.tabulated) > 0

    def evaluate(self, directions: Directions, eye: np.ndarray) -> None:
        """Upload the radiance of that gloss towards an eye (3,) in the object's space."""
        which = self._gloss.at_vertices if len(directions.offsets) > 1 else self._gloss.tabulated
        if self._light is not None:
            seen = np.zeros((self._vertices, 6), np.float32)
            seen[which] = np.c_[gloss_colours(self.mesh, directions, self._light, eye, which)]
            self._colours.sent.write(seen)

    def draw(self, program: moderngl.Program, cull: bool) -> None:
        """Draw all triangles in vertex colours."""
        self._call(self._array(program), cull)

    def draw_calls(
        self,
        textures: GLTextures,
        cull: bool,
        program_of: Callable[..., moderngl.Program],
        sharp: Callable[[Reflector, bool], moderngl.Program | None],
        left_out: Callable[[Reflector], bool],
    ) -> None:
        """Draw all calls, each with its texture.

        program_of(*defines): the program of surfaces with macros of surface.frag; sharp(reflector, textured): the one
        that shows a reflection, None: there is no image of it; left_out: faces that are not drawn.
        """
        for call in self._calls:
            reflector = None if call.reflector < 0 else self.mesh.reflectors[call.reflector]
            if call.pane is not None or (reflector is not None and left_out(reflector)):
                continue
            holed = call.texture is not None and call.texture.cover is not None
            program = None if reflector is None or holed else sharp(reflector, call.texture is not None)
            if program is None:
                program = program_of(*["TEXTURED"] * (call.texture is not None), *["CUT_OUT"] * holed)
            if call.texture is not None:
                textures.of(call.texture).use(0)
                mirrored = tuple(float(way == "mirror") for way in call.texture.wrap)
                put(program, mirrored=mirrored, emission=call.emission)
            self._part(self._array(program), call.first, call.indices, cull and call.one_sided)

    def draw_panes(self, program: moderngl.Program) -> None:
        """Draw the panes; `pane` of the program is set here."""
        for call in self._calls:
            if call.pane is not None:
                program["pane"] = call.pane
                self._part(self._array(program), call.first, call.indices, False)

    def mark(self, cull: bool = False, omitted: Callable[[Reflector], bool] = lambda reflector: False) -> None:
        """Draw all triangles with the program of the mask, but those of omitted reflectors."""
        of = self.mesh.reflectors
        self._call(self._marked, cull, lambda call: call.reflector < 0 or not omitted(of[call.reflector]))

    def mark_reflector(self, k: int, cull: bool) -> None:
        """Draw the triangles of one reflector as mark(), with the same depths."""
        self._call(self._marked, cull, lambda call: call.reflector == k)

    def mark_faces(self, faces: np.ndarray, cull: bool) -> None:
        """Draw some faces (k,) as mark(), with the same depths."""
        of = self._marked_faces(faces)
        split = of.one_sided if cull else 0
        self._part(of.vertices, 0, split, True)
        self._part(of.vertices, split, of.indices - split, False)

    def _marked_faces(self, faces: np.ndarray) -> MarkedFaces:
        if self._faces is None or self._faces.faces is not faces:
            self._faces = self._made(faces)
        return self._faces

    def _made(self, faces: np.ndarray) -> MarkedFaces:
        triangles = self.mesh.triangles[self.mesh.pieces(faces)].astype(np.int32)
        two_sided = self.mesh.back[triangles[:, 0]] >= 0
        buffer = self.ctx.buffer(triangles[np.argsort(two_sided, kind="stable")].tobytes() or bytes(12))
        vertices = self.ctx.vertex_array(self._mask, [(self._positions, "3f", "position")], buffer)
        counts = 3 * len(triangles), 3 * int((~two_sided).sum())
        return MarkedFaces(faces, buffer, vertices, *counts, _box(self.mesh.positions[triangles.ravel()]))

    def _call(self, vertices, cull: bool, wanted: Callable[[DrawCall], bool] = lambda call: True) -> None:
        """Draw the calls that are wanted with one program."""
        for call in filter(wanted, self._calls):
            self._part(vertices, call.first, call.indices, cull and call.one_sided)

    def _part(self, vertices, first: int, count: int, cull: bool) -> None:
        if not count:
            return
        if cull:
            self.ctx.enable(self.ctx.CULL_FACE)
        else:
            self.ctx.disable(self.ctx.CULL_FACE)
        vertices.render(moderngl.TRIANGLES, vertices=count, first=first)

    def rectangle(
        self, to_clip: np.ndarray, size: tuple[int, int], margin: float, faces: np.ndarray | None = None
    ) -> tuple[int, int, int, int]:
        """Return the pixel rectangle (x, y, width, height) of the object, or of faces (k,) of it."""
        corners = self._corners if faces is None else self._marked_faces(faces).corners
        return rectangle(corners, to_clip, size, margin + 1) or (0, 0, 0, 0)


def _with_albedo(gloss: GlossVertices) -> np.ndarray:
    """Return the lobes (D, 5), those of tables with their hemispherical albedo in place of F0 and F90."""
    out = gloss.lobe.copy()
    for number in np.unique(out[out[:, 4] < 0, 4]):
        rows = out[:, 4] == number
        albedo = hemispherical_albedo(np.array([0, 0, 0, 0, number], np.float64), gloss.tables)
        out[rows, :4] = *albedo, albedo.mean()
    return out


def _box(positions: np.ndarray) -> np.ndarray:
    """Return the corners (8, 3) of the box round positions; (0, 3) without any."""
    if not len(positions):
        return np.zeros((0, 3))
    low_high = np.stack([positions.min(axis=0), positions.max(axis=0)], axis=1)
    return np.array(list(itertools.product(*low_high)), np.float64)


def _indices(mesh: DrawMesh) -> bytes:
    """Return the contents of an index buffer. GL has no empty buffers."""
    return mesh.triangles.tobytes() or bytes(12)


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
    if mesh.reflector is not None:
        kind = kind * (len(mesh.reflectors) + 1) + mesh.reflector + 1
    if mesh.pane is not None:
        kinds, of_pane = np.unique(mesh.pane[corner], axis=0, return_inverse=True)
        kind = kind * len(kinds) + of_pane.reshape(-1)
    _, ones, counts = np.unique(kind, return_index=True, return_counts=True)
    calls, first = [], 0
    for one, count in zip(ones, counts, strict=True):
        v = corner[one]
        texture = None if mesh.texture is None or mesh.texture[v] < 0 else mesh.textures[mesh.texture[v]]
        reflector = -1 if mesh.reflector is None else int(mesh.reflector[one])
        sided = bool(mesh.back[v] < 0)
        glass = None if mesh.pane is None or mesh.pane[v, 3] == 0 else tuple(map(float, mesh.pane[v]))
        calls.append(DrawCall(first, 3 * int(count), sided, texture, int(v), tuple(mesh.emission[v]), reflector, glass))
        first += 3 * int(count)
    return np.argsort(kind, kind="stable"), calls
