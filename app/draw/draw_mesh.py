"""Draw meshes: vertices split by light and paint.

A mesh vertex is drawn once per combination of front receiver, back receiver, reflectance, emission and texture
coordinate.

Quadrilaterals are two triangles in one plane that share the longest edge of both. They are convex: both angles of a
triangle at its longest edge are acute. Both diagonals give the same surface. Across a border of light, the wrong one
interpolates to teeth. A picture draws the diagonal whose ends differ less, which lies along the border: data-dependent
triangulation (Dyn, Levin and Rippa 1990). Receivers, their light and its errors do not change.
docs/decisions/drawn-light.md has the measurements.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.base.vectors import cross, dot
from gi_core.bsdf.table import Tables
from gi_core.display.edges import NO_EDGES, Edges, edges_of
from gi_core.display.vertex_light import follow_light, turn_triangles
from gi_core.geometry.surfaces import Surfaces, glossy_receivers
from gi_core.gloss.reflectors import Reflector, reflectors
from gi_core.model import Model
from gi_core.scene.types import Paint, Texture


class Quads(NamedTuple):
    """Quadrilaterals of a mesh: triangles (a, b, c) and (d, c, b); with the other diagonal (a, b, d) and (d, c, a)."""

    faces: np.ndarray  # (q, 2) int64, the two triangles
    corners: np.ndarray  # (4, q) int64 vertices a, b, d, c, in this order around the quadrilateral
    beside: np.ndarray | None = None  # (F,) int32, the other triangle of a quad drawn with its other diagonal, or -1


NO_QUADS = Quads(np.zeros((0, 2), np.int64), np.zeros((4, 0), np.int64))


def quads_of(
    positions: np.ndarray, triangles: np.ndarray, uv: np.ndarray | None = None, usable: np.ndarray | None = None
) -> Quads:
    """Return the quadrilaterals of triangles (F, 3) into positions (D, 3).

    uv (D, 2): texture coordinates, which must lie in an affine image of the plane; usable (F,): None for all faces.
    """
    p = positions.astype(np.float64)[triangles]
    edges = p[:, [2, 0, 1]] - p[:, [1, 2, 0]]  # opposite each corner
    apex = dot(edges, edges).argmax(axis=1)
    turned = np.take_along_axis(triangles, (apex[:, None] + np.arange(3)) % 3, axis=1)  # apex, then the longest edge
    rows = np.arange(len(triangles)) if usable is None else np.flatnonzero(usable)
    low, high = np.sort(turned[rows, 1:], axis=1).T
    order = np.lexsort((low, high))
    rows, low, high = rows[order], low[order], high[order]
    same = (low[1:] == low[:-1]) & (high[1:] == high[:-1])
    third = np.r_[False, same] & np.r_[same, False]  # of three triangles at an edge, the middle one
    first = np.flatnonzero(same & ~(third[1:] | third[:-1]))
    one, two = turned[rows[first]], turned[rows[first + 1]]
    facing = one[:, 1] == two[:, 2]  # else the triangles overlap, or their fronts differ
    faces = np.stack([rows[first], rows[first + 1]], axis=1)[facing]
    corners = np.stack([one[:, 0], one[:, 1], two[:, 0], one[:, 2]])[:, facing]
    good = _is_flat(positions, uv, corners)
    return Quads(faces[good], np.ascontiguousarray(corners[:, good], np.int64))  # a picture gathers a row at a time


def _is_flat(positions: np.ndarray, uv: np.ndarray | None, corners: np.ndarray) -> np.ndarray:
    """Return whether quadrilaterals (q,) lie in planes, and their texture coordinates in affine images of these."""
    off_plane = 1e-4  # of the diagonal: a corner off the plane of the others; the same for texture coordinates
    a, b, d, c = positions.astype(np.float64)[corners]
    u, v, w = b - a, c - a, d - a
    normal = cross(u, v)
    area = np.maximum(dot(normal, normal), 1e-300)
    x, y = (dot(cross(w, v), normal) / area)[:, None], (dot(cross(u, w), normal) / area)[:, None]
    good = np.abs(w - x * u - y * v).max(axis=1) <= off_plane * np.sqrt(dot(c - b, c - b))
    if uv is not None:
        a, b, d, c = uv.astype(np.float64)[corners]
        off = np.abs(d - a - x * (b - a) - y * (c - a)).max(axis=1)
        good &= off <= off_plane * np.abs(c - b).max(axis=1) + 1e-12
    return good


class GlossVertices(NamedTuple):
    """Gloss of D draw vertices."""

    lobe: np.ndarray  # (D, 5) float32: F0, F90, alpha
    receivers: np.ndarray  # (D, 2) int32, glossy receiver on front and back (row of GlossLight), -1: none
    normal: np.ndarray  # (D, 3) float32 unit, of the receiver on the front
    tangent: np.ndarray | None  # (D, 3) float32 unit; None: no vertex has a table ...
    tables: Tables | None  # ... of these


class DrawMesh(NamedTuple):
    """Vertex data of one object, in object space."""

    positions: np.ndarray  # (D, 3) float32 [m]
    triangles: np.ndarray  # (F, 3) int32, into positions
    front: np.ndarray  # (D,) int32 receiver on the front
    back: np.ndarray  # (D,) int32 receiver on the back, -1 where one-sided
    reflectance: np.ndarray  # (D, 3) float32 rho, or the texture's factor
    emission: np.ndarray  # (D, 3) float64 Le [W/m2/sr]
    textures: tuple[Texture, ...] = ()  # empty: the three below are None
    texture: np.ndarray | None = None  # (D,) int32 into textures, -1: none; a triangle's vertices agree
    uv: np.ndarray | None = None  # (D, 2) float32
    texel: np.ndarray | None = None  # (D, 3) float64, mean of the texture around the vertex, 1 without texture
    lamp: np.ndarray | None = None  # (D,) int32, of emissive vertices; None: all are the first lamp
    gloss: GlossVertices | None = None  # None: no vertex is glossy
    reflectors: tuple[Reflector, ...] = ()  # of faces too sharp for light at vertices
    reflector: np.ndarray | None = None  # (F,) int32 into them, -1: none; None: there are none
    quads: Quads = NO_QUADS
    edges: Edges = NO_EDGES  # of the model's faces, opaque ones without holes; their corners are draw vertices
    source: np.ndarray | None = None  # (F,) int32, face of the model that each is a piece of; None: they are these
    glowing: np.ndarray | None = None  # (k,) int64, draw vertices that emit; None: unknown
    pane: np.ndarray | None = (
        None  # (D, 4) float32, see Panes; index of refraction 0: opaque; None: no vertex has a pane
    )

    def pieces(self, faces: np.ndarray) -> np.ndarray:
        """Return the faces (m,) that faces (n,) of the model are drawn as."""
        return faces if self.source is None else np.flatnonzero(np.isin(self.source, faces))

    @property
    def emissive(self) -> np.ndarray | slice:
        """Draw vertices outside which emission is 0."""
        return slice(None) if self.glowing is None else self.glowing


def draw_meshes(surfaces: Surfaces, lamp: np.ndarray | None = None) -> tuple[DrawMesh, ...]:
    """Return one DrawMesh per object: the static part, then the mobiles in order; pictures of them have no gloss.

    lamp (F,): of emissive faces.
    """
    lamp = np.zeros(len(surfaces.areas), np.int32) if lamp is None else lamp
    return tuple(_with_quads(_draw_mesh(surfaces, lamp, o)) for o in range(len(surfaces.vertices)))


def meshes_of(model: Model, before: tuple[Model, tuple[DrawMesh, ...]] | None = None) -> tuple[DrawMesh, ...]:
    """Return the draw meshes of a model, with its gloss.

    before: of another version of the scene; without gloss, meshes of objects that are the same are those. A model's
    meshes are made once.
    """
    if model not in _made:
        _made[model] = _meshes_of(model, before)
    return _made[model]


_made: WeakKeyDictionary[Model, tuple[DrawMesh, ...]] = WeakKeyDictionary()


def _meshes_of(model: Model, before: tuple[Model, tuple[DrawMesh, ...]] | None) -> tuple[DrawMesh, ...]:
    s = model.surfaces
    if np.isnan(s.lobe).all():
        unchanged = {} if before is None else _unchanged(model, *before)
        return tuple(
            unchanged[o] if o in unchanged else _with_quads(_draw_mesh(s, model.lamp_of_face, o))
            for o in range(s.objects)
        )
    glossy, normals = glossy_receivers(s), model.object_receivers.normals
    meshes = (_draw_mesh(s, model.lamp_of_face, o, glossy, normals) for o in range(s.objects))
    with_reflectors = (_with_reflectors(mesh, of_mesh) for mesh, of_mesh in zip(meshes, reflectors(model), strict=True))
    return tuple(_with_quads(mesh) for mesh in with_reflectors)


def _unchanged(now: Model, before: Model, meshes: tuple[DrawMesh, ...]) -> dict[int, DrawMesh]:
    """Return the meshes, by number, of objects that are drawn as before; neither model has gloss there."""
    new, old = now.surfaces, before.surfaces
    same = {}
    for o, mesh in enumerate(meshes[: new.objects]):
        a, b = new.face_range(o), old.face_range(o)
        faces = (
            (surfaces.reflectance[k], surfaces.emission[k], surfaces.corner_front[k], surfaces.corner_back[k], lamp[k])
            for surfaces, lamp, k in ((new, now.lamp_of_face, a), (old, before.lamp_of_face, b))
        )
        whole = (new.vertices[o], new.faces[o]), (old.vertices[o], old.faces[o])
        paints = new.paint[o] is old.paint[o] and mesh.gloss is None
        if paints and all(map(np.array_equal, *whole)) and all(map(np.array_equal, *faces)):
            same[o] = mesh
    return same


def _with_quads(mesh: DrawMesh) -> DrawMesh:
    """Return the mesh with its quads and edges; sharp reflections keep their faces."""
    usable = None if mesh.reflector is None else mesh.reflector < 0
    corner, solid = mesh.triangles[:, 0], np.ones(len(mesh.triangles), bool)
    if mesh.pane is not None:
        solid &= mesh.pane[corner, 3] == 0
    if mesh.texture is not None:
        solid &= ~np.array([*(texture.cover is not None for texture in mesh.textures), False])[mesh.texture[corner]]
    return mesh._replace(
        quads=quads_of(mesh.positions, mesh.triangles, mesh.uv, usable),
        edges=edges_of(mesh.positions, mesh.triangles[solid], mesh.back[corner[solid]] >= 0),
    )


def _with_reflectors(mesh: DrawMesh, mesh_reflectors: tuple[Reflector, ...]) -> DrawMesh:
    if not mesh_reflectors:
        return mesh
    of_face = np.full(len(mesh.triangles), -1, np.int32)
    for k, r in enumerate(mesh_reflectors):
        of_face[r.faces] = k
    return mesh._replace(reflectors=mesh_reflectors, reflector=of_face)


def _gloss_of(
    surfaces: Surfaces, faces: np.ndarray, front: np.ndarray, back: np.ndarray, glossy: np.ndarray, normals: np.ndarray
) -> GlossVertices | None:
    """Return the gloss of draw vertices (D,) by a face and the receivers of each; None where no vertex is glossy."""
    lobe = surfaces.lobe[faces].astype(np.float32)
    if np.isnan(lobe).all():
        return None
    sides = np.stack([front, back], axis=1)
    has = (sides >= 0) & ~np.isnan(lobe[:, 4:])
    rows = np.where(has, np.searchsorted(glossy, sides), -1).astype(np.int32)
    tangent, tables = None, None
    if len(surfaces.tangent):
        tangent, tables = surfaces.tangent[faces].astype(np.float32), surfaces.tables
    return GlossVertices(lobe, rows, normals[front].astype(np.float32), tangent, tables)


def dimmed(meshes: tuple[DrawMesh, ...], levels: np.ndarray) -> tuple[DrawMesh, ...]:
    """Return the meshes with emission at levels (G, 3) of the lamps."""

    def emission(m: DrawMesh) -> np.ndarray:
        rows, out = m.emissive, np.zeros(m.emission.shape)  # zeros_like() would write every page
        out[rows] = m.emission[rows] * levels[0 if m.lamp is None else m.lamp[rows]]
        return out

    return tuple(m._replace(emission=emission(m)) for m in meshes)


def part_of(mesh: DrawMesh, faces: np.ndarray) -> DrawMesh:
    """Return the mesh of some faces (n,) in their order, each with its own vertices."""
    return with_vertices(mesh, mesh.triangles[faces].reshape(-1), np.arange(3 * len(faces)).reshape(-1, 3))


def with_vertices(mesh: DrawMesh, rows: np.ndarray, triangles) -> DrawMesh:
    """Return a mesh of some draw vertices, rows (n,), and of triangles (m, 3) into these; without sharp reflections."""
    of_light = ("front", "back", "reflectance", "emission", "lamp", "pane")
    per_vertex = ("positions", "texture", "uv", "texel", *of_light)
    values = {name: getattr(mesh, name) for name in per_vertex}
    values = {name: None if a is None else a[rows] for name, a in values.items()}
    if mesh.gloss is not None:
        values["gloss"] = GlossVertices._make(a if a is None or a is mesh.gloss.tables else a[rows] for a in mesh.gloss)
    triangles = np.asarray(triangles, np.int32).reshape(-1, 3)
    bare = mesh._replace(reflectors=(), reflector=None, quads=NO_QUADS, edges=NO_EDGES, source=None, glowing=None)
    return bare._replace(triangles=triangles, **values)


def _draw_mesh(
    surfaces: Surfaces, lamp: np.ndarray, o: int, glossy: np.ndarray | None = None, normals: np.ndarray | None = None
) -> DrawMesh:
    """Return the mesh of an object; glossy: receivers of its gloss, among all with normals (R, 3); None: without."""
    faces = surfaces.faces[o]
    of = slice(int(surfaces.first_face[o]), int(surfaces.first_face[o + 1]))
    front, back = surfaces.corner_front[of].reshape(-1), surfaces.corner_back[of].reshape(-1)
    corner = faces.reshape(-1)
    if not len(corner):
        none = np.zeros(0, np.int32)
        return DrawMesh(np.zeros((0, 3), np.float32), faces, none, none, np.zeros((0, 3)), np.zeros((0, 3)))

    paint, emission, lamp, lobe = surfaces.paint[o], surfaces.emission[of], lamp[of], surfaces.lobe[of]
    pane = surfaces.pane[of]
    alike = np.concatenate([emission, lamp[:, None], lobe, pane[:, None]], axis=1)
    if paint is None:
        kind = np.repeat(_alike(np.concatenate([surfaces.reflectance[of], alike], axis=1)), 3)
    else:
        kind = _painted_kind(paint, _alike(alike))
    # In pairs: four numbers together exceed 64 bits.
    draw = group_of((group_of((corner, front)), group_of((back, kind))))
    first = np.empty(int(draw.max()) + 1, np.int64)
    first[draw[::-1]] = np.arange(len(draw))[::-1]
    # A picture shows the light that meets a pane, see raycast.by_panes().
    reflectance, emission = np.where((pane >= 0)[:, None], 1.0, surfaces.reflectance[of]), emission[first // 3]
    front, back = front[first].astype(np.int32), back[first].astype(np.int32)
    mesh = DrawMesh(
        positions=surfaces.vertices[o][corner[first]].astype(np.float32),
        triangles=draw.reshape(-1, 3).astype(np.int32),
        front=front,
        back=back,
        reflectance=(reflectance[first // 3] if paint is None else _tints(paint)[first]).astype(np.float32),
        emission=emission,
        glowing=np.flatnonzero(emission.any(axis=1)),
        lamp=lamp[first // 3],
        gloss=None if glossy is None else _gloss_of(surfaces, of.start + first // 3, front, back, glossy, normals),
        pane=np.append(surfaces.panes, np.zeros((1, 4)), axis=0).astype(np.float32)[pane[first // 3]]
        if (pane >= 0).any()
        else None,
    )
    if paint is None or not (paint.face_texture >= 0).any():
        return mesh
    count = np.bincount(draw.reshape(-1), minlength=len(first))
    # Texture factor in the product of colour and texture that light uses.
    under = np.maximum(paint.corner_colour.mean(axis=1), 1e-6)
    texels = np.where((paint.face_texture < 0)[:, None], 1.0, np.minimum(reflectance / under, 1.0)).repeat(3, axis=0)
    return mesh._replace(
        textures=paint.textures,
        texture=paint.face_texture[first // 3].astype(np.int32),
        uv=np.ascontiguousarray(paint.corner_uv.reshape(-1, 2)[first], np.float32),
        texel=np.stack([np.bincount(draw.reshape(-1), texels[:, k]) / count for k in range(3)], axis=1),
    )


def _tints(paint: Paint) -> np.ndarray:
    """Return the texture's factor per corner (3 F, 3) float64."""
    return paint.corner_colour.reshape(-1, 3).astype(np.float64)


def _painted_kind(paint: Paint, emission: np.ndarray) -> np.ndarray:
    """Return class numbers (3 F,) of corners of equal paint and emission; `emission` (F,) holds class numbers."""
    kind = np.repeat(group_of((emission, paint.face_texture)), 3)
    colour, uv = (np.ascontiguousarray(c, np.float32) for c in (paint.corner_colour, paint.corner_uv))
    bits = [*colour.reshape(-1, 3).view(np.int32).T, uv.reshape(-1, 2).view(np.int64)[:, 0]]
    for column in bits:
        kind = group_of((kind, np.unique(column, return_inverse=True)[1].reshape(-1)))
    return kind


def _alike(rows: np.ndarray) -> np.ndarray:
    """Return class numbers (n,) of equal rows (n, c)."""
    return group_of([np.unique(column, return_inverse=True)[1].reshape(-1) for column in rows.T])


NO_WEIGHTS = np.zeros((0, 2), np.float32)


def other_diagonals(
    mesh: DrawMesh, front: np.ndarray, back: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Return which quadrilaterals (q,) bool are drawn with the diagonal that their triangles do not share.

    front, back (D, 3) float32: colours of draw vertices; weights (D, 2): of interpolation, None: all 1. A quadrilateral
    with an unreached corner keeps its diagonal.
    """
    light, out = np.empty((len(front), 2), np.float32), np.empty(len(mesh.quads.faces), bool)
    follow_light(mesh.quads.corners, front, back, NO_WEIGHTS if weights is None else weights, light, out)
    return out


def with_diagonals(mesh: DrawMesh, turned: np.ndarray) -> DrawMesh:
    """Return the mesh with the other diagonal in those of its quadrilaterals that are turned (q,) bool."""
    turning, beside = Turning(mesh), np.full(len(mesh.triangles), -1, np.int32)
    turning.turn(turned)
    faces = mesh.quads.faces[turned]
    beside[faces] = faces[:, ::-1]
    return mesh._replace(triangles=turning.triangles, quads=mesh.quads._replace(beside=beside))


class Turning:
    """Triangles of a mesh whose quadrilaterals take either diagonal, again and again."""

    def __init__(self, mesh: DrawMesh) -> None:
        self.triangles = mesh.triangles.astype(np.int32)  # (F, 3); of one order of corners, however often they turn
        self.triangles[mesh.quads.faces] = mesh.quads.corners.T[:, [[0, 1, 3], [2, 3, 1]]]
        self._quads, self._turned = mesh.quads, np.zeros(len(mesh.quads.faces), bool)

    def turn(self, turned: np.ndarray) -> bool:
        """Set which quadrilaterals (q,) bool have the other diagonal; return whether any triangle changes."""
        changed = turn_triangles(turned, self._turned, self._quads.faces, self._quads.corners, self.triangles)
        self._turned = turned
        return changed > 0


def along_light(mesh: DrawMesh, front: np.ndarray, back: np.ndarray, weights: np.ndarray | None = None) -> DrawMesh:
    """Return the mesh with the diagonals for its colours; arguments as for other_diagonals()."""
    return with_diagonals(mesh, other_diagonals(mesh, front, back, weights))


def quad_around(mesh: DrawMesh, face: int) -> DrawMesh:
    """Return the mesh of a face of the model, as triangle 0: of its quadrilateral, or of its pieces."""
    if len(pieces := mesh.pieces(np.array([face]))) > 1:
        return part_of(mesh, pieces)._replace(source=np.zeros(len(pieces), np.int32))
    face = int(pieces[0])
    k, place = np.nonzero(mesh.quads.faces == face)
    if not len(k):
        return with_vertices(mesh, mesh.triangles[face], [[0, 1, 2]])
    corners = mesh.quads.corners[[2, 3, 0, 1] if place[0] else [0, 1, 2, 3], k[0]]
    quad = Quads(np.array([[0, 1]]), np.arange(4)[:, None])
    return with_vertices(mesh, corners, [[0, 1, 3], [2, 3, 1]])._replace(quads=quad)
